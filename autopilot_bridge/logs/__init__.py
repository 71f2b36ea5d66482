"""Reads flight logs: MAVLink telemetry logs, ArduPilot's DataFlash and PX4's ULog.

All readers yield the same kinds of events, in the order of the file. The times are those of the
log's clock. A reader continues after a damaged part of the file and lists the part in ``damage``.
Only the part that is being read is in memory.
"""
