"""Sensors of the service: each converts its input to observations of the fire.

The key ``estimate.sensors`` of a scenario names the sensors, including those of other packages
(``mission_service.fire.sensors``). ``thermal_frames`` reads the images of thermal cameras from a
watched folder, and ``thermal_video`` receives the video of such cameras. ``camera_points`` uses
single points that cameras report over MAVLink. ``observation_files`` reads perimeters, satellite
pixels and rasters from a watched folder.
"""
