"""Rothermel 1972: fuels, moistures, weather, rate of spread; one function for each equation."""
