"""Simulates an autopilot: the vehicle's side of the protocols of both stacks, and its flight."""
