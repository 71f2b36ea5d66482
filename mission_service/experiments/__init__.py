"""Run the papers' experiments: fly planners over fires that are simulated once."""
