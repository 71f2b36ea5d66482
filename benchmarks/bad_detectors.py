"""Detectors that are often or always wrong: ``python -m benchmarks.bad_detectors FIRST LAST``.

The simulated fires (seeds FIRST to LAST) are those of ``flown_estimate``: the model of the estimate
has a wrong wind, moisture and spread rate. For 40 minutes the estimate of a run receives the
observations of one source:

- camera: an image of the ground up to 300 m around a place that moves along the front, every 20 s
- raster: a raster of the whole landscape with cells of 60 m, every 60 s
- points: a point on the front every 30 s

Each source has an error of position and misses 5 % of the burned cells. The good source makes 1 %
(camera), 0 % (points) or 1 % (raster) false alarms, the noisy source 10 %. A false alarm is an
unburned cell that is reported as burned, or a point anywhere on the landscape. Both sources state
these shares; with the word "unstated", the noisy source states the shares of the good source.

The error is the area that differs from the simulated burned area, divided by that area, at two
times, now and 30 minutes ahead (by the model, from the estimated fire). Persistence is the area
that the good source has shown as burned; the model alone has no observations. The gain is the error
of the model alone minus the error with the good source. The cost is the error with the noisy source
minus the error with the good source; it should be less than a fifth of the gain.

Afterwards a faulty source observes the fire together with a good camera and two good rasters: a
raster that is always unburned, one that shows the fire 900 m to the east, random points of fire,
and a camera with inverted images. The last lines show after how many seconds an alarm names this
source (limit: 600), and after how many seconds its observations are no longer used.
"""

import argparse
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import click
import msgspec
import numpy as np
from scipy.ndimage import binary_fill_holes

from benchmarks.estimate_twins import views
from benchmarks.flown_estimate import error, wrong_scenario
from firemodel.arrays import Floats, Mask
from firemodel.assimilation.observation import BURNED, UNBURNED
from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import SimulationSection
from mission_service.config.scenario import Scenario
from mission_service.events import FireObserved, Observed, RasterObserved
from mission_service.fire.observed_window import LETTERS, in_letters
from mission_service.fire.reported_observations import observation_of
from mission_service.fire.run_estimate import RunEstimate, UnusedReportError
from mission_service.fire.scenario_fire import fire_of, landscape_of
from mission_service.fire.simulated_fire import simulated_fire_of

BEGIN_S, END_S, AHEAD_S = 3000.0, 5400.0, 1800.0
EVALUATED_S = (4200.0, 5400.0)
RASTER_EVERY_S, RASTER_CELLS, RASTER_SD_M = 60.0, 100, 15.0
POINT_EVERY_S, POINT_SD_M, FRONT_S = 30.0, 20.0, 300.0
MISSED, GOOD, WOLF = 0.05, 0.01, 0.1
LIED_S, NAMED_WITHIN_S = 900.0, 600.0
SHIFT_CELLS = 15  # of the raster, 900 m
KINDS = ("camera", "raster", "points")
LIES = ("unburned", "shifted", "random points", "inverted camera")

Event = Observed | FireObserved | RasterObserved


class World(NamedTuple):
    """A simulated fire, and the scenario of the estimate."""

    scenario: Scenario
    landscape: Landscape
    arrival_s: Floats  # (y, x) of the simulated fire


def world_of(seed: int) -> World:
    """Return the fire of a seed until the end of the last forecast."""
    scenario = wrong_scenario(seed, 24)
    landscape = landscape_of(scenario)
    fire = simulated_fire_of(scenario, landscape)
    assert fire is not None
    fire.advance(round((END_S + AHEAD_S) * 1e6))
    scenario = scenario.model_copy(update={"simulation": SimulationSection()})
    return World(scenario, landscape, fire.fire.expected_s())


def camera(
    world: World, rng: np.random.Generator, until_s: float, false: float, stated: float, name: str
) -> Iterator[Event]:
    """Yield the images of a camera that follows the front."""
    place = np.argwhere(world.arrival_s <= BEGIN_S)[0].astype(float)
    for image, _ in views(world.arrival_s, rng, BEGIN_S, until_s, place, false):
        cells = in_letters(LETTERS[image.state])
        yield Observed(
            *(round(image.at_s * 1e6), "hawk", image.top, image.left, cells),
            position_sd_m=image.position_sd_m,
            missed=image.missed,
            false_alarms=stated,
            source=name,
        )


def raster_of(world: World, at_s: float, burned: Mask, stated: float, name: str) -> RasterObserved:
    """Return a report of a raster of the whole landscape, from its burned cells (y, x)."""
    land = world.landscape
    corners = [
        land.lat_lon_of(*land.xy_of(row, col))
        for row in (-0.5, land.shape[0] - 0.5)
        for col in (-0.5, land.shape[1] - 0.5)
    ]
    south, _, _, north = sorted(float(lat) for lat, _ in corners)
    west, _, _, east = sorted(float(lon) for _, lon in corners)
    rows = in_letters(LETTERS[np.where(burned, BURNED, UNBURNED)])
    at_us = round(at_s * 1e6)
    return RasterObserved(
        *(at_us, "bench", "", south, west, north, east, rows, at_us, RASTER_SD_M),
        *(stated, name, MISSED),
    )


