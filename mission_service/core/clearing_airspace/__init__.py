"""Clears the airspace at an operator's request; ``airspace_clearing`` is the part of the core."""
