"""Going on with a burn after a kill: a journal's events through a fresh core, nothing carried out.

Nothing of what was on its way is trusted: ``Resumed`` comes after the last event, and voids all.
"""

from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from mission_service.commands import AnyCommand
from mission_service.config import Scenario
from mission_service.differences import difference_of
from mission_service.errors import JournalError
from mission_service.events import AnyEvent, Resumed
from mission_service.journal import JournalReader, Rest
from mission_service.planning import BURN

ANEW = "; to begin anew, move that file away (it is the record of the burn) and tell what burns"


class Unfinished:
    """A journal of a run that was cut off, to be gone on with."""

    def __init__(self, reader: JournalReader) -> None:
        self._reader = reader
        self.last_us = 0
        self.missing: tuple[AnyCommand, ...] = ()

    @property
    def path(self) -> Path:
        """The journal's file."""
        return self._reader.path

    def rest(self) -> Rest:
        """Where it goes on; raises JournalError in one line if it is damaged."""
        for _ in self._entries():
            pass
        return self._reader.rest

    def turns(
        self, handle: Callable[[AnyEvent], list[AnyCommand]]
    ) -> Iterator[tuple[AnyEvent, list[AnyCommand]]]:
        """Each event with the commands that ``handle``, a fresh core's, answers with.

        Raises JournalError where these are not the journal's. Afterwards ``last_us`` is the latest
        mission time in it, and ``missing`` are commands of the last event that the journal has
        not: nobody carried them out, for they are written down first.
        """
        expected: deque[AnyCommand] = deque()
        for entry in self._entries():
            difference = difference_of(entry, expected)
            if difference is not None:
                raise JournalError(
                    f"{self.path}: cannot be gone on with: {difference}; was it written by another "
                    f"version?{ANEW}"
                )
            if entry.is_event:
                event: AnyEvent = entry.content
                commands = handle(event)
                self.last_us = max(self.last_us, event.at_us)
                expected.extend(commands)
                yield event, commands
            else:
                expected.popleft()
        self.missing = tuple(expected)

    def _entries(self) -> Iterator[Any]:
        try:
            for entry in self._reader:
                if not entry.intact:
                    raise JournalError(
                        f"{self.path}: line {entry.line} was altered: its checksum does not match"
                    )
                yield entry
        except JournalError as error:
            known = str(error)
            raise JournalError(known if ANEW in known else known + ANEW) from None


def unfinished(path: Path, scenario: Scenario, landscape_digest: str) -> Unfinished | None:
    """The journal at ``path`` if it is a live burn of this very scenario that was cut off.

    Raises JournalError if nobody can tell because its first line is damaged.
    """
    if scenario.planner.rule != BURN or not path.exists() or _header_cut(path):
        return None
    try:
        reader = JournalReader(path)
    except JournalError as error:
        raise JournalError(f"{error}{ANEW}") from None
    header = reader.header
    same = (
        header["scenario"] == scenario.model_dump(mode="json")
        and header["landscape_sha256"] == landscape_digest
    )
    if not same or not header.get("live") or _ended(path):
        return None
    return Unfinished(reader)


def set_aside(path: Path, scenario: Scenario) -> Path | None:
    """Keep the journal of an earlier burn beside the new one; returns where it is now.

    A file without a whole header holds nothing. Journals of other rules are replaced, as ever.
    """
    if not path.exists() or _header_cut(path) or not _of_burn(path, scenario):
        return None
    number = 1
    while (kept := path.with_name(f"{path.stem}-{number}{path.suffix}")).exists():
        number += 1
    path.rename(kept)
    return kept


def resumed(last_us: int, down_s: float) -> Resumed:
    """What is told to core and crew; mission time went on while the service was down."""
    down_s = max(0.0, down_s)
    return Resumed(last_us + round(down_s * 1e6), "service", "", round(down_s, 3))


def _of_burn(path: Path, scenario: Scenario) -> bool:
    if scenario.planner.rule == BURN:
        return True
    try:
        header = JournalReader(path).header
    except JournalError:  # whatever it is, it is no burn's
        return False
    return bool(header["scenario"]["planner"]["rule"] == BURN)


def _header_cut(path: Path) -> bool:
    """Killed before anything happened."""
    with path.open("rb") as file:
        return not file.readline().endswith(b"\n")


def _ended(path: Path) -> bool:
    """Whether the last line says so; without reading all."""
    with path.open("rb") as file:
        file.seek(0, 2)
        file.seek(max(0, file.tell() - 200))
        tail = file.read()
    last = tail[:-1].rpartition(b"\n")[2]
    return tail.endswith(b"\n") and last.startswith(b'{"end":true,')
