"""Resumes a killed run: loads the newest state and applies the rest of the journal to it.

No command is executed again. The outcome of transfers and orders in progress when the run was
killed is unknown. The event ``Resumed``, which follows the last event, ends these transfers and
orders.

A line that cannot be read or handled ends a restart with an error that names the line. With
``--skip-unreadable`` the line is skipped. The event ``LinesSkipped`` records the skipped line, so
that later restarts and replays also skip it. Between the skipped line and ``LinesSkipped`` the
core's state may differ from that of the live run, so the recorded commands are applied. If the last
event of a journal cannot be handled, the event is always skipped, because the run was killed before
the event could be removed from the journal.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mission_service.commands import AnyCommand
from mission_service.config.scenario import Scenario
from mission_service.errors import JournalError, StateError, UnhandledLineError, in_words
from mission_service.events import AnyEvent, LinesSkipped, Resumed
from mission_service.journal.differences import difference_of
from mission_service.journal.journal_file import (
    Entry,
    Rest,
    SegmentReader,
    Unreadable,
    begins_journal,
)
from mission_service.journal.private_files import refuse_links
from mission_service.journal.segments import Chain, closed_segments, complete, move, states
from mission_service.journal.snapshot import Known, header_of, read

FRESH = "; to begin a new run, start with --fresh (the journal is then renamed)"
SKIP = "; --skip-unreadable resumes without that line"

Line = tuple[int, int]  # segment, line


@dataclass
class _Turn:
    """One event of the journal with its commands; None in place of an unreadable command."""

    reader: SegmentReader
    line: int
    event: AnyEvent
    after_gap: bool  # the preceding event may be missing
    commands: list[tuple[SegmentReader, Entry] | None] = field(default_factory=list)
    is_last: bool = False

    @property
    def recorded(self) -> list[AnyCommand]:
        """The readable commands."""
        found = (each[1].content for each in self.commands if each is not None)
        return list(found)  # type: ignore[arg-type]

    def gives(self, commands: list[AnyCommand]) -> bool:
        """Return whether ``commands`` equal the recorded commands, ignoring unreadable ones."""
        return len(commands) == len(self.commands) and all(
            each is None or each[1].content == command
            for each, command in zip(self.commands, commands, strict=True)
        )


class InterruptedRun:
    """The journal of an interrupted run that is to be resumed.

    ``objects`` is the newest usable state, or None if the journal is applied from its first line.
    ``unusable`` lists the reasons why newer states are not used. ``skipped`` contains the reason
    for each skipped line by (segment, line), and ``newly_skipped`` the reasons that the journal
    does not record yet.
    """

    def __init__(
        self, path: Path, chain: Chain, shared: Known, skip_unreadable: bool = False
    ) -> None:
        """Raise JournalError if both a usable state and the journal's beginning are missing."""
        self.path = path
        self._chain = chain
        self._skip_unreadable = skip_unreadable
        self.last_us = 0
        self.missing: tuple[AnyCommand, ...] = ()
        self.objects: dict[str, Any] | None = None
        self.unusable: list[str] = []
        self.skipped: dict[Line, str] = {}
        self.newly_skipped: dict[Line, str] = {}
        self._at: _Turn | None = None  # applied to the core, perhaps not yet to other projections
        self._place = chain.begin
        # With short segments the state of the last segment is newer than ``journal.state``.
        usable: list[tuple[Rest, Path]] = []
        for state in states(path):
            try:
                place = header_of(state, shared).rest
                if not chain.holds(place):
                    raise StateError(f"{state}: its position is not in the journal")
                usable.append((place, state))
            except StateError as error:
                self.unusable.append(str(error))
        usable.sort(key=lambda each: (each[0].segment, each[0].at_byte), reverse=True)
        for place, state in usable:
            try:
                self.objects, self._place = read(state, shared), place
                return
            except StateError as error:
                self.unusable.append(str(error))
        if chain.readers[0].segment != 1:
            why = "; ".join(self.unusable) or "no file found"
            raise JournalError(
                f"{path}: cannot be resumed: its beginning was deleted, and no state can be "
                f"used ({why}); resume it with the version that wrote it, or start with --fresh "
                "and report the fire (the journal is then renamed)"
            )

    def rest(self) -> Rest:
        """Return the position from which to continue. Raises JournalError for a damaged line."""
        unreadable: dict[Line, str] = {}
        for reader, entry in self._chain.trusted(self._place):
            if isinstance(entry, Unreadable):
                unreadable[reader.segment, entry.line] = entry.why
            elif isinstance(entry.content, LinesSkipped):
                lines = entry.content.lines
                self.skipped |= {(segment, line): why for segment, line, why in lines}
        new = {line: why for line, why in unreadable.items() if line not in self.skipped}
        if new and not self._skip_unreadable:
            first, *others = new.values()
            also = f" and {len(others)} more ({others[0]})" if others else ""
            raise JournalError(f"{first}{SKIP}{also}{FRESH}")
        self.newly_skipped |= new
        self.skipped |= new
        return self._chain.last.rest

    def turns(
        self, handle: Callable[[AnyEvent], list[AnyCommand]]
    ) -> Iterator[tuple[AnyEvent, list[AnyCommand]]]:
        """Yield each event with the commands that ``handle`` (a method of the core) returns.

        After a skipped line, and up to the ``LinesSkipped`` that records it, the readable
        commands of the journal are yielded instead, because the live run has executed them.

        Raises JournalError if the core's commands differ from the journal's, and UnhandledLineError
        if ``handle`` raises an exception (``skip_line`` can then skip the line). After the last
        event, ``last_us`` is the latest mission time, and ``missing`` are commands of the last
        event that the journal lacks. The missing commands were not executed, because commands are
        journalled before they are executed.
        """
        sure, self.missing = True, ()
        for turn in self._turns():
            self._at = turn
            sure = isinstance(turn.event, LinesSkipped) or (sure and not turn.after_gap)
            try:
                commands = handle(turn.event)
            except Exception as error:
                raise self.unhandled(error) from error
            self.last_us = max(self.last_us, turn.event.at_us)
            if sure and None in turn.commands and not turn.gives(commands):
                sure = False
            if not sure:
                yield turn.event, turn.recorded
                continue
            if None not in turn.commands:
                self._compare(turn, commands)
            if turn.is_last:
                self.missing = tuple(commands[len(turn.commands) :])
            yield turn.event, commands

    def skips(self, at_us: int) -> LinesSkipped | None:
        """Return the event that records the lines skipped by this restart, or None."""
        lines = tuple((*line, why) for line, why in self.newly_skipped.items())
        return LinesSkipped(at_us, "service", "", lines) if lines else None

    def unhandled(self, error: Exception) -> UnhandledLineError:
        """Return the error about the line that was applied last and caused ``error``."""
        assert self._at is not None
        place = f"{self._at.reader.path}: line {self._at.line}"
        return UnhandledLineError(f"{place} cannot be handled ({in_words(error)}){SKIP}{FRESH}")

    def skip_line(self, problem: UnhandledLineError) -> None:
        """Skip the line that cannot be handled; the caller then begins again from the state.

        Raises ``problem`` unless skipping is permitted, or the line is the last event and the
        journal contains no command after it.
        """
        assert self._at is not None
        cut_off = self._at.is_last and not self._at.commands
        if not (self._skip_unreadable or cut_off):
            raise problem
        line = (self._at.reader.segment, self._at.line)
        self.newly_skipped[line] = self.skipped[line] = str(problem).partition(SKIP)[0]

    def _compare(self, turn: _Turn, commands: list[AnyCommand]) -> None:
        """Raise JournalError if the journal's commands differ from ``commands``."""
        for number, found in enumerate(turn.commands):
            assert found is not None
            reader, entry = found
            difference = difference_of(entry, commands[number : number + 1])
            if difference is not None:
                raise self._differs(reader.path, difference)
        if len(commands) > len(turn.commands) and not turn.is_last:
            after = Entry(turn.line + len(turn.commands) + 1, turn.event, True, True)
            difference = difference_of(after, commands[len(turn.commands) :])
            raise self._differs(turn.reader.path, str(difference))

    def _differs(self, path: Path, difference: str) -> JournalError:
        return JournalError(
            f"{path}: cannot be resumed: {difference}; another version may have written it{FRESH}"
        )

    def _turns(self) -> Iterator[_Turn]:
        turn: _Turn | None = None
        hole = False
        for reader, entry in self._chain.trusted(self._place):
            skipped = (reader.segment, entry.line) in self.skipped
            if isinstance(entry, Unreadable):
                if not skipped:
                    raise JournalError(f"{entry.why}{SKIP}{FRESH}")
                hole = hole or turn is None
                if turn is not None:  # the line is a command of this event, or a later event
                    turn.commands.append(None)
            elif entry.is_event:
                if turn is not None:
                    yield turn
                if skipped:
                    turn, hole = None, True
                else:
                    event: AnyEvent = entry.content  # type: ignore[assignment]
                    turn, hole = _Turn(reader, entry.line, event, hole), False
            elif turn is not None:
                turn.commands.append((reader, entry))
        if turn is not None:
            turn.is_last = True
            yield turn


