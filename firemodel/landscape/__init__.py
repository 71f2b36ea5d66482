"""Landscapes: grids of terrain and fuel, and the files they are read from."""
