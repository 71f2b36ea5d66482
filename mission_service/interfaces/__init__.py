"""The interfaces of a run for operators and other programs."""
