"""Commands that prepare an incident: its scenario file and its basemaps."""
