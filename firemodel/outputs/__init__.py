"""Write fires as files for other programs, and draw them.

``raster_layers`` defines the layers with their units, classes and colours. ``geotiff`` and
``netcdf`` write rasters, ``front_files`` writes fronts, ``qgis_styles`` makes the styles beside
them, and ``arrival_map`` draws a PNG.
"""
