"""Flights that were flown: what logs and journals tell of them, and what the core makes of that."""
