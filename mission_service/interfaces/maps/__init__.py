"""The fire in formats for maps: forecasts, fronts, overlays, terrain; imports and exports."""
