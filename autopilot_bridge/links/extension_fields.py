"""Adds extension fields that the installed dialect does not have: PX4's opaque ids."""

import struct

from autopilot_bridge.links.codec import Message


def with_extension(message: Message, *ids: int) -> Message:
    """Return a message with ``ids`` appended as uint32 fields, which older decoders ignore."""
    if not any(ids):
        return message
    message.extension_bytes = struct.pack(f"<{len(ids)}I", *ids)
    return message
