"""Ignition lines, and safe flights along these lines. Pure."""
