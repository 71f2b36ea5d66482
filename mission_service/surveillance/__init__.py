"""Other aircraft: decoders of their reports, their tracks, and alerts by well clear volumes. Pure.

Separation between the vehicles of a run is in ``vehicles/traffic.py`` and ``missions/``.
"""
