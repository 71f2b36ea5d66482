"""Correct simulated fires by observations, and estimate fires from observations.

``fire_estimate`` is an ensemble of fires that is corrected by camera images and mapped perimeters
(``observation``); ``scores`` compares its forecasts with later observations.

The other modules correct the fires of prescribed burns and of operators' drawings: in these modules
an observation is a place, a time and a state (burned, burning or unburned). ``camera_front`` and
``map_drawing`` make observations. ``gaussian_process`` and ``distance_weighting`` correct a
simulation by observations; ``corrected_cells`` corrects a cellular fire.
"""
