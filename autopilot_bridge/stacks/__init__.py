"""The differences of PX4 and ArduPilot: modes and rules of items."""
