"""Simulates autopilots: the vehicle's side of both stacks' protocols, and the flight."""
