"""Analyses the fire in a journal, and its observation, by replaying the run.

A new core processes the events, so that the planners' estimates at each time are available. The
fire is simulated again.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from firemodel.spread.fire_scheme import Fire
from mission_service.commands import Announce, AnyCommand, UploadMission
from mission_service.config.scenario import Scenario
from mission_service.events import (
    AnyEvent,
    FireReachedEdge,
    LinesSkipped,
    LinkLost,
    Observed,
    OperatorEvent,
    Telemetry,
    UploadFinished,
)
from mission_service.fire.observed_window import states_in, without_speckles
from mission_service.fire.scenario_fire import fire_position, warnings_on
from mission_service.fire.simulated_cameras import fires_of_run
from mission_service.guidance.fire_map import BEARINGS, FireMap
from mission_service.guidance.registry import way_of
from mission_service.journal.reader import JournalReader
from mission_service.operator_lines import operator_line
from mission_service.replay.distance_error import TrueShape
from mission_service.replay.flights.journal_log import JournalLog
from mission_service.runtime.observation_sources import ObservationSources
from mission_service.runtime.run_statistics import RunStatistics
from mission_service.runtime.state_view import edge_text

Floats = NDArray[np.float64]

SAMPLE_US = 30_000_000
RECENT_S = 600.0  # a part of the front observed within this time counts as covered
VISIT_S = 30.0  # observations with shorter gaps belong to the same visit


@dataclass(slots=True)
class Upload:
    """A mission that was sent, with its reason, its outcome and the time of the outcome."""

    vehicle: str
    at_us: int
    why: str
    items: int
    outcome: str = "under way"
    finished_us: int | None = None


@dataclass(frozen=True, slots=True)
class Sample:
    """The front's coverage at one time: fractions of 360 bearings, and times since observation."""

    at_us: int
    area_ha: float
    seen_share: float
    recent_share: float
    age_mean_s: float
    age_worst_s: float


class LogLine(NamedTuple):
    """An announcement, or an operator's change; mission time."""

    at_us: int
    vehicle: str
    text: str
    by_operator: bool


@dataclass
class FireAnalysis:
    """A run's fire, its observation, and the planners' decisions."""

    scenario: Scenario
    landscape: Landscape
    record: RunStatistics
    open_loop: bool  # a replay of a logged flight, in which no mission was sent or flown
    centre: tuple[float, float] | None = None  # lat_deg, lon_deg of the reported fire
    area_ha: float = 0.0  # area burned at the end
    arrival_s: Floats = field(default_factory=lambda: np.empty((0, 0)))
    samples: list[Sample] = field(default_factory=list)
    errors_m: dict[str, list[tuple[int, float, float]]] = field(default_factory=dict)
    revisits_s: list[float] = field(default_factory=list)
    directions: dict[str, list[tuple[int, bool | None]]] = field(default_factory=dict)
    uploads: list[Upload] = field(default_factory=list)
    log: list[LogLine] = field(default_factory=list)
    # Warnings about the scenario, then about fire at the landscape's edge.
    warnings: list[str] = field(default_factory=list)
    reached_edge_us: int | None = None  # mission time of the event ``FireReachedEdge``

    @property
    def follows_front(self) -> bool:
        """Whether the scenario's planners fly along a front."""
        return way_of(self.scenario).along_front


def circles_one_front(scenario: Scenario) -> bool:
    """Return whether a scenario's planners fly around one front, without its bays and fingers.

    Other planners fly from front to front, and along bays, in any direction around the fire.
    """
    way = way_of(scenario)
    return way.along_front and not way.reads_fronts


def fire_analysis(log: JournalLog) -> FireAnalysis:
    """Replay a journal. Raises JournalError if its landscape is not available.

    Damaged parts of the journal are skipped; the log's ``damage`` lists them.
    """
    return _Analyser(log, JournalReader(log.path)).analyse()


