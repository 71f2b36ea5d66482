"""Contains the parts of a link: addresses, transports, framing, codec, signing, recording."""
