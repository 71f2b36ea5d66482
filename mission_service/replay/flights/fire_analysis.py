"""Analyses the fire of a journal and its observation by replaying the run.

The events pass through a fresh core, so that the planners' estimates at each time are available,
and the fire is simulated again.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from mission_service.commands import AnyCommand, UploadMission
from mission_service.config.scenario import Scenario
from mission_service.events import (
    AnyEvent,
    LinkLost,
    Observed,
    Telemetry,
    UploadFinished,
)
from mission_service.fire.setup import fire_position
from mission_service.guidance.fire_map import BEARINGS, FireMap, window_codes
from mission_service.guidance.registry import way_of
from mission_service.journal.reader import JournalReader
from mission_service.replay.distance_error import TrueShape
from mission_service.replay.flights.journal_log import JournalLog
from mission_service.runtime.run_statistics import RunStatistics

Floats = NDArray[np.float64]

SAMPLE_US = 30_000_000
RECENT_S = 600.0  # a part of the front observed within ten minutes is covered
VISIT_S = 30.0  # observations with shorter gaps are one visit


@dataclass(slots=True)
class Upload:
    """A mission that was sent: the reason, the outcome and its time."""

    vehicle: str
    at_us: int
    why: str
    items: int
    outcome: str = "under way"
    finished_us: int | None = None


@dataclass(frozen=True, slots=True)
class Sample:
    """The front observed by a time; ages of the observations on 360 bearings."""

    at_us: int
    area_ha: float
    seen_share: float
    recent_share: float
    age_mean_s: float
    age_worst_s: float


@dataclass
class FireAnalysis:
    """A run's fire, its observation, and the planners' decisions."""

    scenario: Scenario
    landscape: Landscape
    record: RunStatistics
    open_loop: bool  # of a logged flight: no mission was sent, none flown
    centre: tuple[float, float] | None = None  # lat_deg, lon_deg of the fire that was reported
    area_ha: float = 0.0  # burned at the end
    arrival_s: Floats = field(default_factory=lambda: np.empty((0, 0)))
    samples: list[Sample] = field(default_factory=list)
    errors_m: dict[str, list[tuple[int, float, float]]] = field(default_factory=dict)
    revisits_s: list[float] = field(default_factory=list)
    ways: dict[str, list[tuple[int, bool | None]]] = field(default_factory=dict)
    uploads: list[Upload] = field(default_factory=list)

    @property
    def follows_front(self) -> bool:
        """Whether its planners fly along a front."""
        return way_of(self.scenario).along_front


def fire_analysis(log: JournalLog) -> FireAnalysis:
    """Replay a journal. Raises JournalError if its landscape is not available here.

    Damaged parts of the journal are left out; the log's ``damage`` lists them.
    """
    return _Telling(log, JournalReader(log.path)).story()


class _Telling:
    """One pass over a journal."""

    def __init__(self, log: JournalLog, recorded: JournalReader) -> None:
        scenario, landscape = log.scenario, recorded.landscape
        self._log = log
        self._landscape = landscape
        self._core = recorded.core()
        self._fire = recorded.fire()
        start_us = round(scenario.start_s * 1e6)
        record = RunStatistics(tuple(each.name for each in scenario.vehicles), start_us)
        self._analysis = FireAnalysis(scenario, landscape, record, log.open_loop)
        self._due_us = start_us
        self._sent: dict[tuple[str, int], Upload] = {}
        self._believed: list[tuple[int, str, Floats]] = []
        self._centre: tuple[float, float] | None = None
        self._map: FireMap | None = None
        if scenario.burn_flown is None:
            row, col = landscape.row_col_of(*fire_position(scenario, landscape))
            self._centre = (float(round(float(row))), float(round(float(col))))
            lat, lon = landscape.lat_lon_of(*landscape.xy_of(*self._centre))
            self._analysis.centre = (float(lat), float(lon))
            self._map = FireMap(landscape.shape, *self._centre, 0.0, 0.0)
        self._seen_s = np.full(BEARINGS, np.nan)

    def story(self) -> FireAnalysis:
        """Return the analysis of the whole journal."""
        at_us = self._due_us
        for event in self._events():
            at_us = max(at_us, event.at_us)
            commands = self._core.handle(event)
            self._fire.apply_history(event, commands)
            self._analysis.record.apply(event, commands)
            self._analysis.record.announcements.clear()
            self._note(event, commands)
            if at_us >= self._due_us:
                self._due_us = at_us - at_us % SAMPLE_US + SAMPLE_US
                self._sample(at_us)
        self._fire.world.advance(at_us)
        self._sample(at_us)
        self._compare()
        return self._analysis

    def _events(self) -> Iterator[AnyEvent]:
        return (each for each in self._log.things() if isinstance(each, AnyEvent))

    def _note(self, event: AnyEvent, commands: list[AnyCommand]) -> None:
        match event:
            case Observed() if self._map is not None:
                self._look(event)
            case Telemetry() | LinkLost():
                self._way(event.vehicle, event.at_us)
            case UploadFinished():
                sent = self._sent.pop((event.vehicle, event.mission_id), None)
                if sent is not None:
                    sent.outcome, sent.finished_us = event.outcome, event.at_us
            case _:
                pass
        for command in commands:
            if isinstance(command, UploadMission):
                name = command.vehicle
                sent = Upload(name, event.at_us, command.why, len(command.items))
                self._sent[name, command.mission_id] = sent
                self._analysis.uploads.append(sent)

    def _look(self, seen: Observed) -> None:
        """Note the bearings of the front in view; a bearing seen again after a gap is a visit."""
        assert self._map is not None
        window, at_s = window_codes(seen.cells), seen.at_us / 1e6
        if seen.corrects:
            self._map.correct(seen.row, seen.col, window, at_s)
            return
        in_view = self._map.observe(seen.row, seen.col, window, at_s)
        away_s = at_s - self._seen_s[in_view]
        self._analysis.revisits_s += away_s[away_s >= VISIT_S].tolist()
        self._seen_s[in_view] = at_s

    def _way(self, name: str, at_us: int) -> None:
        """Note the direction decided by the vehicle's planner whenever it changes."""
        planner: Any = self._core.decision_engine.planners[name]
        phase = getattr(planner, "phase", "approach")
        flies = self._core.decision_engine.availability[name].flies
        way = planner.clockwise if flies and phase != "approach" else None
        ways = self._analysis.ways.setdefault(name, [])
        if (ways[-1][1] if ways else None) is not way:
            ways.append((at_us, way))

    def _sample(self, at_us: int) -> None:
        self._fire.world.advance(at_us)
        age_s = at_us / 1e6 - self._seen_s[~np.isnan(self._seen_s)]
        if age_s.size:
            seen = age_s.size / BEARINGS
            recent = np.count_nonzero(age_s <= RECENT_S) / BEARINGS
            known = (seen, float(recent), float(age_s.mean()), float(age_s.max()))
            self._analysis.samples.append(Sample(at_us, self._fire.world.fire.burned_ha, *known))
        if not self._analysis.follows_front:
            return
        for name, availability in self._core.decision_engine.availability.items():
            planner: Any = self._core.decision_engine.planners[name]
            fix = availability.fix
            if fix is None or not availability.flies or planner.phase == "approach":
                continue
            shape = planner.shape(fix.row, fix.col)
            if np.isfinite(shape).all():
                self._believed.append((at_us, name, shape.copy()))

    def _compare(self) -> None:
        """Compare estimated and true front: mean and greatest distance, in metres."""
        story = self._analysis
        fire = self._fire.world.fire
        story.area_ha = fire.burned_ha
        story.arrival_s = np.where(fire.burned(), fire.arrival_time_s, np.inf)
        if self._centre is None or not self._believed:
            return
        truth = TrueShape(story.arrival_s, (round(self._centre[0]), round(self._centre[1])))
        for at_us, name, shape in self._believed:
            off_m = np.abs(shape - truth.at(at_us / 1e6)) * self._landscape.cell_size_m
            told = (at_us, float(off_m.mean()), float(off_m.max()))
            story.errors_m.setdefault(name, []).append(told)
