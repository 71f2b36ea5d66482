"""Transports: addresses, sockets, framing, signing, tlog."""
