"""Readers of flight logs: MAVLink telemetry logs, ArduPilot's DataFlash, PX4's ULog.

All readers yield the same events, in the order of the file, on the log's own clock. They continue
after damaged parts, which they list in ``damage``. Only the part being read is in memory.
"""
