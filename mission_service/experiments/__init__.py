"""The papers' experiments: fires that are burned once, and planners flown over them."""
