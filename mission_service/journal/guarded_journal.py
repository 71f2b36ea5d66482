"""A journal on a disk that may fail: what cannot be written down is not acted on, but an abort.

While nothing can be written, events of vehicles are not handled (vehicles fly the mission on board,
which ends in a loiter) and requests of people are answered with an error. What the core has
answered before, and aborts with what they led to, waits in memory and is written first of all when
writing works again: so the journal replays as ever.
"""

import errno

from mission_service.commands import AnyCommand
from mission_service.events import Aborted, AnyEvent
from mission_service.journal.journal_file import Journal, command_body, event_body

MAX_WAITING = 20_000  # lines; beyond that not even an abort is handled (10 MB)


class GuardedJournal:
    """Writes a journal down. ``trouble`` says in words why that does not work now, or is empty."""

    def __init__(self, journal: Journal) -> None:
        self.journal = journal
        self.trouble = ""
        self._waiting: list[bytes] = []
        self._urgent = False  # the event being handled is an abort
        self._before = journal.rest
        self._before_waiting = 0

    def event(self, event: AnyEvent, body: bytes | None = None) -> bool:
        """Journal an event before it is handled; returns whether it may be handled.

        ``body`` is its ``event_body``, where that was computed before. Raises RefusedEventError for
        an event that could not be read back.
        """
        self._urgent = isinstance(event, Aborted) and len(self._waiting) < MAX_WAITING
        self._before_waiting = len(self._waiting)
        if not self.trouble:
            try:
                self._before = self.journal.rest
                self.journal.event(event, body)
                return True
            except OSError as error:
                self._failed(error)
        if self._urgent:
            self._waiting.append(event_body(event))
        return self._urgent

    def commands(self, commands: list[AnyCommand]) -> bool:
        """Write down what the last input led to; whether it may be carried out."""
        if not self.trouble:
            try:
                self.journal.commands(commands)
                return True
            except OSError as error:
                self._failed(error)
        self._waiting += [command_body(command) for command in commands]
        return self._urgent

    def take_back(self) -> None:
        """Have the last input never have been written: it is refused, and nothing came of it."""
        if self.trouble:  # then only an abort is handled, and it waits
            del self._waiting[self._before_waiting :]
            return
        try:
            self.journal.take_back(self._before)
        except OSError as error:
            self._failed(error)

    def works_again(self) -> bool:
        """Try to write what has waited; whether there is no trouble any more."""
        try:
            self.journal.lines(self._waiting, to_disk=True)
        except OSError as error:
            self._failed(error)
            return False
        self._waiting.clear()
        self.trouble = ""
        return True

    def _failed(self, error: OSError) -> None:
        if not self.journal.durable:  # a simulation: nobody is in the air
            raise error
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        self.trouble = "disk full" if full else f"cannot be written: {error.strerror}"
