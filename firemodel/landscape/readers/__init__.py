"""Files into arrays and geometries: rasters of landscapes and arrival times, shapes, weather."""
