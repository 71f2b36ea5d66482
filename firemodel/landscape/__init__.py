"""Landscapes (grids of terrain and fuel) and their file formats.

``LAYERS`` lists the names of the layers in files and scenarios.
"""

LAYERS = (
    "fuel",
    "elevation",
    "slope",
    "aspect",
    "canopy_cover",
    "canopy_height",
    "canopy_base",
    "canopy_bulk_density",
)
