"""Cursor on Target: sends vehicles and the fire's front to other maps, and receives reports."""
