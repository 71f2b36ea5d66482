"""The planner that chooses routes along closed fronts by the expected fall of the estimate's error."""
