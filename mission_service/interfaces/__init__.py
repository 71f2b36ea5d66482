"""The interfaces of a run to operators and programs."""
