"""Fly the four scenarios of Beachly's section VI on a mock copter with a simulated crew.

All scenarios have a burn unit of 20 acres, a wind of 2 m/s towards the south and a backing fire
along the southern edge. Scenario 1 has no other fire. In scenario 2 the backing fire has burned
farther in the centre. In scenario 3 there is a second front, at 45 degrees to the southern edge. In
scenario 4 this front is reported to the planner during the flight.
"""

import math
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from firemodel.ellipses.point_observations import Simulation
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.config.sections import LitLine
from mission_service.core.core import Core
from mission_service.events import AnyOperatorEvent, IgnitionReported
from mission_service.fire.scenario_fire import landscape_of
from mission_service.ground_distance import M_PER_DEG
from mission_service.guidance.burn.controller import BurnFlight, burn_flight
from mission_service.guidance.burn.sphere_account import Sphere
from mission_service.ignition_plan import IgnitionPlan
from mission_service.simulation.sim import simulate
from mission_service.simulation.simulated_crew import SimulatedCrew

Floats = NDArray[np.float64]
Place = tuple[float, float]

STARTS_S = 240.0  # time of takeoff, after the ignition of the backing fire
ENDS_S = 1100.0
SECOND_FRONT_S = 15.0  # from the first drop to the report of the second front, in scenario 4
LOW_SHARE = 0.9  # fraction of the safe height up to which a vehicle counts as low
# Lines lit in scenario 2: (m north of the southern edge, time of ignition in s).
BULGE = ((6.0, 20.0), (12.0, 55.0), (18.0, 90.0), (24.0, 125.0), (30.0, 160.0), (36.0, 195.0))


@dataclass
class Sample:
    """The position of the vehicle and the estimated fire, recorded once a second."""

    at_s: float
    x_m: float
    y_m: float
    height_m: float
    fire: Simulation


@dataclass
class Flown:
    """The recorded flight of one scenario."""

    scenario: int
    landscape: Landscape
    area: Any
    samples: list[Sample] = field(default_factory=list)
    plans: dict[str, IgnitionPlan] = field(default_factory=dict)
    spheres: list[Sphere] = field(default_factory=list)
    withdrawn: list[str] = field(default_factory=list)

    @property
    def lit_lines(self) -> list[IgnitionPlan]:
        """The plans from which at least one sphere was dropped, in order."""
        flown = {sphere.plan_hash for sphere in self.spheres}
        return [plan for name, plan in self.plans.items() if name in flown]


def lit_lines(scenario: int, corners: tuple[Place, ...]) -> tuple[LitLine, ...]:
    """Return the initial fire lines in a unit (corners anticlockwise from the south-west)."""
    (south, west), (_, east) = corners[0], corners[1]
    edge = LitLine(points=((south, west), (south, east)))
    if scenario == 2:
        width = east - west
        middle = (west + 0.38 * width, west + 0.62 * width)
        bulge = [
            LitLine(points=tuple((south + north_m / M_PER_DEG, lon) for lon in middle), at_s=at_s)
            for north_m, at_s in BULGE
        ]
        return (edge, *bulge)
    if scenario == 3:
        return (edge, LitLine(points=second_front(corners)))
    return (edge,)


def second_front(corners: tuple[Place, ...]) -> tuple[Place, Place]:
    """Return a line at 45 degrees from the southern to the eastern edge of the unit."""
    (south, west), (_, east) = corners[0], corners[1]
    start = west + 0.55 * (east - west)
    north = south + (east - start) * math.cos(math.radians(south))
    return (south, start), (min(north, corners[2][0]), east)


def scenario_of(number: int) -> Scenario:
    """Return the scenario ``burn`` with the initial fires of one of the paper's scenarios."""
    base = load_scenario("burn", (f"duration_s={ENDS_S}", f"deploy_at_s={STARTS_S}"))
    assert base.burn is not None
    assert base.burn.unit is not None
    burn = base.burn.model_copy(
        update={"lit": lit_lines(number, base.burn.unit), "camera_corrects": False}
    )
    return base.model_copy(update={"name": f"beachly-{number}", "burn": burn})


