"""Errors of an estimate with a wrong model: ``python -m benchmarks.estimate_twins FIRST LAST``.

The true fires (seeds FIRST to LAST) burn patches of five fuels for 3.5 hours. The inputs of the
estimate are wrong: the fuel in 30 % of the patches, the wind by 3 m/s and 30 degrees (standard
deviations), and the moisture by 30 %; the factors of the spread rates are not given. After one
hour, a sector of 60 degrees is held. A camera flies along the front at 12 m/s and every 20 s images
the ground up to 300 m away. In the images 5 % of the burned cells are missed, 1 % of the other
cells are false alarms, and the position is wrong by 10 m.

At four times, forecasts for 0, 30 and 60 minutes are compared with the true fire. The error is the
area that differs from the true area, divided by the true area. The forecast area contains the cells
that have burned with a probability of at least one half, which minimises the expected error; on the
map it is the area within the median arrival times. Persistence is the area that was observed as
burned; the model alone has the same inputs, but no observations.
"""

import argparse
import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, NamedTuple

import click
import contourpy
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_fill_holes, map_coordinates

from firemodel.arrays import Floats, Mask, lengths_along
from firemodel.assimilation.fire_estimate import EstimateSettings, FireEstimate
from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN, Observation, despeckled
from firemodel.assimilation.scores import coverage, crps_s
from firemodel.ensemble.uncertainty import Uncertainty
from firemodel.landscape.flat import flat_landscape
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.burning import burning_from_arrival

CELLS, CELL_M, PATCH_CELLS = 200, 30.0, 4
FUELS = (1, 2, 5, 8, 10)
UNBURNABLE = 99
HOUR_S = 3600.0
HELD_FROM_S, HELD_HALF_DEG = HOUR_S, 30.0
FIRST_VIEW_S = 1500.0
EVERY_S, BATCH_S = 20.0, 200.0
EVALUATED_S = (4500.0, 5700.0, 6900.0, 8100.0)
AHEAD_S = (0.0, 1800.0, 3600.0)
CRPS_STEPS = 7
RADIUS_M, SPEED_M_S, POSITION_SD_M, MISSED, FALSE_ALARMS = 300.0, 12.0, 10.0, 0.05, 0.01
WRONG = Uncertainty(
    wind_log_sd=0.5, wind_turn_sd_deg=30.0, spread_log_sd=0.3, fuel_log_sd=0.4, moisture_log_sd=0.3
)
# Limits of the true burned area after one and after three hours.
SIZES_HA = ((30.0, 300.0), (60.0, 1500.0))


class Inputs(NamedTuple):
    """The inputs of a true fire, and those that the estimate receives."""

    true: NDArray[np.int16]  # (y, x) fuels
    actual: WeatherStream
    factors: Floats  # (fuels) factors of the spread rate
    believed: NDArray[np.int16]
    reported: WeatherStream
    held_deg: float  # bearing of the held sector


class Twin(NamedTuple):
    """A true fire, and what the estimate receives of its inputs."""

    arrival_s: Floats  # (y, x) true arrival times
    landscape: Landscape
    weather: WeatherStream
    ignition: tuple[int, int]
    seeds: tuple[int, ...]  # the generator state of ``drawn``


class Scores(NamedTuple):
    """Scores of one forecast; errors as shares of the true area."""

    estimate: float
    persistence: float
    model: float
    missed: float
    overburned: float
    inside_band: float


def patches(rng: np.random.Generator) -> NDArray[np.int16]:
    """Return random fuels in square patches."""
    side = CELLS // PATCH_CELLS
    codes = rng.choice(FUELS, size=(side, side))
    return np.kron(codes, np.ones((PATCH_CELLS, PATCH_CELLS), dtype=np.int16))


def landscape_with(codes: NDArray[np.int16]) -> Landscape:
    """Return level ground with these fuels."""
    level = flat_landscape(CELLS, CELLS, CELL_M, 37.0, -120.0, 100.0, 1)
    return replace(level, fuel_model=codes.astype(np.int16))


