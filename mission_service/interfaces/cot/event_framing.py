"""Splits the byte stream from a TAK server into Cursor on Target events. Sans-IO.

A server sends one XML event after another; each event ends with ``</event>`` (TAK protocol version
0, "Traditional Protocol"). A server sends the binary version 1 only to clients that request it.
"""

import re

MAX_EVENT_BYTES = 64 * 1024  # a shape of 1000 points takes about 55 kB, and is read in 20 ms
_END = b"</event>"
_BEGIN = re.compile(rb"<event[\s>]")


class EventFramer:
    """A buffer for one connection; ``too_long`` counts the events that exceeded the limit."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._skips = False  # the rest of an event that is too long is skipped
        self.too_long = 0

    def receive(self, data: bytes) -> list[bytes]:
        """Add received bytes; return the events that are now complete, without XML headers."""
        searched = max(len(self._buffer) - len(_END) + 1, 0)
        self._buffer += data
        events = []
        while (end := self._buffer.find(_END, searched)) >= 0:
            events.append(bytes(self._buffer[: end + len(_END)]))
            del self._buffer[: end + len(_END)]
            searched = 0
        if self._skips and events:
            del events[0]
            self._skips = False
        if len(self._buffer) > MAX_EVENT_BYTES:
            self.too_long += not self._skips
            self._skips = True
            del self._buffer[: -len(_END) + 1]  # keep what may be part of an end tag
        return [event_in(each) for each in events]


def event_in(data: bytes) -> bytes:
    """Return the bytes from the last ``<event`` onwards, or all bytes if there is none."""
    begins = [found.start() for found in _BEGIN.finditer(data)]
    return data[begins[-1] :] if begins else data
