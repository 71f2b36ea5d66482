"""Clears the airspace at an operator's request; the core uses ``airspace_clearing``."""
