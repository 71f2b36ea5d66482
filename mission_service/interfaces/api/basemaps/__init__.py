"""The routes of basemaps."""
