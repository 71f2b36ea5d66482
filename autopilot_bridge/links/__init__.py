"""Links: addresses, transports, framing, codec, signing, recordings (``.tlog``)."""
