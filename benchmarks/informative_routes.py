"""Errors of the estimate by the routes flown: ``benchmarks.informative_routes KIND FIRST LAST``.

One vehicle flies over a simulated fire without autopilot: along the planner's paths, at constant
speed, with the time that turns take. The vehicle observes all cells at most three cells away. The
estimate of the service receives these observations, and the planner receives the estimate's fronts.
The error is the distance between the estimated and the true front in cells: at each minute the mean
and the largest distance from each front to the other one, averaged over the flight. At the start
the whole fire is mapped once.

Kinds of fires: ``random`` (the model is right), ``wrong`` (30 % of the fuels, the wind direction
and the wind speed of the model are wrong), ``head`` (a narrow fast strip), ``even``, ``bay`` (a
strip of slow fuel across the spread), ``fingers``, ``island`` (slow fuel inside), ``two`` (two
fires), ``merging`` (two fires that merge), ``spots`` (a fire with three spot fires).

The benchmark also prints the results of other methods: ``laps``, the same estimate with a vehicle
that circles the longest front; ``last seen``, the fire as last observed by that vehicle, without a
model; ``no aircraft``, the model alone.
"""

import argparse
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import click
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, distance_transform_edt, label

from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import WeatherStream
from firemodel.spread.schemes import new_fire
from mission_service.config.fire_sections import Ignition, WeatherEntry
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.events import Observed, Telemetry
from mission_service.experiments.fires import (
    BRUSH,
    CELLS,
    HOUR_S,
    SHORT_GRASS,
    TIMBER_LITTER,
    Burn,
    flat,
    of_one_fuel,
    wind,
)
from mission_service.experiments.islam_hu.ideal_flight import look
from mission_service.fire.observed_window import in_letters, states_in
from mission_service.fire.run_estimate import RunEstimate
from mission_service.guidance.front.informative.planner import InformativePlanner, settings_of
from mission_service.guidance.front.informative.shared_fronts import SharedFronts
from mission_service.guidance.front.planners import ground_of
from mission_service.guidance.protocol import Decision
from tests.service.random_fires import random_fire
from tests.service.wrong_models import wrong_model

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

MEASURE_EVERY_S = 60.0
MIN_PATH_POINTS = 8
MIN_ISLAND = 20
END_S = 4.0 * HOUR_S
RADIUS_CELLS = 1.0  # turn radius
NAME = "hawk"
WIND_M_S = {"head": 6.0, "even": 0.5, "bay": 3.0, "fingers": 3.0, "island": 3.0}


@dataclass(frozen=True)
class Case:
    """A true fire, and the landscape and weather of the model."""

    name: str
    truth: Burn
    model: Burn
    ignitions: tuple[tuple[int, int, float], ...]  # row, column, time in s


@dataclass(frozen=True)
class Errors:
    """Mean over time of the mean and of the largest distance between fronts, in cells."""

    mean: float
    largest: float


class Laps(InformativePlanner):
    """The same vehicle without a choice of routes: it circles the longest front."""

    def _decide(self, row: float, col: float, at_s: float) -> Decision:
        del self._shared.fronts[1:]
        return self._decision(False, 0.0, 0.0)


def front_cells(burned: Mask) -> Mask:
    """Return the burned cells next to unburned ones."""
    return burned & ~binary_erosion(burned, border_value=1)


def without_small_holes(burned: Mask) -> Mask:
    """Return a mask in which unburned islands of fewer than ``MIN_ISLAND`` cells are burned."""
    labels, _ = label(~burned)
    sizes = np.bincount(labels.ravel())
    return burned | (sizes < MIN_ISLAND)[labels]


def distances(estimated: Mask, true: Mask) -> tuple[float, float]:
    """Return the mean and the largest distance between two fronts in cells, both directions."""
    one, other = (front_cells(without_small_holes(each)) for each in (estimated, true))
    to_other, to_one = (distance_transform_edt(~each) for each in (other, one))
    every = np.concatenate([to_other[one], to_one[other]])
    return float(every.mean()), float(every.max())


