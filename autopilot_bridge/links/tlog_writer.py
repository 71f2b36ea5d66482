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
_STAMP_BYTES = 8
_FRAME_BEGINS = (b"\xfd", b"\xfe")  # MAVLink 2 and 1
RETRY_US = 10_000_000  # time between two attempts to write to a full disk


class Tlog:
    """A .tlog file that is open within its context; ``wall_us`` returns microseconds since 1970.

    Records are appended to an existing file. Each record is passed to the operating system at once,
    so that no record is lost if the program crashes. If the disk is full, ``report`` receives one
    line, and frames are not recorded until the file can be written again. The constructor raises
    BridgeError if the file cannot be opened, or is not a .tlog file.
    """

    def __init__(
        self, path: Path, wall_us: Callable[[], int], report: Callable[[str], None]
    ) -> None:
        self._path = path
        self._wall_us = wall_us
        self._report = report
        self._retry_us: int | None = None  # time of the next attempt after a failure
        self._missing = 0  # frames that could not be recorded
        try:
            if path.is_file() and not _is_tlog(path):
                raise BridgeError(f"{path}: is not a .tlog file; choose another name for --tlog")
            self._file = open(path, "ab", buffering=0, opener=_private)  # noqa: SIM115
        except OSError as error:
            raise BridgeError(f"{path}: cannot be written: {error.strerror}") from None

    def record(self, frames: list[bytes], link: int = 0) -> None:
        """Append frames that were just sent or received over a link."""
        now_us = self._wall_us()
        # A clock that was set back ends the wait, because it may take hours to reach the old time.
        if self._retry_us is not None and self._retry_us - RETRY_US <= now_us < self._retry_us:
            self._missing += len(frames)
            return
        stamp = struct.pack(">Q", now_us & ~_LINK_BITS | min(link, _LINK_BITS))
        why = self._written(b"".join(stamp + frame for frame in frames))
        if why:
            self._missing += len(frames)
            if self._retry_us is None:
                self._report(f"{self._path}: cannot be written: {why}; frames are not recorded")
            self._retry_us = now_us + RETRY_US
        elif self._retry_us is not None:
            self._report(f"{self._path}: is written again; {self._missing} frames are missing")
            self._retry_us, self._missing = None, 0

    def _written(self, data: bytes) -> str:
        """Write all or nothing; return why nothing could be written, or ""."""
        try:
            written = self._file.write(data)
            if written == len(data):
                return ""
            self._file.truncate(self._file.tell() - written)
        except OSError as error:
            return error.strerror or str(error)
        return "the disk is full"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._file.close()


def _is_tlog(path: Path) -> bool:
    """Return whether a file is empty or begins with a record."""
    with path.open("rb") as file:
        begin = file.read(_STAMP_BYTES + 1)
    return not begin or begin[_STAMP_BYTES:] in _FRAME_BEGINS


def _private(path: str, flags: int) -> int:
    """Open a file that only the user can access; a symbolic link is an error."""
    return os.open(path, flags | os.O_NOFOLLOW, 0o600)
