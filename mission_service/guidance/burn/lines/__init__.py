"""Ignition lines, and the safe flights along them that a burn proposes. Pure."""
