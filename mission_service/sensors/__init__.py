"""Sensors of the service: each converts its input to observations of the fire.

A scenario names them in ``estimate.sensors``, like the sensors of other packages
(``mission_service.fire.sensors``). ``thermal_frames`` reads the images of thermal cameras from a
watched folder, and ``thermal_video`` receives their video. ``camera_points`` uses single places
that cameras report by MAVLink. ``observation_files`` reads perimeters, satellite pixels and rasters
from a watched folder.
"""
