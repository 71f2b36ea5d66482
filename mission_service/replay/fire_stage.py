"""Recomputes every recorded observation and front of a journal by simulating the fires again.

On the machine that recorded the journal, all cells are equal. On another machine the last digits of
floats may differ, and so may cells at the edge of the fire or of a camera's footprint.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from firemodel.spread.edge import at_edge
from mission_service.events import (
    Aborted,
    EstimatedFront,
    FireReachedEdge,
    FrontsEstimated,
    Observed,
    Resumed,
    Telemetry,
)
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.simulated_cameras import SimulatedCameras, fires_of_run
from mission_service.journal.journal_file import Entry, SegmentReader
from mission_service.journal.reader import JournalReader
from mission_service.replay.replay_stage import Stage

ARRIVAL_WITHIN_S = 1.0
EDGE_WITHIN_CELLS = 1e-6
FRONT_WITHIN_CELLS = 0.05
UNSEEN = "."

Cell = tuple[int, int]  # row, col
Source = SimulatedCameras | RunEstimate  # sources of images


def fire_stage(recorded: JournalReader) -> Stage:
    """Recompute every observation from the position that follows it."""
    comparison = _Comparison(recorded)
    for reader, entry in recorded.readable():
        comparison.read_entry(reader, entry)
        comparison.burn(entry)
    return comparison.stage()


class _Comparison:
    """A comparison of recorded observations with recomputed observations, entry by entry."""

    def __init__(self, recorded: JournalReader) -> None:
        self._recorded = recorded
        self._cameras, self._estimate = recorded.cameras(), recorded.estimate()
        kinds = ("observations", "cells", "within tolerance", "beyond tolerance")
        self._counts = dict.fromkeys(kinds, 0)
        self._without_position = 0
        self._unsure = 0  # observations between a skipped line and the restart
        # An observation whose position has not been read yet, with its line number as text.
        self._pending: tuple[str, Observed] | None = None
        # Fronts whose position has not been read yet.
        self._fronts: tuple[str, FrontsEstimated] | None = None
        self._difference: str | None = None  # the first difference
        self._details: list[dict[str, Any]] = []

    def read_entry(self, reader: SegmentReader, entry: Entry) -> None:
        """Process an entry: store an observation, or compare it when its position is read."""
        content = entry.content
        if not entry.sure:  # the fire of the live run may have differed
            self._without_position += self._pending is not None
            self._pending = None
        match content:
            case Observed(corrects=False) if not entry.sure:
                self._unsure += 1
            case Observed(corrects=False) if self._source(content) is not None:
                if self._pending is not None:
                    self._position_missing(*self._pending)
                self._pending = (self._recorded.place(reader, entry), content)
            case FrontsEstimated() if entry.sure:
                self._fronts = (self._recorded.place(reader, entry), content)
            case Telemetry():
                self._read_position(entry, content)
            case FireReachedEdge() if entry.sure and entry.intact:
                self._compare_edge(self._recorded.place(reader, entry), content)
            case Resumed() | Aborted() if self._pending:  # the position was not journalled
                self._without_position, self._pending = self._without_position + 1, None
            case _:
                pass

    def _read_position(self, entry: Entry, fix: Telemetry) -> None:
        """Compare the observation and the fronts that were computed at a position."""
        if self._pending and self._pending[1].vehicle == fix.vehicle:
            (place, recorded), self._pending = self._pending, None
            if not entry.intact:
                self._without_position += 1
            elif recorded.at_us != fix.at_us:
                self._position_missing(place, recorded)
            else:
                self._compare(place, recorded, fix)
        if self._fronts and self._fronts[1].vehicle == fix.vehicle:
            (place, fronts), self._fronts = self._fronts, None
            if entry.intact and fronts.at_us == fix.at_us:
                self._compare_fronts(place, fronts, fix)

    def burn(self, entry: Entry) -> None:
        """Apply the entry to the simulated fire, if there is one, and to the estimate."""
        for fire in fires_of_run(self._cameras, self._estimate):
            if entry.is_event:
                fire.apply_history(entry.content)  # type: ignore[arg-type]
            else:
                fire.on_command(entry.content)  # type: ignore[arg-type]

    def stage(self) -> Stage:
        """Return the result after the last entry."""
        without = self._without_position + (self._pending is not None)
        counts = self._counts
        exact = not counts["within tolerance"] and not counts["beyond tolerance"]
        note = [
            "all cells equal" if exact else "the journal may have been recorded on another machine"
        ]
        note += [f"{without} observations without a position"] if without else []
        if self._unsure:
            note.append(f"{self._unsure} observations after a skipped line were not compared")
        return Stage("fire", counts, self._difference, self._details, "; ".join(note))

    def _source(self, image: Observed) -> Source | None:
        """Return the fire that an image shows: the estimate, or the simulated fire (or None)."""
        return self._estimate if image.estimated else self._cameras

    def _compare(self, place: str, recorded: Observed, fix: Telemetry) -> None:
        source = self._source(recorded)
        assert source is not None
        again = source.seen_from(fix)
        self._counts["observations"] += 1
        self._counts["cells"] += sum(len(row) - row.count(UNSEEN) for row in recorded.cells)
        for cell in () if again == recorded else _cells(recorded, again, fix, source):
            beyond = cell.pop("beyond")
            self._counts["beyond tolerance" if beyond else "within tolerance"] += 1
            if beyond:
                self._differs(f"{place}: {_in_words(recorded, cell)}", cell)

    def _compare_fronts(self, place: str, recorded: FrontsEstimated, fix: Telemetry) -> None:
        again = self._estimate.fronts_at(fix)
        if again == recorded:
            return
        near = again is not None and _are_near(again.fronts, recorded.fronts)
        self._counts["within tolerance" if near else "beyond tolerance"] += 1
        if not near:
            self._differs(f"{place}: the fronts of the estimate differ in the replay")

    def _compare_edge(self, place: str, recorded: FireReachedEdge) -> None:
        self._estimate.advance(recorded.at_us)
        again, arrived_s = at_edge(self._estimate.fire), recorded.arrived_at_us / 1e6
        if again is None or abs(again.at_s - arrived_s) > ARRIVAL_WITHIN_S:
            replay = "does not reach it" if again is None else f"reaches it at {again.at_s:.3f} s"
            words = f"the recorded estimate reaches the edge at {arrived_s:.3f} s"
            self._differs(f"{place}: {words}; in the replay it {replay}")

    def _position_missing(self, place: str, recorded: Observed) -> None:
        self._differs(f"{place}: no position of {recorded.vehicle} with the same time follows")

    def _differs(self, words: str, *cells: dict[str, Any]) -> None:
        if self._difference is None:
            self._difference = words
            self._details.extend(cells)


def _cells(
    recorded: Observed, again: Observed | None, fix: Telemetry, source: Source
) -> Iterator[dict[str, Any]]:
    """Yield each cell that differs, and whether the difference exceeds the tolerance."""
    before, after = _letters(recorded), _letters(again)
    at_s = recorded.at_us / 1e6
    edge: set[Cell] | None = None
    for cell in sorted(before | after):
        journal, replay = before.get(cell, UNSEEN), after.get(cell, UNSEEN)
        if journal == replay:
            continue
        arrival_s = source.arrival_s(*cell)
        if UNSEEN in (journal, replay):
            edge = _edge(fix, source) if edge is None else edge
            near = cell in edge
        else:
            near = arrival_s is not None and abs(arrival_s - at_s) <= ARRIVAL_WITHIN_S
        yield {
            "vehicle": recorded.vehicle,
            "at_s": at_s,
            "row": cell[0],
            "col": cell[1],
            "journal": journal,
            "replay": replay,
            "arrival_s": arrival_s,
            "beyond": not (near and {journal, replay} < set("bu" + UNSEEN)),
        }


def _are_near(one: tuple[EstimatedFront, ...], other: tuple[EstimatedFront, ...]) -> bool:
    """Return whether two tuples of fronts differ only by another machine's rounding."""
    if [len(each.rows) for each in one] != [len(each.rows) for each in other]:
        return False
    return all(
        np.allclose((*a.rows, *a.cols), (*b.rows, *b.cols), atol=FRONT_WITHIN_CELLS)
        for a, b in zip(one, other, strict=True)
    )


def _letters(observed: Observed | None) -> dict[Cell, str]:
    if observed is None:
        return {}
    return {
        (observed.row + down, observed.col + right): letter
        for down, row in enumerate(observed.cells)
        for right, letter in enumerate(row)
    }


def _edge(fix: Telemetry, source: Source) -> set[Cell]:
    """Return the cells within ``EDGE_WITHIN_CELLS`` of the edge of the camera's footprint."""
    wide, narrow = (
        _letters(source.seen_from(fix, wider)) for wider in (EDGE_WITHIN_CELLS, -EDGE_WITHIN_CELLS)
    )
    inside = {cell for cell, letter in narrow.items() if letter != UNSEEN}
    return {cell for cell, letter in wide.items() if letter != UNSEEN} - inside


def _in_words(recorded: Observed, cell: dict[str, Any]) -> str:
    arrival_s = cell["arrival_s"]
    arrival = "the fire does not reach it"
    if arrival_s is not None:
        arrival = f"the fire reaches it at {arrival_s:.3f} s"
    return (
        f"{recorded.vehicle} at {cell['at_s']:.3f} s, cell row {cell['row']} col {cell['col']}: "
        f"journal has {cell['journal']!r}, replay has {cell['replay']!r}; {arrival}"
    )
