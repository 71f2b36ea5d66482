"""Contains the parts of links: addresses, transports, framing, codec, signing, recording."""