def scenario_of(case: Case) -> Scenario:
    """Return a scenario with the weather and ignitions of the model."""
    land, model = case.model.landscape, case.model
    base = load_scenario("default", ("planner.rule=informative",))
    places = [land.lat_lon_of(*land.xy_of(row, col)) for row, col, _ in case.ignitions]
    ignitions = tuple(
        Ignition(lat_deg=float(lat), lon_deg=float(lon), at_s=at_s)
        for (lat, lon), (_, _, at_s) in zip(places, case.ignitions, strict=True)
    )
    weather = tuple(
        WeatherEntry(**{name: getattr(entry, name) for name in WeatherEntry.model_fields})
        for entry in model.weather.entries
    )
    cell_m = land.cell_size_m
    vehicle = base.vehicles[0].model_copy(
        update={
            "name": NAME,
            "airspeed_m_s": case.truth.speed_m_s,
            "turn_radius_m": RADIUS_CELLS * cell_m,
        }
    )
    mission = base.mission.model_copy(
        update={"lookahead_m": 1.5 * cell_m, "horizon_m": 60.0 * cell_m}
    )
    changed = {"weather": weather, "ignition": ignitions, "vehicles": (vehicle,)}
    return base.model_copy(update={**changed, "mission": mission})


class Flight:
    """One vehicle over a fire, the estimate, and its planner."""

    def __init__(self, case: Case, laps: bool) -> None:
        self.case = case
        scenario = scenario_of(case)
        land = case.model.landscape
        self.estimate = RunEstimate(scenario, land)
        settings = settings_of(scenario, scenario.vehicles[0], land)
        shared = SharedFronts(land.cell_size_m)
        kind = Laps if laps else InformativePlanner
        self.planner = kind(NAME, settings, ground_of(scenario, land), shared)
        self.at_s = case.truth.deploy_s
        burned = np.argwhere(case.truth.burned(self.at_s))
        self.place = burned[burned[:, 0].argmin()].astype(float)
        mapped = case.truth.burned(self.at_s)
        self.last_seen = mapped.copy()
        codes = np.where(mapped, b"b", b"u").view(np.uint8)
        survey = Observed(round(self.at_s * 1e6), NAME, 0, 0, in_letters(codes))
        self.estimate.on_event(survey)
        self.path = np.empty((0, 2))

    def run(self) -> tuple[Errors, Errors, Errors, int]:
        """Return the errors of the estimate, of the fire as last seen, and of the model alone."""
        truth = self.case.truth
        step_s = truth.landscape.cell_size_m / truth.speed_m_s
        found: list[tuple[tuple[float, float], ...]] = []
        due_s = self.at_s + HOUR_S / 4.0
        while self.at_s < truth.end_s:
            self._observe()
            row, col = self.place.tolist()
            decision = self.planner.at(row, col, self.at_s)
            if decision is not None and decision.reversed:
                self.at_s += self.planner.settings.turn_s
            if decision is not None or len(self.path) < MIN_PATH_POINTS:
                self.path = self.planner.path(row, col)
            self._move()
            self.at_s += step_s
            if self.at_s >= due_s:
                due_s += MEASURE_EVERY_S
                found.append(self._errors())
        columns = np.array(found)
        means = [Errors(*columns[:, number].mean(axis=0).tolist()) for number in range(3)]
        return (*means, self.planner.reversals)  # type: ignore[return-value]

    def _observe(self) -> None:
        row, col = (round(value) for value in self.place)
        seen = look(self.case.truth, row, col, self.at_s)
        seen = Observed(seen.at_us, NAME, seen.row, seen.col, seen.cells)
        land = self.case.model.landscape
        lat_deg, lon_deg = land.lat_lon_of(*land.xy_of(*self.place))
        at_us = round(self.at_s * 1e6)
        fix = Telemetry(at_us, NAME, float(lat_deg), float(lon_deg), 0.0, 0.0, 0.0, 0.0, 0.0)
        self.estimate.on_event(seen)
        self.planner.observe(seen)
        state = states_in(seen.cells)
        here = np.s_[seen.row : seen.row + state.shape[0], seen.col : seen.col + state.shape[1]]
        self.last_seen[here] |= state == 2
        fronts = self.estimate.fronts(fix)
        self.estimate.on_event(fix)
        if fronts is not None:
            self.estimate.on_event(fronts)
            self.planner.on_fronts(fronts)

    def _move(self) -> None:
        """Move one cell along the path, and remove the part that has been flown."""
        left = 1.0
        for number, goal in enumerate(self.path):
            way = goal - self.place
            length = float(np.hypot(*way))
            if length >= left:
                self.place = self.place + way * (left / length)
                self.path = self.path[number:]
                return
            self.place, left = goal.copy(), left - length
        self.path = self.path[:0]

    def _errors(self) -> tuple[tuple[float, float], ...]:
        self.estimate.advance(round(self.at_s * 1e6))
        true = self.case.truth.burned(self.at_s)
        alone = self.case.model.burned(self.at_s)
        estimated = self.estimate.fire.burned()
        fires = (estimated, self.last_seen, alone)
        return tuple(distances(each, true) for each in fires)


