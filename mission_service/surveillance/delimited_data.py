"""Splits a stream of bytes into parts with a common end, such as lines. Pure."""


def complete_parts(data: bytes, end: bytes, max_bytes: int) -> tuple[list[bytes], bytes]:
    """Return the complete parts of received bytes, without their ends, and the rest.

    The rest begins the next data; a rest of more than ``max_bytes`` is discarded.
    """
    *parts, rest = data.split(end)
    return parts, rest if len(rest) <= max_bytes else b""
