"""The simulated fire, its observation, forecasts, and the estimated fire of a burn."""
