"""A mock autopilot: the vehicle side of the mission protocol, with simple flight underneath."""
