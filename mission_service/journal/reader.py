"""Reads the segments of a journal as one stream, the scenario, and the initial state."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

from firemodel.landscape.landscape import Landscape
from mission_service.config.rule_lookup import rules
from mission_service.config.scenario import Scenario, recorded_scenario, rule_in
from mission_service.core.core import Core
from mission_service.errors import JournalError, StateError
from mission_service.events import LinesSkipped
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_fire import landscape_of
from mission_service.fire.simulated_cameras import SimulatedCameras, cameras_of
from mission_service.journal.journal_file import Entry, SegmentReader
from mission_service.journal.segments import Chain, begin_state, journal_of, lines_skipped
from mission_service.journal.snapshot import Known, read


class JournalReader:
    """The journal of a run, from its oldest segment onwards. Raises JournalError if unreadable.

    If the first segments were deleted, the initial core and fire are those of the state that was
    saved at the beginning of the oldest existing segment.
    """

    def __init__(self, path: Path, alone: bool = False, rule: str | None = None) -> None:
        """Open a journal. With ``alone``, or for a closed segment, read only the file ``path``.

        ``rule`` replaces the journal's rule if its package is not installed.
        """
        self.path = path
        self._chain = None if alone or journal_of(path) is not None else Chain(path)
        self.readers = [SegmentReader(path)] if self._chain is None else self._chain.readers
        self._instead = rule
        self.at: tuple[SegmentReader, Entry] | None = None  # the last entry read
        self.damaged = False
        self.skipped = lines_skipped(self._lines())

    @property
    def segment(self) -> int:
        """Number of the first segment; 1 if the journal is complete."""
        return self.readers[0].segment

    @property
    def last(self) -> SegmentReader:
        """The last segment; ``cut_at_line`` is valid after all entries were read."""
        return self.readers[-1]

    @property
    def rule(self) -> str | None:
        """The planner rule of the recorded run."""
        return rule_in(self.readers[0].header["scenario"])

    @cached_property
    def scenario(self) -> Scenario:
        """The recorded scenario, with another rule only if the rule's package is not installed."""
        instead = None if self.rule in rules() else self._instead
        return recorded_scenario(self.readers[0].header["scenario"], self.path, instead)

    @cached_property
    def landscape(self) -> Landscape:
        """The landscape. Raises JournalError if it differs from that of the recorded run."""
        found, recorded = landscape_of(self.scenario), self.readers[0].header["landscape_sha256"]
        if found.digest() != recorded:
            raise JournalError(
                f"{self.path}: the landscape differs from that of the journal "
                f"(sha256 {found.digest()[:12]}…, recorded {recorded[:12]}…); "
                "replay the journal on a machine with the same rasters"
            )
        return found

    def entries(self) -> Iterator[tuple[SegmentReader, Entry]]:
        """Yield each line with its segment. Raises JournalError for an unreadable line."""
        self.at = None
        for found in self._entries():
            self.at = found
            yield found

    def _entries(self) -> Iterator[tuple[SegmentReader, Entry]]:
        """Yield entries without the lines that restarts skipped.

        Entries between a skipped line and the next ``LinesSkipped`` are not ``sure``.
        """
        sure = True
        for reader, number, body, intact in self._lines():
            if (reader.segment, number) in self.skipped:
                sure = False
                continue
            entry = reader.entry(number, body, intact)
            sure = sure or isinstance(entry.content, LinesSkipped)
            yield reader, entry if sure else replace(entry, sure=False)

    def _lines(self) -> Iterator[tuple[SegmentReader, int, bytes, bool]]:
        if self._chain is not None:
            yield from self._chain.lines(self._chain.begin)
        else:
            yield from ((self.last, *line) for line in self.last.lines(self.last.begin))

    def intact(self) -> Iterator[tuple[SegmentReader, Entry]]:
        """Yield ``entries``; for an altered line this also raises JournalError."""
        for reader, entry in self.entries():
            if not entry.intact:
                raise JournalError(
                    f"{reader.path}: line {entry.line} was altered; see replay --verify"
                )
            yield reader, entry

    def readable(self) -> Iterator[tuple[SegmentReader, Entry]]:
        """Yield ``entries`` up to the first unreadable line, which sets ``damaged``."""
        try:
            yield from self.entries()
        except JournalError:
            self.damaged = True

    @property
    def cut_off(self) -> bool:
        """Whether commands of the last event may be missing; valid after all entries were read."""
        killed = bool(self.last.header.get("live")) and not self.last.ended
        return killed or self.damaged or self.last.cut_at_line is not None

    def place(self, reader: SegmentReader, entry: Entry) -> str:
        """Return the number of a line as text, with the segment if the journal has several."""
        line = f"line {entry.line}"
        return line if len(self.readers) == 1 else f"{reader.path.name}, {line}"

    def core(self) -> Core:
        """Return the core in its initial state."""
        if self.segment == 1:
            return Core(self.scenario, self.landscape)
        core: Core = self._state()["core"]
        return core

    def cameras(self) -> SimulatedCameras | None:
        """Return the cameras of the simulated fire in their initial state; None without a fire."""
        if self.segment == 1:
            return cameras_of(self.scenario, self.landscape)
        cameras: SimulatedCameras | None = self._state()["cameras"]
        return cameras

    def estimate(self) -> RunEstimate:
        """Return the estimate in its initial state."""
        if self.segment == 1:
            return RunEstimate(self.scenario, self.landscape)
        estimate: RunEstimate = self._state()["estimate"]
        return estimate

    def _state(self) -> dict[str, Any]:
        journal = journal_of(self.path) or self.path
        try:
            state = begin_state(journal, self.segment)
            return read(state, Known(self.scenario, self.landscape))
        except StateError as error:
            raise JournalError(
                f"{journal}: segment {self.segment} cannot be replayed: {error}"
            ) from None
