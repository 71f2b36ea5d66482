"""Files of perimeters, satellite pixels and rasters that arrive in a watched folder."""
