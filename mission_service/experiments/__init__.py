"""Run the experiments of the papers: planners fly over fires, each of which is simulated once."""
