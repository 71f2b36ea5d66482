"""The scenario file: its schema, defaults and checks."""
