"""Run the papers' experiments: fly planners over fires, each simulated once."""
