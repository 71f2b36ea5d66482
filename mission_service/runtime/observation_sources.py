"""Stores what each source of observations contributes to a run; derives source states. Pure.

A source is the camera of a vehicle, a sensor of the scenario, a detector that sends reports under
its own name, or a person. Corrections and windows of the estimate are not observations.
"""

import hashlib
import math
import statistics
from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec

from firemodel.assimilation.observation import UNBURNED, UNSEEN
from firemodel.landscape.landscape import Landscape
from mission_service.events import AnyEvent, FireObserved, Observed, Place, RasterObserved
from mission_service.fire.correction_log import drawn_shape
from mission_service.fire.observed_window import LETTERS, in_letters
from mission_service.fire.raster_cells import raster_cells
from mission_service.fire.reported_observations import STATES, TAK, TAK_STATION, sender_of
from mission_service.fire.sensors import STATION as SENSORS
from mission_service.runtime.published_states import SourceKind, SourceState, SourceStatus

# A source is late if its last observation is older than both LATE_INTERVALS usual intervals and
# LATE_S, and silent if the observation is older than both SILENT limits. A source without a usual
# interval is neither late nor silent.
LATE_INTERVALS, LATE_S = 3.0, 60.0
SILENT_INTERVALS, SILENT_S = 10.0, 300.0
MIN_INTERVALS, MAX_INTERVALS = 2, 15  # the usual interval is the median of the last intervals
MAX_REPORTERS = 32  # detectors and people; a new one replaces the one with the oldest report
FOOTPRINT_EVERY_S = 10.0  # shortest interval between two stored footprints of a source
MAX_DIGESTS = 1000  # stored digests of the latest reports by people
MAX_FOOTPRINTS, MAX_FOOTPRINT_CELLS = 64, 1_000_000  # limits for all sources combined
DISTRUSTED = "its observations contradict those of others and are not used"


class Footprint(NamedTuple):
    """A stored observation. ``number`` counts the run's observations from 1."""

    number: int
    source: str
    event: Observed | FireObserved

    @property
    def at_us(self) -> int:
        """The mission time of the observation."""
        return _time_us(self.event)

    @property
    def cells(self) -> int:
        """The number of cells in a window, or of positions in a report."""
        event = self.event
        if isinstance(event, FireObserved):
            return len(event.points)
        return len(event.cells) * len(event.cells[0]) if event.cells else 0


@dataclass
class Contribution:
    """The observations of one source, which is listed from mission time ``since_us``."""

    kind: SourceKind
    since_us: int
    observations: int = 0
    not_used: int = 0  # observations that contradicted other sources
    burned_cells: int = 0
    unburned_cells: int = 0
    last_us: int | None = None  # mission time of the latest observation
    position_sd_m: float | None = None  # of the last observation received
    distrusted: bool = False
    intervals_us: deque[int] = field(default_factory=lambda: deque(maxlen=MAX_INTERVALS))
    stored_us: int | None = None  # time of the last stored footprint

    @property
    def usual_interval_s(self) -> float | None:
        """The median interval in s between observations at different times; None if unknown."""
        if len(self.intervals_us) < MIN_INTERVALS:
            return None
        return statistics.median(self.intervals_us) / 1e6

    def add_observation(self, event: Observed | FireObserved, burned: int, unburned: int) -> None:
        """Add an observation with its numbers of burned and unburned cells."""
        self.observations += 1
        self.burned_cells += burned
        self.unburned_cells += unburned
        self.position_sd_m = event.position_sd_m
        self.distrusted = isinstance(event, Observed) and event.distrusted
        self.not_used += self.distrusted
        at_us = _time_us(event)
        if self.last_us is not None and at_us > self.last_us:
            self.intervals_us.append(at_us - self.last_us)
        self.last_us = at_us if self.last_us is None else max(self.last_us, at_us)


