"""The papers' experiments: planners flown over fires that were simulated once."""