def random_case(seed: int) -> Case:
    """Return a random fire, for which the model is right."""
    fire = random_fire(2 * seed + 1)
    return Case(f"random {seed}", fire, fire, ((*fire.ignition, 0.0),))


def wrong_case(seed: int) -> Case:
    """Return a random fire with a wrong model."""
    fire = random_fire(2 * seed + 1)
    return Case(f"wrong {seed}", fire, wrong_model(fire, seed), ((*fire.ignition, 0.0),))


def shaped_case(kind: str, seed: int) -> Case:
    """Return a fire with a front of a certain shape.

    Wind, place and sizes are random. The wind of the model is wrong by 30 % and by 20 degrees.
    """
    rng = np.random.default_rng((77, seed))
    fuel, from_deg = of_one_fuel(SHORT_GRASS), float(rng.uniform(0.0, 360.0))
    middle = CELLS // 2
    ignitions = [(middle, middle, 0.0)]
    rows, cols = np.mgrid[:CELLS, :CELLS]
    toward = math.radians(from_deg + 180.0)
    north, east = middle - rows, cols - middle
    along = north * math.cos(toward) + east * math.sin(toward)
    across = east * math.cos(toward) - north * math.sin(toward)
    if kind == "head":
        fuel[:] = TIMBER_LITTER
        fuel[(np.abs(across) <= 5) & (along > -5)] = BRUSH
    elif kind == "bay":
        behind = along > float(rng.uniform(6.0, 12.0))
        middle_across = float(rng.uniform(-8.0, 8.0))
        fuel[(np.abs(across - middle_across) <= rng.uniform(3.0, 6.0)) & behind] = TIMBER_LITTER
    elif kind == "fingers":
        width = float(rng.uniform(14.0, 20.0))
        slow = (across + width / 2.0) % width <= rng.uniform(4.0, 7.0)
        fuel[slow & (along > rng.uniform(4.0, 8.0))] = TIMBER_LITTER
    elif kind == "island":
        place = rng.uniform(8.0, 14.0)
        fuel[np.hypot(along - place - 10.0, across) <= rng.uniform(6.0, 9.0)] = TIMBER_LITTER
    elif kind in ("two", "merging"):
        away = rng.uniform(30.0, 45.0) if kind == "two" else rng.uniform(16.0, 24.0)
        ignitions = [
            (round(middle + side * away / 2 * math.sin(toward)),
             round(middle + side * away / 2 * math.cos(toward)), 0.0)
            for side in (-1, 1)
        ]  # fmt: skip
    elif kind == "spots":
        for at_s in (4500.0, 6300.0, 8100.0):
            forward, sideways = rng.uniform(35.0, 60.0), rng.uniform(-25.0, 25.0)
            ignitions.append(
                (round(middle - forward * math.cos(toward) + sideways * math.sin(toward)),
                 round(middle + forward * math.sin(toward) + sideways * math.cos(toward)), at_s)
            )  # fmt: skip
    speed_m_s = WIND_M_S.get(kind, 2.0)
    modelled = speed_m_s * math.exp(rng.normal(0.0, 0.3)), from_deg + rng.normal(0.0, 20.0)
    airspeed_m_s = 3.0 if kind == "head" else 8.0
    truth, model = (
        _burned(f"{kind} {seed}", flat(fuel), blown, ignitions, airspeed_m_s)
        for blown in ((speed_m_s, from_deg), modelled)
    )
    return Case(truth.name, truth, model, tuple(ignitions))


