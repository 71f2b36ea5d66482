"""Reads, writes, checks and transfers missions, fences and rally points."""
