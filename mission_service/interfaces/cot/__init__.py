"""Cursor on Target: sends vehicles and the fire front to other maps, and receives reports."""