def twin(seed: int) -> Twin:
    """Return the first fire of a seed that has a usable size and stays on the grid."""
    number = 0
    while True:
        found = _burned((777, seed, number))
        sizes = [np.count_nonzero(found.arrival_s <= h * HOUR_S) * CELL_M**2 / 1e4 for h in (1, 3)]
        edge_s = min(found.arrival_s[[0, -1]].min(), found.arrival_s[:, [0, -1]].min())
        fits = all(low < size < high for size, (low, high) in zip(sizes, SIZES_HA, strict=True))
        if fits and edge_s > 3.2 * HOUR_S:
            return found
        number += 1


def drawn(seeds: tuple[int, ...]) -> Inputs:
    """Draw the inputs of a fire."""
    rng = np.random.default_rng(seeds)
    believed = patches(rng)
    side = CELLS // PATCH_CELLS
    wrong = np.kron(rng.random((side, side)) < 0.3, np.ones((PATCH_CELLS, PATCH_CELLS), dtype=bool))
    true = np.where(wrong, patches(rng), believed)
    speed, from_deg = rng.uniform(3.0, 8.0), rng.uniform(0.0, 360.0)
    reported = []
    for step in range(8):
        reported.append(
            Weather(step * 1800.0, max(speed, 0.5), from_deg % 360.0, 6.0, 7.0, 8.0, 60.0, 90.0)
        )
        speed += rng.normal(0.0, 0.4)
        from_deg += rng.normal(0.0, 6.0)
    off_m_s, turn_deg = rng.normal(0.0, 3.0), rng.normal(0.0, 30.0)
    moisture = math.exp(rng.normal(0.0, 0.3))
    actual = [
        replace(
            entry,
            wind_speed_m_s=max(entry.wind_speed_m_s + off_m_s, 0.3),
            wind_from_deg=(entry.wind_from_deg + turn_deg) % 360.0,
            dead_1h_pct=entry.dead_1h_pct * moisture,
            dead_10h_pct=entry.dead_10h_pct * moisture,
            dead_100h_pct=entry.dead_100h_pct * moisture,
        )
        for entry in reported
    ]
    factors = np.exp(rng.normal(0.0, 0.4, len(FUELS)))
    held_deg = rng.uniform(0.0, 360.0)
    return Inputs(true, WeatherStream(actual), factors, believed, WeatherStream(reported), held_deg)


