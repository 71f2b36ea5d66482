"""Splits a byte stream into parts with a common terminator, such as lines. Pure."""


def complete_parts(data: bytes, end: bytes, max_bytes: int) -> tuple[list[bytes], bytes]:
    """Return the complete parts of the received bytes, without their terminators, and the rest.

    The rest belongs before the next data; a rest longer than ``max_bytes`` is discarded.
    """
    *parts, rest = data.split(end)
    return parts, rest if len(rest) <= max_bytes else b""
