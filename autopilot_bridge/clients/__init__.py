"""MAVSDK as another client of a vehicle."""
