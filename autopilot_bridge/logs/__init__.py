"""Logs of flights: MAVLink telemetry logs, ArduPilot's DataFlash, PX4's ULog, as the same events.

Each reader yields entries in the order of the file, on the log's own clock, and goes on behind what
is damaged; what it had to leave out is in its ``damage``. Nothing is held in memory but the piece
that is read.
"""
