"""The simulated fire, observations of it, forecasts, and the estimated fire of a burn."""