def _burned(
    name: str,
    landscape: Landscape,
    blown: tuple[float, float],
    ignitions: Sequence[tuple[int, int, float]],
    airspeed_m_s: float,
) -> Burn:
    weather = WeatherStream([wind(0.0, blown[0], blown[1] % 360.0)])
    fire = new_fire("anyangle", landscape, weather, ignitions)
    fire.advance(END_S)
    arrival_s = fire.arrival_time_s.copy()
    row, col, _ = ignitions[0]
    return Burn(
        *(name, "anyangle", landscape, weather, (row, col)),
        *(HOUR_S, END_S, airspeed_m_s, arrival_s),
    )


Result = TypeVar("Result")

SHAPED = ("head", "even", "bay", "fingers", "island", "two", "merging", "spots")
KINDS: dict[str, Callable[[int], Case]] = {
    "random": random_case,
    "wrong": wrong_case,
    **{kind: partial(shaped_case, kind) for kind in SHAPED},
}


def flown(kind: str, seed: int) -> tuple[str, list[Errors], tuple[int, int]]:
    """Return the errors of ``informative``, laps, last seen and no aircraft; and turn counts."""
    case = KINDS[kind](seed)
    own, _, alone, turns = Flight(case, laps=False).run()
    laps, last, _, lap_turns = Flight(case, laps=True).run()
    return case.name, [own, laps, last, alone], (turns, lap_turns)


def each_fire(
    description: str | None,
    kinds: Iterable[str],
    flown: Callable[[str, int], Result],
    header: str,
    arguments: Sequence[str] | None,
) -> Iterator[Result]:
    """Print the header of a table, and yield ``flown(kind, seed)`` for each of its rows.

    The command line is ``KIND FIRST LAST [--processes N]``.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("kind", choices=list(kinds))
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("--processes", type=int, default=1)
    given = parser.parse_args(arguments)
    click.echo(header)
    with ProcessPoolExecutor(given.processes) as pool:
        yield from pool.map(partial(flown, given.kind), range(given.first, given.last + 1))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the errors of each fire, and the means of their ratios."""
    every: list[list[tuple[float, float]]] = []
    header = "errors in cells, mean/largest: informative, laps, last seen, no aircraft; turns"
    for name, errors, turns in each_fire(__doc__, KINDS, flown, header, arguments):
        every.append([(each.mean, each.largest) for each in errors])
        shown = "  ".join(f"{each.mean:6.2f}/{each.largest:6.2f}" for each in errors)
        click.echo(f"{name:12} {shown}  {turns[0]:3}")
    values = np.array(every)
    for number, name in ((1, "laps"), (2, "last seen"), (3, "no aircraft")):
        ratio = values[:, 0] / values[:, number]
        click.echo(
            f"informative / {name}: mean error {ratio[:, 0].mean():.2f}, worst "
            f"{ratio[:, 0].max():.2f}; largest error {ratio[:, 1].mean():.2f}, worst "
            f"{ratio[:, 1].max():.2f}"
        )


if __name__ == "__main__":
    main()
