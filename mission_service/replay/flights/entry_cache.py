"""A stream that can be read again from any place: what has come is in a file, not in memory."""

import pickle
from collections.abc import Iterator
from tempfile import TemporaryFile
from typing import Generic, TypeVar

BLOCK = 500  # things that are read again together

Thing = TypeVar("Thing")


class EntryCache(Generic[Thing]):
    """Things of a stream by their numbers from 0; nothing is taken from it before it is needed."""

    def __init__(self, stream: Iterator[Thing]) -> None:
        self._stream = stream
        self._file = TemporaryFile()  # noqa: SIM115 -- closed by ``close``
        self._begins: list[int] = []  # of blocks, in the file
        self._last: list[Thing] = []  # the block that is not whole yet
        self._again: tuple[int, list[Thing]] = (-1, [])  # the block that was read last

    def get(self, number: int) -> Thing | None:
        """The thing of a number; None behind the end. Numbers grow by one, or go back."""
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
        """The file is gone then."""
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