def _burned(seeds: tuple[int, ...]) -> Twin:
    """Return the fire with these inputs."""
    inputs = drawn(seeds)
    middle = (CELLS // 2, CELLS // 2)
    fire = AnyAngleFire(landscape_with(inputs.true), inputs.actual, [(*middle, 0.0)])
    fire.perturb(1.0, 0.0, inputs.factors)
    fire.advance(HELD_FROM_S)
    before_s = fire.expected_s()
    held = sector(before_s <= HELD_FROM_S, inputs.held_deg, HELD_HALF_DEG)
    codes = np.where(held, UNBURNABLE, inputs.true)
    later = continued(before_s, HELD_FROM_S, inputs.actual, codes, inputs.factors)
    later.advance(4.0 * HOUR_S)
    arrival_s = np.where(before_s <= HELD_FROM_S, before_s, later.expected_s())
    landscape = landscape_with(inputs.believed)
    return Twin(arrival_s, landscape, inputs.reported, middle, seeds)


def continued(
    arrival_s: Floats,
    at_s: float,
    weather: WeatherStream,
    codes: NDArray[np.int16],
    factors: Floats,
) -> AnyAngleFire:
    """Return a fire at a time, from its arrival times (y, x), on other fuels (y, x).

    ``factors`` are those of the spread rates of ``FUELS``.
    """
    ground = landscape_with(codes)
    place = [FUELS.index(code) for code in ground.burnable_codes]
    burning = burning_from_arrival(arrival_s, ground, at_s)
    return AnyAngleFire(ground, weather, []).restarted(burning, 1.0, 0.0, factors[place])


def sector(burned: Mask, towards_deg: float, half_deg: float) -> Mask:
    """Return the mask (y, x) of the unburned cells within an angle of a bearing."""
    row, col = np.indices(burned.shape)
    middle_row, middle_col = np.argwhere(burned).mean(axis=0)
    bearing = np.degrees(np.arctan2(col - middle_col, middle_row - row))
    found: Mask = np.abs((bearing - towards_deg + 180.0) % 360.0 - 180.0) < half_deg
    return found & ~burned


def views(
    arrival_s: Floats,
    rng: np.random.Generator,
    from_s: float,
    to_s: float,
    place: Floats,
    false_alarms: float = FALSE_ALARMS,
) -> Iterator[tuple[Observation, Floats]]:
    """Yield the observations of the camera, each with the camera's next place (row, col)."""
    radius = RADIUS_M / CELL_M
    known_s = np.where(np.isfinite(arrival_s), arrival_s, 1e6)
    for at_s in np.arange(from_s + EVERY_S, to_s + 1e-6, EVERY_S):
        place = _further(arrival_s <= at_s, place, SPEED_M_S * EVERY_S)
        top, left = (max(int(value - radius), 0) for value in place)
        bottom, right = (min(int(value + radius) + 2, CELLS) for value in place)
        row, col = np.mgrid[top:bottom, left:right].astype(float)
        shift = rng.normal(0.0, POSITION_SD_M / CELL_M, 2)
        seen_s = map_coordinates(known_s, [row + shift[0], col + shift[1]], order=0, mode="nearest")
        chance = rng.random(seen_s.shape)
        burned = np.where(seen_s <= at_s, chance >= MISSED, chance < false_alarms)
        state = np.where(burned, BURNED, UNBURNED).astype(np.uint8)
        state[(row - place[0]) ** 2 + (col - place[1]) ** 2 > radius**2] = UNSEEN
        yield (
            Observation(
                float(at_s), top, left, state, POSITION_SD_M, MISSED, false_alarms, "camera"
            ),
            place,
        )


def _further(burned: Mask, place: Floats, distance_m: float) -> Floats:
    """Return the place (row, col) a distance further along the longest outline."""
    lines: Any = contourpy.contour_generator(z=np.pad(burned.astype(float), 1)).lines(0.5)
    if not lines:
        return place
    points = np.asarray(max(lines, key=len))[:, ::-1] - 1.0
    along_m = lengths_along(points) * CELL_M
    here = int(np.argmin(((points - place) ** 2).sum(axis=1)))
    target = (along_m[here] + distance_m) % along_m[-1]
    return np.array([np.interp(target, along_m, points[:, axis]) for axis in (0, 1)])


def run(seed: int, members: int, pool: ThreadPoolExecutor) -> tuple[Floats, list[float]]:
    """Return the scores (times, lengths, scores) of a fire, and the CRPS of its forecasts in s."""
    truth = twin(seed)
    model = model_alone(truth, EVALUATED_S[-1] + AHEAD_S[-1])
    rows, scores_s = [], []
    for estimate, seen in observed(truth, seed, members, pool):
        rows.append(_evaluated(truth, estimate, model, seen, pool))
        scores_s.append(_crps_s(truth, estimate, pool))
    return np.array(rows), scores_s


def model_alone(truth: Twin, until_s: float) -> AnyAngleFire:
    """Return the fire that the estimate's model predicts without observations."""
    fire = AnyAngleFire(truth.landscape, truth.weather, [(*truth.ignition, 0.0)])
    fire.advance(until_s)
    return fire


def observed(
    truth: Twin, seed: int, members: int, pool: ThreadPoolExecutor
) -> Iterator[tuple[FireEstimate, Mask]]:
    """Yield the estimate at each time of evaluation, and the area that was seen burned (y, x)."""
    rng = np.random.default_rng((99, seed))
    estimate = FireEstimate(
        truth.landscape,
        truth.weather,
        [(*truth.ignition, 0.0)],
        EstimateSettings(members, seed, WRONG),
    )
    place, at_s = np.array(truth.ignition, dtype=float), FIRST_VIEW_S
    seen = np.zeros(truth.landscape.shape, dtype=bool)
    estimate.advance(at_s, pool.map)
    while at_s < EVALUATED_S[-1]:
        images = list(views(truth.arrival_s, rng, at_s, at_s + BATCH_S, place))
        place, at_s = images[-1][1], at_s + BATCH_S
        estimate.advance(at_s, pool.map)
        for image, _ in images:
            estimate.assimilate(image, pool.map)
            seen[image.where] |= despeckled(image) == BURNED
        if at_s in EVALUATED_S:
            yield estimate, binary_fill_holes(seen)


def _evaluated(
    truth: Twin, estimate: FireEstimate, model: AnyAngleFire, seen: Mask, pool: ThreadPoolExecutor
) -> list[Scores]:
    forecast = estimate.forecast(estimate.time_s + AHEAD_S[-1], pool.map)
    found = []
    for ahead_s in AHEAD_S:
        at_s = estimate.time_s + ahead_s
        true = truth.arrival_s <= at_s
        probability = forecast.burn_probability(at_s)
        likely = probability >= 0.5
        area = np.count_nonzero(true)
        found.append(
            Scores(
                np.count_nonzero(likely ^ true) / area,
                np.count_nonzero(seen ^ true) / area,
                np.count_nonzero((model.arrival_time_s <= at_s) ^ true) / area,
                np.count_nonzero(true & ~likely) / area,
                np.count_nonzero(likely & ~true) / area,
                coverage(probability, true) or math.nan,
            )
        )
    return found


def _crps_s(truth: Twin, estimate: FireEstimate, pool: ThreadPoolExecutor) -> float:
    times_s = estimate.time_s + np.linspace(0.0, AHEAD_S[-1], CRPS_STEPS)
    forecast = estimate.forecast(float(times_s[-1]), pool.map)
    probabilities = [forecast.burn_probability(float(at_s)) for at_s in times_s]
    return crps_s(probabilities, [truth.arrival_s <= at_s for at_s in times_s], times_s)


def seeds_parser(doc: str | None, members: int) -> argparse.ArgumentParser:
    """Return a parser of the first and last seed, members (with a default) and threads."""
    parser = argparse.ArgumentParser(description=doc)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("--members", type=int, default=members)
    parser.add_argument("--threads", type=int, default=2)
    return parser


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the scores of each seed, and their means."""
    given = seeds_parser(__doc__, 40).parse_args(arguments)
    click.echo(
        "seed  error now/+30/+60 min: estimate, persistence, model; +60 missed, over, in band"
    )
    every, every_crps = [], []
    with ThreadPoolExecutor(given.threads) as pool:
        for seed in range(given.first, given.last + 1):
            found, crps = run(seed, given.members, pool)
            every.append(found.mean(axis=0))
            every_crps.append(float(np.mean(crps)))
            click.echo(_line(f"{seed:4}", every[-1]) + f"  CRPS {every_crps[-1]:.0f} s")
    mean = np.mean(every, axis=0)
    click.echo(_line("mean", mean) + f"  CRPS {np.mean(every_crps):.0f} s")
    ratio = [each[2, 0] / each[2, 1] for each in every]
    click.echo(
        f"+60 min: {mean[2, 0] / mean[2, 1]:.3f} of persistence's mean error, worst fire "
        f"{max(ratio):.2f}; in the 80 % band +30 {mean[1, 5]:.2f}, +60 {mean[2, 5]:.2f}"
    )


def _line(name: str, scores: Floats) -> str:
    parts = ("/".join(f"{value:.3f}" for value in scores[:, column]) for column in (0, 1, 2))
    return f"{name}  {'  '.join(parts)}  {scores[2, 3]:.2f} {scores[2, 4]:.2f} {scores[2, 5]:.2f}"


if __name__ == "__main__":
    main()
