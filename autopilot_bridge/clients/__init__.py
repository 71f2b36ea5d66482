"""The clients of one vehicle, as peers: our own (``native``) and MAVSDK (``mavsdk``).

``client_protocol`` has what both do; ``shared_link`` decodes once for many vehicles on one link.
"""
