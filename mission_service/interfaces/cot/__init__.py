"""Cursor on Target: vehicles and front to other maps."""
