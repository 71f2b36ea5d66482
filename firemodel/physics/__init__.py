"""Define fuels and weather, and compute moistures and Rothermel's rates of spread."""
