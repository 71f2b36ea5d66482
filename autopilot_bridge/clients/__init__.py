"""Contains the clients of a vehicle: native MAVLink (``native``) and MAVSDK (``mavsdk``).

``client_protocol`` is their common interface. ``shared_link`` decodes the messages of a link once
for all vehicles on the link.
"""
