"""The parts of a client: the table of commands, transfers, telemetry, parameters, monitoring.

Sans-IO: the time is an argument in microseconds. Functions receive messages and return messages and
events.
"""
