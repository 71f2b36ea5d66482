"""Logs of flights: MAVLink telemetry logs, ArduPilot's DataFlash, PX4's ULog, as the same events.

Each reader yields entries in the order of the file, on the log's own clock, and continues after
damaged parts, which it lists in its ``damage``. Only the part being read is held in memory.
"""
