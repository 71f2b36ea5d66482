"""Cursor on Target: vehicles and the fire's front on other maps."""
