"""Run the experiments of the papers: planners fly over fires that are simulated only once."""
