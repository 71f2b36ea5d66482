"""A mock autopilot: the vehicle's side of the protocols of both stacks, with a flight model."""
