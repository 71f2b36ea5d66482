"""The time until the fire reaches people, roads and structures, and the alarms about it. Pure."""
