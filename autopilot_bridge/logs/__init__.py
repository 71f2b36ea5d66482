"""Reads flight logs: Reads logs: MAVLink telemetry logs, ArduPilot's DataFlash, PX4's ULog.

All readers yield the same kinds of events, in the order of the file, with times by the log's own
clock. Readers continue after damaged parts, which they list in ``damage``. Only the part that is
being read is in memory.
"""
