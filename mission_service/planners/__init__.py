"""Planners: pure decisions from what vehicles have seen."""
