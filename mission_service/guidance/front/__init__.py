"""One vehicle along the fire front."""
