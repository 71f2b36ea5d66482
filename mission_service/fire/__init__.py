"""Simulate the fire, observe and forecast it, and estimate the fire of a burn."""
