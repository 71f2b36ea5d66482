"""The airspace of a run: volumes that are closed to vehicles, and checks of planned flights."""
