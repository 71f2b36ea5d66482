"""Records a link's frames in a .tlog file (for MAVProxy, QGroundControl and pymavlink).

A record is a time (microseconds since 1970 as a big-endian uint64) and one frame as it was sent or
received. One file contains both directions. The two lowest bits of the time are the number of the
link, as in recordings of MAVProxy.
"""

import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Self

from autopilot_bridge.errors import BridgeError

_LINK_BITS = 3


class Tlog:
    """A .tlog file that is open within its context; ``wall_us`` returns microseconds since 1970.

    Records are appended to an existing file. Each record is passed to the operating system at once,
    so that no record is lost if the program crashes.
    """

    def __init__(self, path: Path, wall_us: Callable[[], int]) -> None:
        self._path = path
        self._wall_us = wall_us
        try:
            self._file = open(path, "ab", buffering=0, opener=_private)  # noqa: SIM115
        except OSError as error:
            raise BridgeError(f"{path}: cannot be written: {error.strerror}") from None

    def record(self, frames: list[bytes], link: int = 0) -> None:
        """Append frames that were just sent or received over a link.

        Raises BridgeError if the disk is full.
        """
        stamp = struct.pack(">Q", self._wall_us() & ~_LINK_BITS | min(link, _LINK_BITS))
        data = b"".join(stamp + frame for frame in frames)
        try:
            written = self._file.write(data)
        except OSError as error:
            raise BridgeError(f"{self._path}: cannot be written: {error.strerror}") from None
        if written != len(data):
            raise BridgeError(f"{self._path}: cannot be written: the disk is full")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._file.close()


def _private(path: str, flags: int) -> int:
    """Open a file that only the user can access; a symbolic link is an error."""
    return os.open(path, flags | os.O_NOFOLLOW, 0o600)
