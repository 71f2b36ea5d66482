"""Other aircraft: report decoders, tracks, and alerts based on well clear volumes. Pure.

Separation between the vehicles of a run is in ``vehicles/traffic.py`` and ``missions/``.
"""
