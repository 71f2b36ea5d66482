"""The fire in formats for maps: forecasts, fronts, overlays, terrain, perimeters in and out."""
