"""The journal of a replay that can go back: each line is written only once.

A replay accepts no orders, so the same log yields the same lines again. After going back, lines
are counted and not written until the journal's end is reached. The journal thus contains the
flight as far as it was ever played, and can be verified.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mission_service.errors import FlightError
from mission_service.journal.journal_file import Journal, Rest, SegmentReader, begins_journal

REPLAY = "replay"  # in the header of such a journal: the logs


class WriteOnceJournal(Journal):
    """A journal that ``remove_last`` sets back to an earlier position."""

    def __init__(self, path: Path, header: dict[str, Any], logs: tuple[str, ...]) -> None:
        super().__init__(path, {**header, REPLAY: list(logs)}, durable=False)
        self._farthest = self.rest

    def remove_last(self, before: Rest) -> None:
        """Set the journal back; lines after it are removed only if they are its last ones."""
        if self.rest == self._farthest:
            super().remove_last(before)
            self._farthest = before
        self.rest = before

    def finish(self, complete: bool) -> None:
        """Close it; ``complete``: the flight was played to its end."""
        self.rest = self._farthest
        if complete:
            self.end()
        self.close()

    def _put(self, lines: list[bytes], crc: int, to_disk: bool = False) -> None:
        if not hasattr(self, "_farthest"):  # the header
            super()._put(lines, crc, to_disk)
            return
        if self.rest.at_byte < self._farthest.at_byte:
            size = sum(len(line) for line in lines)
            self.rest = Rest(self.rest.at_byte + size, crc, self.rest.segment)
            return
        if self.rest != self._farthest:
            raise FlightError(f"{self.path}: the log yielded other lines than the first time")
        super()._put(lines, crc, to_disk)
        self._farthest = self.rest


def refuse_loss(path: Path, logs: Iterable[Path]) -> None:
    """Raise FlightError if a file would be overwritten that no replay has left or that is read."""
    if not path.exists():
        return
    ours = begins_journal(path) and REPLAY in SegmentReader(path).header
    if not ours or any(path.samefile(each) for each in logs):
        raise FlightError(f"{path}: exists already and would be overwritten; choose another --out")
