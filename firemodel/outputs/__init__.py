"""Write fires as files for other programs, and draw them.

``raster_layers`` is the table of layers with their units and colours. ``geotiff`` writes rasters,
``front_files`` the fronts, ``qgis_styles`` the styles beside them, and ``arrival_map`` draws a PNG.
"""
