"""Caches the entries of a stream in a file, so that they can be read again."""

import pickle
from collections.abc import Iterator
from tempfile import TemporaryFile
from typing import Generic, TypeVar

BLOCK = 500  # entries in one block of the file

Entry = TypeVar("Entry")


class EntryCache(Generic[Entry]):
    """The entries of a stream by index from 0; the stream is read only as far as needed."""

    def __init__(self, stream: Iterator[Entry]) -> None:
        self._stream = stream
        self._file = TemporaryFile()  # noqa: SIM115 -- closed by ``close``
        self._begins: list[int] = []  # file offsets of blocks
        self._last: list[Entry] = []  # the incomplete block
        self._reread: tuple[int, list[Entry]] = (-1, [])  # number and content of a block

    def get(self, number: int) -> Entry | None:
        """Return the entry at an index, or None after the end of the stream.

        The index must not exceed the largest index of earlier calls by more than one.
        """
        block, place = divmod(number, BLOCK)
        if block < len(self._begins):
            return self._read(block)[place]
        while place >= len(self._last):
            entry = next(self._stream, None)
            if entry is None:
                return None
            self._last.append(entry)
        found = self._last[place]
        if place == BLOCK - 1:
            self._write()
        return found

    def close(self) -> None:
        """Close and delete the temporary file."""
        self._file.close()

    def _write(self) -> None:
        self._begins.append(self._file.seek(0, 2))
        pickle.dump(self._last, self._file, pickle.HIGHEST_PROTOCOL)
        self._last = []

    def _read(self, block: int) -> list[Entry]:
        if self._reread[0] != block:
            self._file.seek(self._begins[block])
            self._reread = (block, pickle.load(self._file))
        return self._reread[1]
