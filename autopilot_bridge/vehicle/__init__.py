"""Contains the parts of a client: the command table, transfers, telemetry, parameters, monitoring.

These parts do no input or output. Functions receive messages and the time in microseconds, and
return messages and events.
"""
