"""Missions, fences and rally points: files, checks, and transfers as state machines."""
