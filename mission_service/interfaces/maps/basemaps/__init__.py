"""Basemaps: files of map tiles and images in a folder, and lines from the landscape's elevation."""
