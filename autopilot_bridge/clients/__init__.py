"""Clients for one vehicle, as peers of a link: native MAVLink (``native``), MAVSDK (``mavsdk``).

``client_protocol`` is their common interface; ``shared_link`` decodes the messages of one link once
for all its vehicles.
"""
