"""Thermal images are read from files, georeferenced, registered, and converted to cells."""
