"""Simulate fires, observe and forecast them, and estimate the fire of a run or of a burn."""
