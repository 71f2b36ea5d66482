"""Reads lines of a growing journal without reading the journal from the beginning."""

import os
import threading
from collections import OrderedDict
from typing import BinaryIO

EVERY_LINES = 1000
PART_BYTES = 1 << 20
MAX_FILES = 4  # files with an index; the least recently used index is dropped first


class JournalLines:
    """An index of every thousandth line in recently read files. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._files: OrderedDict[tuple[int, int, int], _LineIndex] = OrderedDict()

    def after(
        self, file: BinaryIO, segment: int, line: int, limit: int, max_bytes: int
    ) -> tuple[bytes, int]:
        """Return the complete lines after line number ``line``, and the number of the last one.

        The header is line 1. The result has at most ``limit`` lines, and ends with the line at
        which the total size exceeds ``max_bytes``. ``segment`` is the number of the segment in the
        file: a new segment may have the inode of a deleted one.
        """
        with self._lock:
            index = self._index_of(file, segment)
            part = min(line // EVERY_LINES, len(index.at_byte) - 1)
            file.seek(index.at_byte[part])
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

    def _index_of(self, file: BinaryIO, segment: int) -> "_LineIndex":
        stat = os.fstat(file.fileno())
        key = (segment, stat.st_dev, stat.st_ino)
        index = self._files.pop(key, None)
        if index is None or stat.st_size < index.counted_bytes:
            index = _LineIndex()
        index.count(file)
        self._files[key] = index
        if len(self._files) > MAX_FILES:
            self._files.popitem(last=False)
        return index


class _LineIndex:
    """The byte offsets of lines 1, 1001, 2001 and so on in a file."""

    def __init__(self) -> None:
        self.at_byte = [0]
        self.counted_bytes = 0
        self._lines = 0

    def count(self, file: BinaryIO) -> None:
        """Count the lines that were appended since the last call."""
        file.seek(self.counted_bytes)
        while part := file.read(PART_BYTES):
            end = -1
            while (end := part.find(b"\n", end + 1)) >= 0:
                self._lines += 1
                if self._lines % EVERY_LINES == 0:
                    self.at_byte.append(self.counted_bytes + end + 1)
            self.counted_bytes += len(part)
