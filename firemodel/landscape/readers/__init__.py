"""Readers of files: rasters of landscapes and arrival times, shapes, weather."""
