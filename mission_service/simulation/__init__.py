"""Simulation: virtual time, mock autopilots in processes of their own, the demo."""