class _Analyser:
    """One pass over a journal."""

    def __init__(self, log: JournalLog, recorded: JournalReader) -> None:
        scenario, landscape = recorded.scenario, recorded.landscape
        self._log = log
        self._landscape = landscape
        self._core = recorded.core()
        self._cameras, self._estimate = recorded.cameras(), recorded.estimate()
        start_us = round(scenario.start_s * 1e6)
        sources = ObservationSources(landscape, scenario.estimate.sensors, start_us)
        record = RunStatistics(tuple(each.name for each in scenario.vehicles), start_us, sources)
        self._analysis = FireAnalysis(scenario, landscape, record, log.open_loop)
        self._analysis.warnings += warnings_on(scenario, landscape)
        self._due_us = start_us
        self._sent: dict[tuple[str, int], Upload] = {}
        self._estimates: list[tuple[int, str, Floats]] = []
        self._centre: tuple[float, float] | None = None
        self._map: FireMap | None = None
        if scenario.burn_flown is None:
            row, col = landscape.row_col_of(*fire_position(scenario, landscape))
            self._centre = (float(round(float(row))), float(round(float(col))))
            lat, lon = landscape.lat_lon_of(*landscape.xy_of(*self._centre))
            self._analysis.centre = (float(lat), float(lon))
            self._map = FireMap(landscape.shape, *self._centre, 0.0, 0.0)
        self._seen_s = np.full(BEARINGS, np.nan)

    def analyse(self) -> FireAnalysis:
        """Return the analysis of the whole journal."""
        at_us = self._due_us
        for event, recorded in self._steps():
            at_us = max(at_us, event.at_us)
            commands = self._core.handle(event)
            commands = commands if recorded is None else recorded
            self._apply_to_fires(event, commands)
            self._analysis.record.apply(event, commands)
            self._note(event, commands)
            if at_us >= self._due_us:
                self._due_us = at_us - at_us % SAMPLE_US + SAMPLE_US
                self._sample(at_us)
        self._sample(at_us)
        self._compare(self._fire_at(at_us))
        return self._analysis

    def _steps(self) -> Iterator[tuple[AnyEvent, list[AnyCommand] | None]]:
        """Yield each event that no restart has skipped, and the commands that replace the core's.

        Between a skipped line and ``LinesSkipped``, the state of this core may differ from that of
        the live run, so the journalled commands are yielded. Elsewhere the second value is None.
        """
        event: AnyEvent | None = None
        commands: list[AnyCommand] | None = None
        is_reproducible = True
        for line, content in self._log.located():
            is_reproducible = is_reproducible and line not in self._log.skipped
            if isinstance(content, AnyEvent):
                if event is not None:
                    yield event, commands
                is_reproducible = is_reproducible or isinstance(content, LinesSkipped)
                event, commands = content, None if is_reproducible else []
            elif content is not None and commands is not None:
                commands.append(content)
        if event is not None:
            yield event, commands

    def _apply_to_fires(self, event: AnyEvent, commands: list[AnyCommand]) -> None:
        for each in fires_of_run(self._cameras, self._estimate):
            each.apply_history(event)
            for command in commands:
                each.on_command(command)

    def _fire_at(self, at_us: int) -> Fire:
        """Return the fire to evaluate: the simulated fire, or the estimate if there is none."""
        if self._cameras is not None:
            self._cameras.advance(at_us)
            return self._cameras.fire.fire
        self._estimate.advance(at_us)
        return self._estimate.fire

    def _note(self, event: AnyEvent, commands: list[AnyCommand]) -> None:
        match event:
            case Observed(distrusted=False) if self._map is not None:
                self._note_observation(event)
            case Telemetry() | LinkLost():
                self._note_direction(event.vehicle, event.at_us)
            case UploadFinished():
                sent = self._sent.pop((event.vehicle, event.mission_id), None)
                if sent is not None:
                    sent.outcome, sent.finished_us = event.outcome, event.at_us
            case FireReachedEdge():
                self._analysis.reached_edge_us = event.at_us
                self._analysis.warnings.append(edge_text(event))
            case _:
                pass
        by_operator = isinstance(event, OperatorEvent)
        if change := operator_line(event):
            self._analysis.log.append(LogLine(event.at_us, "", change, True))
        for command in commands:
            if isinstance(command, Announce):
                line = LogLine(event.at_us, command.vehicle, command.text, by_operator)
                self._analysis.log.append(line)
            if isinstance(command, UploadMission):
                name = command.vehicle
                sent = Upload(name, event.at_us, command.why, len(command.items))
                self._sent[name, command.mission_id] = sent
                self._analysis.uploads.append(sent)

    def _note_observation(self, observed: Observed) -> None:
        """Record the bearings on which the front is in view; after a gap, these are new visits."""
        assert self._map is not None
        window, at_s = states_in(without_speckles(observed).cells), observed.at_us / 1e6
        if observed.corrects:
            self._map.correct_window(observed.row, observed.col, window, at_s)
            return
        in_view = self._map.add_window(observed.row, observed.col, window, at_s)
        gap_s = at_s - self._seen_s[in_view]
        self._analysis.revisits_s += gap_s[gap_s >= VISIT_S].tolist()
        self._seen_s[in_view] = at_s

    def _note_direction(self, name: str, at_us: int) -> None:
        """Record each change in the direction chosen by the vehicle's planner."""
        planner: Any = self._core.decision_engine.planners[name]
        phase = getattr(planner, "phase", "approach")
        flies = self._core.decision_engine.availability[name].flies
        clockwise = planner.clockwise if flies and phase != "approach" else None
        directions = self._analysis.directions.setdefault(name, [])
        if (directions[-1][1] if directions else None) is not clockwise:
            directions.append((at_us, clockwise))

    def _sample(self, at_us: int) -> None:
        fire = self._fire_at(at_us)
        age_s = at_us / 1e6 - self._seen_s[~np.isnan(self._seen_s)]
        if age_s.size:
            seen = age_s.size / BEARINGS
            recent = np.count_nonzero(age_s <= RECENT_S) / BEARINGS
            shares = (seen, float(recent))
            ages_s = (float(age_s.mean()), float(age_s.max()))
            self._analysis.samples.append(Sample(at_us, fire.burned_ha, *shares, *ages_s))
        if not self._analysis.follows_front:
            return
        for name, availability in self._core.decision_engine.availability.items():
            planner: Any = self._core.decision_engine.planners[name]
            fix = availability.fix
            if fix is None or not availability.flies or planner.phase == "approach":
                continue
            shape = planner.shape(fix.row, fix.col)
            if np.isfinite(shape).all():
                self._estimates.append((at_us, name, shape.copy()))

    def _compare(self, fire: Fire) -> None:
        """Compute the mean and maximum distance in m from planners' fronts to the fire front."""
        analysis = self._analysis
        analysis.area_ha = fire.burned_ha
        analysis.arrival_s = fire.burned_arrival_s()
        if self._centre is None or not self._estimates:
            return
        truth = TrueShape(analysis.arrival_s, (round(self._centre[0]), round(self._centre[1])))
        for at_us, name, shape in self._estimates:
            off_m = np.abs(shape - truth.distances_at(at_us / 1e6)) * self._landscape.cell_size_m
            error = (at_us, float(off_m.mean()), float(off_m.max()))
            analysis.errors_m.setdefault(name, []).append(error)
