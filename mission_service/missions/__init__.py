"""Conversion of a path on the map to mission items, within terrain and airspace."""
