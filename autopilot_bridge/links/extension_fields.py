"""Adds extension fields that the installed dialect does not have: PX4's opaque ids."""

import struct

from autopilot_bridge.links.codec import Message


def with_extension(message: Message, *ids: int) -> Message:
    """Return a message with ``ids`` appended as uint32 fields, which older decoders ignore."""
    if not any(ids):
        return message
    payload = message.unpacker.pack(*(getattr(message, n) for n in message.ordered_fieldnames))
    extended = payload + struct.pack(f"<{len(ids)}I", *ids)

    def pack(mav: Message, force_mavlink1: bool = False) -> bytes:
        frame: bytes = message._pack(mav, message.crc_extra, extended, force_mavlink1)
        return frame

    message.pack = pack
    return message
