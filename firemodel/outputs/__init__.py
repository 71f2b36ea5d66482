"""Write simulated fires to files for GIS, and draw maps of them.

``layer_legends`` defines the layers with their units, classes and colours. ``geotiff`` and
``netcdf`` write rasters, ``front_files`` writes fronts, ``qgis_style_files`` creates QGIS styles
for these files, and ``arrival_map`` draws a PNG. ``notebook_views`` shows landscapes and fires in
notebooks, and ``xarray_datasets`` converts them to xarray datasets, and datasets to landscapes.
"""
