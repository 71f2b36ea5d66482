"""Thermal images: read from files, placed on the ground, registered, and converted to cells."""
