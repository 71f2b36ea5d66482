"""The parts of a client: the table of commands, transfers, telemetry, parameters, monitoring.

Sans-IO: time is an argument in microseconds; messages in, messages and events out.
"""
