"""Simulations in virtual time, mock autopilots in separate processes, and the demo."""