def rasters(
    world: World, rng: np.random.Generator, until_s: float, false: float, stated: float, name: str
) -> Iterator[Event]:
    """Yield rasters of the whole landscape."""
    for at_s in np.arange(BEGIN_S + RASTER_EVERY_S, until_s + 1.0, RASTER_EVERY_S):
        burned = shown(world, float(at_s))
        chance = rng.random(burned.shape)
        burned = np.where(burned, chance >= MISSED, chance < false)
        yield raster_of(world, float(at_s), burned, stated, name)


def shown(world: World, at_s: float) -> Mask:
    """Return the burned cells (y, x) of a raster without errors."""
    land, side = world.landscape, np.arange(RASTER_CELLS) + 0.5
    empty = raster_of(world, at_s, np.zeros((RASTER_CELLS, RASTER_CELLS), dtype=bool), 0.0, "")
    lat = empty.north_deg - side[:, None] / RASTER_CELLS * (empty.north_deg - empty.south_deg)
    lon = empty.west_deg + side[None, :] / RASTER_CELLS * (empty.east_deg - empty.west_deg)
    lat, lon = np.broadcast_arrays(lat, lon)
    place = land.row_col_of(*land.xy_of_lat_lon(lat, lon))
    row, col = (np.round(each).astype(int) for each in place)
    inside = (row >= 0) & (row < land.shape[0]) & (col >= 0) & (col < land.shape[1])
    found = np.zeros(inside.shape, dtype=bool)
    found[inside] = world.arrival_s[row[inside], col[inside]] <= at_s
    return found


def points(
    world: World, rng: np.random.Generator, until_s: float, false: float, stated: float, name: str
) -> Iterator[Event]:
    """Yield points on the front; the share ``false`` of them lies anywhere on the landscape."""
    for at_s in np.arange(BEGIN_S + POINT_EVERY_S, until_s + 1.0, POINT_EVERY_S):
        age_s = at_s - world.arrival_s
        front = np.argwhere((age_s >= 0.0) & (age_s < FRONT_S))
        place = front[rng.integers(len(front))] + rng.normal(0.0, POINT_SD_M / 30.0, 2)
        if rng.random() < false:
            place = rng.uniform(2.0, world.arrival_s.shape[0] - 3.0, 2)
        yield point_at(world, float(at_s), [place], stated, name)


def point_at(
    world: World, at_s: float, places: Sequence[Floats], stated: float, name: str
) -> FireObserved:
    """Return a report of fire at places (row, col)."""
    land, at_us = world.landscape, round(at_s * 1e6)
    found = [land.lat_lon_of(*land.xy_of(*place)) for place in places]
    return FireObserved(
        *(at_us, "bench", "", "burning", "points"),
        tuple((float(lat), float(lon)) for lat, lon in found),
        *(at_us, POINT_SD_M, stated, name),
    )


SOURCES = {"camera": camera, "raster": rasters, "points": points}


def observe(estimate: RunEstimate, event: Event) -> None:
    """Pass an observation to the estimate as a run does."""
    if isinstance(event, Observed):
        distrusted = event.source in estimate.agreement.distrusted
        if not distrusted:
            estimate.on_event(event)
        return
    try:
        estimate.apply_report(event)
    except UnusedReportError:
        return


def errors_with(world: World, events: Iterator[Event]) -> tuple[Floats, Floats]:
    """Return the errors (times, now and ahead) of the estimate and of persistence."""
    estimate = RunEstimate(world.scenario, world.landscape)
    seen = np.zeros(world.landscape.shape, dtype=bool)
    found, persistence = [], []
    due = list(EVALUATED_S)
    for event in events:
        while due and event.at_us / 1e6 > due[0]:
            found.append(_errors(world, estimate, due[0]))
            persistence.append(_unchanged(world, seen, due.pop(0)))
        observe(estimate, event)
        image = observation_of(event, world.landscape)
        seen[image.where] |= image.state == BURNED
    for at_s in due:
        found.append(_errors(world, estimate, at_s))
        persistence.append(_unchanged(world, seen, at_s))
    return np.array(found), np.array(persistence)


def _errors(world: World, estimate: RunEstimate, at_s: float) -> list[float]:
    estimate.advance(round(at_s * 1e6))
    ahead = estimate.fire.copy()
    ahead.advance(at_s + AHEAD_S)
    areas = ((at_s, estimate.fire.burned()), (at_s + AHEAD_S, ahead.burned()))
    return [error(area, world.arrival_s <= when_s) for when_s, area in areas]


def _unchanged(world: World, seen: Mask, at_s: float) -> list[float]:
    area = binary_fill_holes(seen)
    return [error(area, world.arrival_s <= when_s) for when_s in (at_s, at_s + AHEAD_S)]


