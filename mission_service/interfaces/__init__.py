"""How operators and other programs reach a run."""