def unfinished(
    path: Path, shared: Known, scenario: Scenario, skip_unreadable: bool = False
) -> InterruptedRun | None:
    """Return the interrupted live run of this scenario whose journal is at ``path``, or None.

    Raises MissionServiceError for a symbolic link in place of the journal, and JournalError if the
    first line of the journal is damaged.
    """
    refuse_links(path.parent, path.stem)
    complete(path)
    if not path.exists() or _header_cut(path):
        return None
    try:
        header = SegmentReader(path).header
    except JournalError as error:
        is_burn = scenario.burn_flown is not None
        if not (is_burn or closed_segments(path) or begins_journal(path)):
            return None  # the file is not a journal; ``rename_old`` renames it
        raise JournalError(f"{error}{FRESH}") from None
    same = (
        header["scenario"] == scenario.model_dump(mode="json")
        and header["landscape_sha256"] == shared.landscape
    )
    if not same or not header.get("live") or _ended(path):
        return None
    return InterruptedRun(path, Chain(path), shared, skip_unreadable)


def rename_old(path: Path) -> Path | None:
    """Rename the journal at ``path``, so that a new journal can begin, and return the new path.

    A file without a complete header contains no entry and is deleted. Other journals are deleted
    only because of ``keep_mb``. Closed segments without a current segment are renamed too.
    """
    refuse_links(path.parent, path.stem)
    complete(path)
    if path.exists() and path.stat().st_size == 0:
        path.unlink()
    if path.exists() and _header_cut(path) and begins_journal(path):
        path.unlink()
    if not path.exists() and not closed_segments(path):
        for state in states(path):
            state.unlink()  # there is no journal for this state
        return None
    number = 1
    while (to := path.with_name(f"{path.stem}-{number}{path.suffix}")).exists() or closed_segments(
        to
    ):
        number += 1
    move(path, to)
    return to


def resumed(last_us: int, down_s: float) -> Resumed:
    """Return the event of a restart, whose mission time includes the pause of ``down_s``."""
    down_s = max(0.0, down_s)
    return Resumed(last_us + round(down_s * 1e6), "service", "", round(down_s, 3))


def _header_cut(path: Path) -> bool:
    """Return whether the run was killed before the header of the journal was complete."""
    with path.open("rb") as file:
        return not file.readline().endswith(b"\n")


def _ended(path: Path) -> bool:
    """Return whether the last line marks a regular end; reads only the end of the file."""
    with path.open("rb") as file:
        file.seek(0, 2)
        file.seek(max(0, file.tell() - 200))
        tail = file.read()
    last = tail[:-1].rpartition(b"\n")[2]
    return tail.endswith(b"\n") and last.startswith(b'{"end":true,')
