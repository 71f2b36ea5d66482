"""A stream that can be read again from any position; entries read are kept in a file."""

import pickle
from collections.abc import Iterator
from tempfile import TemporaryFile
from typing import Generic, TypeVar

BLOCK = 500  # entries in one block of the file

Thing = TypeVar("Thing")


class EntryCache(Generic[Thing]):
    """Entries of a stream by index from 0; the stream is read only as far as needed."""

    def __init__(self, stream: Iterator[Thing]) -> None:
        self._stream = stream
        self._file = TemporaryFile()  # noqa: SIM115 -- closed by ``close``
        self._begins: list[int] = []  # file offsets of blocks
        self._last: list[Thing] = []  # the incomplete block
        self._again: tuple[int, list[Thing]] = (-1, [])  # the block that was read last

    def get(self, number: int) -> Thing | None:
        """Return the entry of an index; None behind the end. An index rises by one, or goes back."""
        block, place = divmod(number, BLOCK)
        if block < len(self._begins):
            return self._read(block)[place]
        while place >= len(self._last):
            thing = next(self._stream, None)
            if thing is None:
                return None
            self._last.append(thing)
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

    def _read(self, block: int) -> list[Thing]:
        if self._again[0] != block:
            self._file.seek(self._begins[block])
            self._again = (block, pickle.load(self._file))
        return self._again[1]
