"""Read files: rasters of landscapes and of arrival times, shapes, and weather."""
