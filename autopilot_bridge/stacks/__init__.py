"""Lists the differences between PX4 and ArduPilot: modes, and rules for items."""
