"""The fire as maps show it: forecasts, fronts, overlays, terrain, perimeters in and out."""
