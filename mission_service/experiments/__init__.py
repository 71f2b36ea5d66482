"""The papers' experiments: fires that are simulated once, and planners flown over them."""
