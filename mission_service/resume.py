"""Going on after a kill: the newest state, and the rest of the journal through it; nothing done.

Nothing of what was on its way is trusted: ``Resumed`` comes after the last event, and voids all.
"""

from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from mission_service.commands import AnyCommand
from mission_service.config import Scenario
from mission_service.differences import difference_of
from mission_service.errors import JournalError, StateError
from mission_service.events import AnyEvent, Resumed
from mission_service.journal import Entry, JournalReader, Rest
from mission_service.planning import BURN
from mission_service.segments import Chain, closed_segments, complete, move, remove, states
from mission_service.state_file import Known, header_of, read

ANEW = "; to begin anew, move that file away (it is the record of the run) and tell what burns"


class Unfinished:
    """A journal of a run that was cut off, to be gone on with.

    ``objects`` is the newest state that can be used, or None: then all is told from the beginning.
    ``passed_over`` says why newer states could not be.
    """

    def __init__(self, path: Path, chain: Chain, known: Known) -> None:
        """Raises JournalError in one line if there is neither a state nor the beginning."""
        self.path = path
        self._chain = chain
        self.last_us = 0
        self.missing: tuple[AnyCommand, ...] = ()
        self.objects: dict[str, Any] | None = None
        self.passed_over: list[str] = []
        self._place = chain.begin
        # With short segments the state of the last one's beginning is newer than ``journal.state``.
        usable: list[tuple[Rest, Path]] = []
        for state in states(path):
            try:
                place = header_of(state, known).rest
                if not chain.holds(place):
                    raise StateError(f"{state}: its place is not in the journal")
                usable.append((place, state))
            except StateError as error:
                self.passed_over.append(str(error))
        for place, state in sorted(usable, key=_latest_last, reverse=True):
            try:
                self.objects, self._place = read(state, known), place
                return
            except StateError as error:
                self.passed_over.append(str(error))
        if chain.readers[0].segment != 1:
            why = "; ".join(self.passed_over) or "there is none"
            raise JournalError(
                f"{path}: cannot be gone on with: its beginning was deleted, and no state can be "
                f"used ({why}); go on with the version that wrote it, or move the files of the "
                "journal away and tell what burns"
            )

    def rest(self) -> Rest:
        """Where it goes on; raises JournalError in one line if it is damaged."""
        for _ in self._entries():
            pass
        return self._chain.last.rest

    def turns(
        self, handle: Callable[[AnyEvent], list[AnyCommand]]
    ) -> Iterator[tuple[AnyEvent, list[AnyCommand]]]:
        """Each event with the commands that ``handle``, the core's, answers with.

        Raises JournalError where these are not the journal's. Afterwards ``last_us`` is the latest
        mission time in it, and ``missing`` are commands of the last event that the journal has
        not: nobody carried them out, for they are written down first.
        """
        expected: deque[AnyCommand] = deque()
        for path, entry in self._entries():
            difference = difference_of(entry, expected)
            if difference is not None:
                raise JournalError(
                    f"{path}: cannot be gone on with: {difference}; was it written by another "
                    f"version?{ANEW}"
                )
            if entry.is_event:
                event: AnyEvent = entry.content  # type: ignore[assignment]
                commands = handle(event)
                self.last_us = max(self.last_us, event.at_us)
                expected.extend(commands)
                yield event, commands
            else:
                expected.popleft()
        self.missing = tuple(expected)

    def _entries(self) -> Iterator[tuple[Path, Entry]]:
        try:
            for reader, entry in self._chain.after(self._place):
                if not entry.intact:
                    raise JournalError(
                        f"{reader.path}: line {entry.line} was altered: its checksum does not match"
                    )
                yield reader.path, entry
        except JournalError as error:
            known = str(error)
            raise JournalError(known if ANEW in known else known + ANEW) from None


def _latest_last(found: tuple[Rest, Path]) -> tuple[int, int]:
    return found[0].segment, found[0].at_byte


def unfinished(path: Path, known: Known, scenario: Scenario) -> Unfinished | None:
    """The journal at ``path`` if it is a live run of this very scenario that was cut off.

    Raises JournalError if nobody can tell because its first line is damaged.
    """
    complete(path)
    if not path.exists() or _header_cut(path):
        return None
    try:
        header = JournalReader(path).header
    except JournalError as error:
        if scenario.planner.rule != BURN and not closed_segments(path):
            return None  # whatever it is, it is replaced as ever
        raise JournalError(f"{error}{ANEW}") from None
    same = (
        header["scenario"] == scenario.model_dump(mode="json")
        and header["landscape_sha256"] == known.landscape
    )
    if not same or not header.get("live") or _ended(path):
        return None
    return Unfinished(path, Chain(path), known)


def set_aside(path: Path, scenario: Scenario) -> Path | None:
    """Keep the journal of an earlier burn beside the new one; returns where it is now.

    A file without a whole header holds nothing. Journals of other rules are replaced, as ever;
    segments whose last one somebody has moved away are kept.
    """
    if path.exists() and (_header_cut(path) or not _of_burn(path, scenario)):
        remove(path)
    if not path.exists() and not closed_segments(path):
        remove(path)
        return None
    number = 1
    while (kept := path.with_name(f"{path.stem}-{number}{path.suffix}")).exists():
        number += 1
    move(path, kept)
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
