"""Analyses one run: the flight, and the fire if there is one."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.items import Items, place_of
from mission_service.ground_distance import M_PER_DEG
from mission_service.replay.flights.direction_of_travel import (
    FIRE_DEG,
    TRACK_DEG,
    Span,
    differing,
    turns,
)
from mission_service.replay.flights.drop_comparison import (
    GRIPPER,
    Compared,
    Done,
    compared,
    planned_in,
)
from mission_service.replay.flights.fire_analysis import (
    FireAnalysis,
    circles_one_front,
    fire_analysis,
)
from mission_service.replay.flights.flight_logs import Flight, Survey
from mission_service.replay.flights.flown_vehicle import Flown
from mission_service.replay.flights.journal_log import JournalLog
from mission_service.replay.flights.scenario_pairing import Mission
from mission_service.vehicles.availability import AIRBORNE_M

Floats = NDArray[np.float64]

# A reversal in the track this soon after a reversal in the mission is left out.
FOLLOWS_US = 20_000_000
# Bearings are uncertain within this radius of the centre: in cells, or as a fraction of the track.
NEAR_CELLS, NEAR_SHARE = 2.0, 0.25


@dataclass(frozen=True, slots=True)
class TurnedBack:
    """A reversal of a vehicle at ``at_us`` on the log's clock; ``how`` describes the evidence."""

    at_us: int
    lat_deg: float
    lon_deg: float
    how: str


@dataclass
class VehicleAnalysis:
    """One vehicle's flight; times are on the log's clock."""

    flown: Flown
    track: Floats  # (n, 4): at_us, lat_deg, lon_deg, altitude_amsl_m
    terrain_amsl_m: Floats | None = None  # terrain under the track; NaN off the landscape
    directions: list[tuple[int, bool]] = field(default_factory=list)  # (time, is clockwise)
    turned_back: list[TurnedBack] = field(default_factory=list)
    # Directions that the vehicle's planner chose; None is unknown.
    decided: list[tuple[int, bool | None]] = field(default_factory=list)
    differs: list[Span] = field(default_factory=list)
    drops: list[Compared] = field(default_factory=list)

    @property
    def name(self) -> str:
        """The name of the vehicle."""
        return self.flown.name

    def place_at(self, at_us: int) -> tuple[float, float]:
        """Return the vehicle's position (lat_deg, lon_deg), interpolated along its track."""
        times = self.track[:, 0]
        lat = np.interp(at_us, times, self.track[:, 1])
        return float(lat), float(np.interp(at_us, times, self.track[:, 2]))


@dataclass
class RunAnalysis:
    """A run. ``mission.of(at_us)`` converts a time on the log's clock to mission time.

    The flight begins at ``zero_us``, and the analysed part at ``begin_us``.
    """

    name: str
    logs: list[str]
    damage: list[str]
    zero_us: int
    begin_us: int
    end_us: int
    offset_us: int | None
    vehicles: dict[str, VehicleAnalysis]
    mission: Mission
    fire: FireAnalysis | None = None

    def since_s(self, at_us: int) -> float:
        """Return the seconds from the start of the flight to a time on the log's clock."""
        return (at_us - self.zero_us) / 1e6

    def log_us(self, mission_us: int) -> int:
        """Convert a mission time to the log's clock."""
        return self.mission.log_us(mission_us)


def run_analysis(
    name: str,
    flight: Flight,
    found: Survey,
    journal: JournalLog | None = None,
    mission: Mission | None = None,
) -> RunAnalysis:
    """Analyse a flight, and the fire in its journal or in the journal of its open-loop replay."""
    fire = None if journal is None else fire_analysis(journal)
    mission = mission or Mission(found.zero_us, found.zero_us)
    times_us = (found.zero_us, found.begin_us, found.end_us, found.offset_us)
    logs = [str(log.path) for log in flight.logs]
    run = RunAnalysis(name, logs, list(found.damage), *times_us, {}, mission, fire)
    for each, flown in found.flown.items():
        run.vehicles[each] = _vehicle(flown, run)
    return run


