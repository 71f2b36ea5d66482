"""A planner that chooses routes along closed fronts to reduce the estimate's expected error."""