class ObservationSources:
    """The contribution of each source, and the latest footprints of all sources."""

    def __init__(self, landscape: Landscape, sensors: Collection[str], at_us: int) -> None:
        """Begin at ``at_us`` with the scenario's sensors and without observations."""
        self._landscape, self._sensors = landscape, frozenset(sensors)
        self.contributions = {name: Contribution("sensor", at_us) for name in sensors}
        self.footprints: deque[Footprint] = deque()
        self._digests: dict[bytes, None] = {}  # the latest reports by people, oldest first
        self._stored_cells = 0
        self._number = 0  # number of observations

    def apply(self, event: AnyEvent) -> None:
        """Process an event of the run."""
        if isinstance(event, FireObserved | RasterObserved):
            seen = (
                _window_of(event, self._landscape) if isinstance(event, RasterObserved) else event
            )
            if event.station == SENSORS and event.by in self._sensors:
                self._add(seen, event.by, "sensor")
            else:
                of_detector = event.source or event.role == "observe"
                self._add(seen, sender_of(event), "detector" if of_detector else "person")
                if isinstance(event, FireObserved) and not of_detector:
                    self._store_digest(event)
        elif isinstance(event, Observed) and not (event.corrects or event.estimated):
            kind: SourceKind = "sensor" if event.source else "camera"
            self._add(event, event.source or event.vehicle, kind)

    def has_report(self, digest: bytes) -> bool:
        """Return whether a person has sent a report with this digest, even before a restart."""
        return digest in self._digests

    def _store_digest(self, event: FireObserved) -> None:
        digest = report_digest(event.station, event.state, event.shape, event.points)
        self._digests.pop(digest, None)
        self._digests[digest] = None
        if len(self._digests) > MAX_DIGESTS:
            del self._digests[next(iter(self._digests))]

    def _add(self, event: Observed | FireObserved, source: str, kind: SourceKind) -> None:
        if source not in self.contributions:
            self._make_room(kind)
            self.contributions[source] = Contribution(kind, event.at_us)
        found = self.contributions[source]
        found.add_observation(event, *self._cells_seen(event))
        self._number += 1
        at_us = _time_us(event)
        if found.stored_us is None or abs(at_us - found.stored_us) >= 1e6 * FOOTPRINT_EVERY_S:
            found.stored_us = at_us
            self._store(Footprint(self._number, source, event))

    def _make_room(self, kind: SourceKind) -> None:
        """Remove the reporter with the oldest report if a new reporter would exceed the limit."""
        reporters = {
            name: each.last_us or 0
            for name, each in self.contributions.items()
            if each.kind in ("detector", "person")
        }
        if kind in ("detector", "person") and len(reporters) >= MAX_REPORTERS:
            del self.contributions[min(reporters, key=lambda name: (reporters[name], name))]

    def _store(self, footprint: Footprint) -> None:
        """Store a footprint, and remove the oldest footprints beyond the limits."""
        self.footprints.append(footprint)
        self._stored_cells += footprint.cells
        while len(self.footprints) > MAX_FOOTPRINTS or self._stored_cells > MAX_FOOTPRINT_CELLS:
            self._stored_cells -= self.footprints.popleft().cells

    def _cells_seen(self, event: Observed | FireObserved) -> tuple[int, int]:
        """Return the numbers of burned and unburned cells in an observation.

        For a report the numbers follow from the length of the line or the area of the polygon.
        """
        if isinstance(event, Observed):
            return (
                sum(row.count("b") for row in event.cells),
                sum(row.count("u") for row in event.cells),
            )
        state = STATES[event.state]
        if state == UNSEEN:
            return 0, 0
        cells, cell_m = len(event.points), self._landscape.cell_size_m
        if event.shape != "points":
            drawn = drawn_shape(event, self._landscape)
            size = drawn.length / cell_m if event.shape == "line" else drawn.area / cell_m**2
            cells = max(round(size), 1) if math.isfinite(size) else 0  # 0 outside the projection
        return (0, cells) if state == UNBURNED else (cells, 0)

    def states(
        self,
        now_us: int,
        problems: Mapping[str, str],
        contradictions: Mapping[str, str],
        failed: Collection[str],
    ) -> list[SourceState]:
        """Return the state of each source at the given mission time, ordered by name.

        Args:
            now_us: The mission time.
            problems: The texts for sensors that report a problem or have failed, by source.
            contradictions: The texts for sources that contradict others, by source.
            failed: The sensors that have failed.
        """
        found = []
        for source, each in sorted(self.contributions.items()):
            status, problem = status_of(each, now_us)
            texts = [text for name, text in contradictions.items() if _is_of(name, source)]
            if texts or each.distrusted:
                status, problem = "contradicts", texts[0] if texts else DISTRUSTED
            if source in problems:
                problem = problems[source]
                status = "failed" if source in failed else status
            found.append(_state(source, each, now_us, status, problem))
        return found


def report_digest(station: str, state: str, shape: str, points: tuple[Place, ...]) -> bytes:
    """Return a digest of a report: station, state, shape and places (lat_deg, lon_deg)."""
    return hashlib.sha256(msgspec.json.encode((station, state, shape, points))).digest()


def status_of(source: Contribution, now_us: int) -> tuple[SourceStatus, str]:
    """Return a source's status at the given mission time, and why it is late or silent.

    A person is never late. A sensor without any observation is ``waiting``, then ``silent`` after
    ``SILENT_S``.
    """
    if source.last_us is None:
        if (now_us - source.since_us) / 1e6 <= SILENT_S:
            return "waiting", ""
        return "silent", "no observation since the start"
    interval_s = source.usual_interval_s
    if source.kind == "person" or interval_s is None:
        return "live", ""
    age_s = (now_us - source.last_us) / 1e6
    silent_s = max(SILENT_INTERVALS * interval_s, SILENT_S)
    late_s = max(LATE_INTERVALS * interval_s, LATE_S)
    if age_s <= late_s:
        return "live", ""
    usual = f"usually one every {interval_s:.3g} s"
    if age_s <= silent_s:
        return "late", f"no observation for more than {late_s:.0f} s; {usual}"
    return "silent", f"no observation for more than {silent_s:.0f} s; {usual}"


def _state(
    source: str, found: Contribution, now_us: int, status: SourceStatus, problem: str
) -> SourceState:
    last_us, interval_s = found.last_us, found.usual_interval_s
    return SourceState(
        now_us,
        source,
        found.kind,
        status,
        problem,
        found.observations,
        found.not_used,
        found.burned_cells,
        found.unburned_cells,
        last_us,
        None if last_us is None else round((now_us - last_us) / 1e6, 1),
        None if interval_s is None else round(interval_s, 1),
        None if found.position_sd_m is None else round(found.position_sd_m, 2),
    )


def _time_us(event: Observed | FireObserved) -> int:
    """Return the mission time at which an observation was made."""
    return event.seen_at_us if isinstance(event, FireObserved) else event.at_us


def _window_of(event: RasterObserved, landscape: Landscape) -> Observed:
    """Return the landscape's cells that a raster covers, as an observation."""
    top, left, state = raster_cells(event, landscape)
    cells = in_letters(LETTERS[state]) if state.size else ()
    return Observed(event.seen_at_us, "", top, left, cells, position_sd_m=event.position_sd_m)


def _is_of(name: str, source: str) -> bool:
    """Return whether the estimate's name for a sender (``compared_source``) refers to a source."""
    is_tak_user = name == TAK and f" at {TAK_STATION}" in source
    return is_tak_user or name == source or name.endswith(f" of {source}")
