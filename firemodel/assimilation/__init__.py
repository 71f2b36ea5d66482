"""Correct simulated fires with observations, and estimate fires from observations.

``fire_estimate`` is an ensemble of fires, corrected with camera images and mapped perimeters
(``observation``); ``scores`` compares the ensemble's forecasts with later observations.

``learned_inputs`` estimates the errors in wind and spread rates from observed fronts, and
``front_lines`` computes the fronts of the estimated fire.

For the fires of prescribed burns, an observation is a position, a time and a state (burned, burning
or unburned). ``camera_front`` computes such observations from camera images, and ``map_drawing``
from operators' drawings. ``gaussian_process`` and ``distance_weighting`` correct a simulation with
these observations; ``corrected_cells`` corrects a cellular fire.
"""
