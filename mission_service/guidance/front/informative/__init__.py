"""The planner that chooses routes along closed fronts by the estimate's expected gain."""
