"""Writes a journal to a disk that may fail; during a failure only aborts are handled.

During a disk failure, the service answers operators' requests with an error and does not handle
vehicle events. The vehicles fly the missions on board, which end in a loiter. Commands already
issued, and aborts with their commands, are buffered in memory. The buffered lines are written first
after the failure, so that the journal can be replayed.
"""

import errno

from mission_service.commands import AnyCommand
from mission_service.events import Aborted, AnyEvent
from mission_service.journal.journal_file import Journal, command_body, event_body

MAX_WAITING = 20_000  # buffered lines (10 MB); above this number, aborts are refused too


class GuardedJournal:
    """The writer of a journal. ``trouble`` is the reason why the last write failed, or empty."""

    def __init__(self, journal: Journal) -> None:
        self.journal = journal
        self.trouble = ""
        self._waiting: list[bytes] = []
        self._urgent = False  # the event being handled is an abort
        self._before = journal.rest
        self._before_waiting = 0

    def write_event(self, event: AnyEvent, body: bytes | None = None) -> bool:
        """Journal an event before it is handled, and return whether it may be handled.

        ``body`` is the event's ``event_body``, if the caller has computed it. Raises
        RefusedEventError for an event that could not be read back.
        """
        self._urgent = isinstance(event, Aborted) and len(self._waiting) < MAX_WAITING
        self._before_waiting = len(self._waiting)
        if not self.trouble:
            try:
                self._before = self.journal.rest
                self.journal.write_event(event, body)
                return True
            except OSError as error:
                self._failed(error)
        if self._urgent:
            self._waiting.append(event_body(event))
        return self._urgent

    def write_commands(self, commands: list[AnyCommand]) -> bool:
        """Journal the last event's commands and return whether they may be executed."""
        if not self.trouble:
            try:
                self.journal.write_commands(commands)
                return True
            except OSError as error:
                self._failed(error)
        self._waiting += [command_body(command) for command in commands]
        return self._urgent

    def remove_last(self) -> None:
        """Remove the last event, which was refused and had no effect, from the journal."""
        if self.trouble:  # the event is an abort, and its line is waiting
            del self._waiting[self._before_waiting :]
            return
        try:
            self.journal.remove_last(self._before)
        except OSError as error:
            self._failed(error)

    def retry(self) -> bool:
        """Try to write the buffered lines, and return whether this succeeded."""
        try:
            self.journal.write_lines(self._waiting, to_disk=True)
        except OSError as error:
            self._failed(error)
            return False
        self._waiting.clear()
        self.trouble = ""
        return True

    def _failed(self, error: OSError) -> None:
        if not self.journal.durable:  # a simulation ends with the error
            raise error
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        self.trouble = "disk full" if full else f"cannot be written: {error.strerror}"