def model_alone(world: World) -> Floats:
    """Return the errors (times, now and ahead) of the model without observations."""
    fire, found = fire_of(world.scenario, world.landscape), []
    fire.advance(END_S + AHEAD_S)
    for at_s in EVALUATED_S:
        row = [
            error(fire.arrival_time_s <= when_s, world.arrival_s <= when_s)
            for when_s in (at_s, at_s + AHEAD_S)
        ]
        found.append(row)
    return np.array(found)


def lies(world: World, rng: np.random.Generator, kind: str) -> Iterator[Event]:
    """Yield the observations of a faulty source."""
    until_s = BEGIN_S + LIED_S
    if kind == "inverted camera":
        inverted = str.maketrans("bu", "ub")
        for image in camera(world, rng, until_s, GOOD, GOOD, "liar"):
            assert isinstance(image, Observed)
            cells = tuple(row.translate(inverted) for row in image.cells)
            yield msgspec.structs.replace(image, cells=cells)
        return
    for at_s in np.arange(BEGIN_S + 45.0, until_s, RASTER_EVERY_S):
        burned = shown(world, float(at_s))
        if kind == "random points":
            places = [rng.uniform(2.0, 197.0, 2) for _ in range(10)]
            yield point_at(world, float(at_s), places, 0.0, "liar")
        else:
            wrong = np.roll(burned, SHIFT_CELLS, axis=1) if kind == "shifted" else burned & False
            yield raster_of(world, float(at_s), wrong, GOOD, "liar")


class Named(NamedTuple):
    """What the alarms have named."""

    alarm_s: float  # after this time the first alarm names the faulty source; infinity: never
    unused_s: float  # after this time it is not used
    others: set[str]  # other sources that were not used


def named_with(world: World, seed: int, kind: str) -> Named:
    """Return the alarms about a faulty source beside three good sources."""
    until_s = BEGIN_S + LIED_S
    rng = [np.random.default_rng((5, seed, number)) for number in range(4)]
    events = [
        *camera(world, rng[0], until_s, GOOD, GOOD, "camera"),
        *rasters(world, rng[1], until_s, GOOD, GOOD, "raster"),
        *rasters(world, rng[2], until_s, GOOD, GOOD, "second raster"),
        *lies(world, rng[3], kind),
    ]
    estimate = RunEstimate(world.scenario, world.landscape)
    found = Named(np.inf, np.inf, set())
    for event in sorted(events, key=lambda each: each.at_us):
        observe(estimate, event)
        after_s = event.at_us / 1e6 - BEGIN_S
        if any("liar" in text for text in estimate.agreement.contradictions().values()):
            found = found._replace(alarm_s=min(found.alarm_s, after_s))
        for name in estimate.agreement.distrusted:
            if name.startswith("liar"):
                found = found._replace(unused_s=min(found.unused_s, after_s))
            else:
                found.others.add(name)
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the errors of each seed, the means, the shares of the gain, and the faulty sources."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("unstated", nargs="?", choices=["unstated"])
    given = parser.parse_args(arguments)
    click.echo("seed  source  error now/+30 min: good, noisy, persistence, model alone")
    every: dict[str, list[Floats]] = {kind: [] for kind in KINDS}
    worlds = {seed: world_of(seed) for seed in range(given.first, given.last + 1)}
    for seed, world in worlds.items():
        alone = model_alone(world)
        for number, kind in enumerate(KINDS):
            good = 0.0 if kind == "points" else GOOD
            rows = []
            for false in (good, WOLF):
                rng = np.random.default_rng((6, seed, number))
                stated = good if given.unstated else false
                rows.append(
                    errors_with(world, SOURCES[kind](world, rng, END_S, false, stated, kind))
                )
            (fine, persistence), (wolf, _) = rows
            each = np.array([fine, wolf, persistence, alone]).mean(axis=1)
            every[kind].append(each)
            click.echo(_line(f"{seed:4}  {kind:6}", each))
    for kind in KINDS:
        mean = np.mean(every[kind], axis=0)
        text = "/".join(
            f"{(wolf - good) / (alone - good):.2f}" if good < alone else "no gain"
            for good, wolf, _, alone in mean.T
        )
        click.echo(_line(f"mean  {kind:6}", mean) + f"  cost / gain {text} (limit 0.20)")
    for kind in LIES:
        found = [named_with(world, seed, kind) for seed, world in worlds.items()]
        alarm_s, unused_s = (max(each[number] for each in found) for number in range(2))
        others = sorted(set().union(*(each.others for each in found)))
        click.echo(
            f"{kind}: named after {alarm_s:.0f} s at most (limit {NAMED_WITHIN_S:.0f} s), not used "
            f"after {unused_s:.0f} s; other sources not used: {', '.join(others) or 'none'}"
        )


def _line(name: str, errors: Floats) -> str:
    return f"{name}  " + "  ".join("/".join(f"{value:.3f}" for value in row) for row in errors)


if __name__ == "__main__":
    main()
