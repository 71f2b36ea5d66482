"""Reads lines of a growing journal without reading it from its beginning."""

import os
import threading
from collections import OrderedDict
from typing import BinaryIO

EVERY_LINES = 1000
PART_BYTES = 1 << 20
MAX_FILES = 4  # with an index; the least recently used index is dropped first


class JournalLines:
    """An index of every thousandth line of recent files. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._files: OrderedDict[tuple[int, int], _Begins] = OrderedDict()

    def after(self, file: BinaryIO, line: int, limit: int, max_bytes: int) -> tuple[bytes, int]:
        """Return whole lines after ``line`` (the header is line 1), and the number of the last of them.

        At most ``limit`` lines; no further line once they have more than ``max_bytes``.
        """
        with self._lock:
            begins = self._known(file)
            part = min(line // EVERY_LINES, len(begins.at_byte) - 1)
            file.seek(begins.at_byte[part])
            found: list[bytes] = []
            size = 0
            for number, text in enumerate(file, start=part * EVERY_LINES + 1):
                if number <= line:
                    continue
                if not text.endswith(b"\n") or len(found) >= limit or size > max_bytes:
                    break
                found.append(text)
                size += len(text)
            return b"".join(found), line + len(found)

    def _known(self, file: BinaryIO) -> "_Begins":
        stat = os.fstat(file.fileno())
        named = (stat.st_dev, stat.st_ino)
        begins = self._files.pop(named, None)
        if begins is None or stat.st_size < begins.counted_bytes:
            begins = _Begins()
        begins.count(file)
        self._files[named] = begins
        if len(self._files) > MAX_FILES:
            self._files.popitem(last=False)
        return begins


class _Begins:
    """Byte offsets of lines 1, 1001, 2001, ... of a file."""

    def __init__(self) -> None:
        self.at_byte = [0]
        self.counted_bytes = 0
        self._lines = 0

    def count(self, file: BinaryIO) -> None:
        """Count the lines that were appended since the last call."""
        file.seek(self.counted_bytes)
        while part := file.read(PART_BYTES):
            place = -1
            while (place := part.find(b"\n", place + 1)) >= 0:
                self._lines += 1
                if self._lines % EVERY_LINES == 0:
                    self.at_byte.append(self.counted_bytes + place + 1)
            self.counted_bytes += len(part)
