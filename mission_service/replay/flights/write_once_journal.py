"""Writes each line of a replay's journal only once, although the replay can seek backwards.

A replay accepts no orders, so the same log always results in the same lines. After a seek
backwards, lines are counted but not written until the replay reaches the journal's end. The journal
contains the flight up to the latest time played, and can be verified.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mission_service.errors import FlightError
from mission_service.journal.journal_file import Journal, Rest, SegmentReader, begins_journal

REPLAY = "replay"  # key of the logs' names in the header of a replay's journal


class WriteOnceJournal(Journal):
    """A journal in which ``remove_last`` may move the position without removing lines."""

    def __init__(self, path: Path, header: dict[str, Any], logs: tuple[str, ...]) -> None:
        super().__init__(path, {**header, REPLAY: list(logs)}, durable=False)
        self._farthest = self.rest

    def remove_last(self, before: Rest) -> None:
        """Move the position back.

        Lines are removed only if the position was the end of the journal.
        """
        if self.rest == self._farthest:
            super().remove_last(before)
            self._farthest = before
        self.rest = before

    def finish(self, complete: bool) -> None:
        """Close the journal; ``complete`` marks the regular end of the run in the journal."""
        self.rest = self._farthest
        if complete:
            self.end()
        self.close()

    def _put(self, lines: list[bytes], crc: int, to_disk: bool = False) -> None:
        if not hasattr(self, "_farthest"):  # the line is the header
            super()._put(lines, crc, to_disk)
            return
        if self.rest.at_byte < self._farthest.at_byte:
            size = sum(len(line) for line in lines)
            self.rest = Rest(self.rest.at_byte + size, crc, self.rest.segment)
            return
        if self.rest != self._farthest:
            raise FlightError(f"{self.path}: the log was changed while it was being played")
        super()._put(lines, crc, to_disk)
        self._farthest = self.rest


def is_of_replay(path: Path) -> bool:
    """Return whether a file is the journal of a replay. Raises JournalError for a damaged one."""
    return begins_journal(path) and REPLAY in SegmentReader(path).header


def refuse_loss(path: Path, logs: Iterable[Path]) -> None:
    """Raise FlightError if ``path`` is one of the logs, or a file that no replay has written."""
    if not path.exists():
        return
    if not is_of_replay(path) or any(path.samefile(each) for each in logs):
        raise FlightError(f"{path}: already exists and would be overwritten; choose another --out")
