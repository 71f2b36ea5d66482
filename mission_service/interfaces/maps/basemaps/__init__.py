"""Basemaps: map tile files and images in a folder, and lines derived from the elevation."""
