"""Fires corrected by observations: places with a time, where fire has come, comes or has not come.

``camera_front`` and ``map_drawing`` make observations; ``gaussian`` and ``distance_weighting``
correct a simulation by them, and ``corrected_cells`` a fire of cells.
"""
