"""Correct simulated fires by observations.

An observation is a place, a time and a state: burned, burning or unburned.

``camera_front`` and ``map_drawing`` make observations. ``gaussian`` and ``distance_weighting``
correct a simulation by observations; ``corrected_cells`` corrects a cellular fire.
"""
