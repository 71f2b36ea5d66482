"""Clients for one vehicle, which are peers of a link: native MAVLink (``native``) and MAVSDK.

``client_protocol`` is their common interface; ``shared_link`` decodes the messages of a link once
for all its vehicles.
"""
