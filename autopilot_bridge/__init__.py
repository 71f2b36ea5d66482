"""MAVLink missions to and from autopilots. Knows nothing of fires or planners."""
