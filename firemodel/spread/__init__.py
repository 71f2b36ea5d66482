"""Fire that spreads over a landscape: schemes, fronts, maps and files of the result."""
