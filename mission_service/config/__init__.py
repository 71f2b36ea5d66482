"""The schema, defaults and checks of the scenario file."""