def _vehicle(flown: Flown, run: RunAnalysis) -> VehicleAnalysis:
    track = np.array([list(point) for point in flown.track]).reshape(-1, 4)
    analysis = VehicleAnalysis(flown, track)
    if not len(track):
        return analysis
    if run.fire is None or circles_one_front(run.fire.scenario):
        _find_directions(analysis, run)
    by_mission = [
        TurnedBack(at_us, *analysis.place_at(at_us), "its mission went back to an earlier item")
        for at_us in flown.turned_back_us
    ]
    analysis.turned_back = _merged(by_mission, analysis.turned_back, run)
    planned = [drop for _, items in flown.missions for drop in planned_in(items)]
    outputs = [*flown.servo_steps, *((at_us, GRIPPER, 0) for at_us in flown.releases_us)]
    done = [Done(at, *analysis.place_at(at), servo, pulse) for at, servo, pulse in sorted(outputs)]
    analysis.drops = compared(planned, done)
    fire = run.fire
    if fire is not None:
        land = fire.landscape
        x_m, y_m = land.xy_of_lat_lon(track[:, 1], track[:, 2])
        rows, cols = land.row_col_of(x_m, y_m)
        inside = (rows > -0.5) & (cols > -0.5)
        inside &= (rows < land.shape[0] - 0.5) & (cols < land.shape[1] - 0.5)
        analysis.terrain_amsl_m = np.full(len(track), np.nan)
        analysis.terrain_amsl_m[inside] = land.elevation_at(x_m[inside], y_m[inside])
        directions = fire.directions.get(flown.name, [])
        analysis.decided = [(run.log_us(at_us), clockwise) for at_us, clockwise in directions]
        analysis.differs = differing(analysis.directions, analysis.decided, run.end_us)
    return analysis


def _merged(
    by_mission: list[TurnedBack], by_track: list[TurnedBack], run: RunAnalysis
) -> list[TurnedBack]:
    """Return all reversals in time order, omitting track reversals soon after mission ones."""
    found = list(by_track)
    for turn in by_mission:
        after = [each for each in found if 0 <= each.at_us - turn.at_us <= FOLLOWS_US]
        if after:
            found.remove(after[0])
            then = f"; flies {after[0].how} from {run.since_s(after[0].at_us):.1f} s on"
            turn = replace(turn, how=turn.how + then)
        found.append(turn)
    return sorted(found, key=lambda each: each.at_us)


def _find_directions(analysis: VehicleAnalysis, run: RunAnalysis) -> None:
    """Find the directions of travel around the fire, or around the centre of the track."""
    track = analysis.track
    home = analysis.flown.home
    ground_m = track[0, 3] if home is None else home[2]
    up = np.flatnonzero(track[:, 3] >= ground_m + AIRBORNE_M)
    if not up.size:
        return
    air = track[up[0] : up[-1] + 1]
    centre = None if run.fire is None else run.fire.centre
    if centre is None:
        low, high = air[:, 1:3].min(axis=0), air[:, 1:3].max(axis=0)
        centre = (float(low[0] + high[0]) / 2.0, float(low[1] + high[1]) / 2.0)
    north_m = (air[:, 1] - centre[0]) * M_PER_DEG
    east_m = (air[:, 2] - centre[1]) * M_PER_DEG * np.cos(np.deg2rad(centre[0]))
    if run.fire is not None and run.fire.centre is not None:
        around, limits = "the fire", (FIRE_DEG, NEAR_CELLS * run.fire.landscape.cell_size_m)
    else:
        farthest_m = float(np.hypot(east_m, north_m).max())
        around, limits = "the middle of its track", (TRACK_DEG, NEAR_SHARE * farthest_m)
    found = turns(east_m, north_m, *limits)
    for number, turn in enumerate(found):
        at_us, lat, lon = (float(value) for value in air[turn.point, :3])
        direction = "clockwise" if turn.clockwise else "anticlockwise"
        analysis.directions.append((int(at_us), turn.clockwise))
        if number:
            how = f"{direction} around {around}"
            analysis.turned_back.append(TurnedBack(int(at_us), lat, lon, how))


def places_of(items: Items) -> Sequence[tuple[float, float]]:
    """Return the positions of a mission's items (lat_deg, lon_deg)."""
    return [place for place in map(place_of, items) if place is not None]
