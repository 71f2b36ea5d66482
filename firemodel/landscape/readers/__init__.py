"""Read files: landscape and arrival time rasters, shapes, and weather."""
