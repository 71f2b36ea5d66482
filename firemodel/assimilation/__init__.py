"""Corrections of a simulated fire by what is observed."""