class RecordingCrew:
    """A simulated crew that records the flight, and reports the second front in scenario 4."""

    def __init__(self, flown: Flown, scenario: Scenario) -> None:
        assert scenario.burn is not None
        self._crew = SimulatedCrew(scenario.burn)
        self._burn = scenario.burn
        self._flown = flown
        self._next_us = 0
        self._reported = flown.scenario != 4

    def due(self, now_us: int, core: Core) -> list[AnyOperatorEvent]:
        """Return the events of the crew that are due at ``now_us``."""
        guidance = burn_flight(core.guidance)
        if now_us >= self._next_us:
            self._next_us = now_us + 1_000_000
            self._record(now_us, core, guidance)
        events = self._crew.due(now_us, core)
        spheres = guidance.state.account.spheres
        if not self._reported and spheres and now_us > spheres[0].at_us + SECOND_FRONT_S * 1e6:
            self._reported = True
            assert self._burn.unit is not None
            station = self._burn.stations[0].name
            events.append(
                IgnitionReported(now_us, "onlooker", station, second_front(self._burn.unit), 0)
            )
        return events

    def _record(self, now_us: int, core: Core, guidance: BurnFlight) -> None:
        flown = self._flown
        flown.spheres = [sphere for sphere in guidance.state.account.spheres if sphere.counts]
        if guidance.approvals.plan is not None:
            flown.plans.setdefault(guidance.approvals.plan_hash, guidance.approvals.plan)
        (vehicle,) = core.vehicles.values()
        fix = vehicle.availability.fix
        if fix is not None and vehicle.availability.airborne:
            height_m = fix.altitude_m - float(core.landscape.elevation_at(fix.x_m, fix.y_m))
            place = (fix.at_s, fix.x_m, fix.y_m, height_m)
            flown.samples.append(Sample(*place, guidance.state.fire.simulation))


def fly(number: int, out: Path | None = None) -> Flown:
    """Fly one scenario; if ``out`` is given, store the journal in that folder."""
    scenario = scenario_of(number)
    landscape = landscape_of(scenario)
    assert scenario.burn is not None
    assert scenario.burn.unit is not None
    lat, lon = np.array(scenario.burn.unit).T
    area = shapely.Polygon(np.column_stack(landscape.xy_of_lat_lon(lat, lon)))
    flown = Flown(number, landscape, area)
    with tempfile.TemporaryDirectory() as folder:
        journal = (out or Path(folder)) / f"scenario-{number}.jsonl"
        simulate(scenario, journal, "", crew=RecordingCrew(flown, scenario).due)
    return flown


def min_time_margin_s(flown: Flown, safe_height_m: float) -> float:
    """Return the shortest time until fire reaches the vehicle, over all samples at low height.

    The time follows from the estimated fire at the time of the sample. On burned ground this time
    is negative.
    """
    margins = [
        sample.fire.ignition_time_s(np.array([[sample.x_m, sample.y_m]]))[0] - sample.at_s
        for sample in flown.samples
        if sample.height_m < LOW_SHARE * safe_height_m
    ]
    return float(min(margins, default=math.inf))


def row_of(flown: Flown) -> dict[str, Any]:
    """Return a scenario's row of the table."""
    lines = flown.lit_lines
    safe_height_m = lines[0].safe_height_m if lines else 60.0
    outside = sum(not flown.area.covers(shapely.Point(sphere.falls_m)) for sphere in flown.spheres)
    return {
        "scenario": flown.scenario,
        "drops": len(flown.spheres),
        "skipped": sum(len(plan.skipped) for plan in lines),
        "min_time_margin_s": round(min_time_margin_s(flown, safe_height_m), 1),
        "outside_area": outside,
        "lines": len(lines),
        "farthest_off_its_place_m": round(
            max((s.max_miss_m for s in flown.spheres), default=0.0), 2
        ),
    }
