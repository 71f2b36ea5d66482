"""Danger on the raster, compared with its definition at each place."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from firemodel.ellipses.ellipse import EllipseFire, Spread
from mission_service.errors import MissionServiceError
from mission_service.guidance.burn.lines.hazard import Floats, Hazard, Margins, cell_for, hazard_of
from mission_service.guidance.burn.lines.sphere_fires import fastest_m_s
from mission_service.guidance.burn.whole_burn import CombinedFires
from tests.service.burns import Formula

BOX = (0.0, 0.0, 60.0, 60.0)
CALM = Margins(60.0, 10.0, 0.0, 0.0, 120.0)


def never(x: Floats, y: Floats) -> Floats:
    return np.full(len(x), np.inf)


def front_at(speed_m_s: float) -> Callable[[Floats, Floats], Floats]:
    """Return a front that moves from x = 0 to the east."""
    return lambda x, y: x / speed_m_s


def brute(fire: Formula | EllipseFire, margins: Margins, x: float, y: float, at_s: float) -> float:
    """Return the smallest margin by the definition, on a grid of 0.4 m."""
    far = margins.reach_m
    away = np.arange(-far, far + 0.4, 0.4)
    places = np.stack([np.tile(x + away, away.size), np.repeat(y + away, away.size)], axis=1)
    if isinstance(fire, EllipseFire):
        places = np.concatenate([places, fire.sources[:, :2]])
    back = np.array([x, y]) - places
    distance = np.hypot(*back.T)
    toward = np.array([math.cos(margins.toward_rad), math.sin(margins.toward_rad)])
    downwind = np.maximum(back @ toward, 0.0) / np.maximum(distance, 1e-9)
    near = distance <= margins.distance_m + margins.wind_m * downwind
    times = fire.ignition_time_s(places[near])
    times = times[times > at_s - margins.residence_s]
    return float(times.min(initial=math.inf)) - at_s


def in_danger(hazard: Hazard, x_m: float, y_m: float, at_s: float) -> bool:
    """Return whether a vehicle at this place and time is in danger."""
    fix = (x_m, y_m, at_s)
    return hazard.leg_margin_s(*fix, *fix) < hazard.margins.time_s


@pytest.mark.parametrize("speed_m_s", [0.01, 0.5])
def test_a_front_is_danger_from_its_margin_on_until_it_has_burned_out(speed_m_s: float) -> None:
    hazard = hazard_of(Formula(front_at(speed_m_s)), BOX, CALM)

    def danger(x_m: float, at_s: float) -> bool:
        return in_danger(hazard, x_m, 30.0, at_s)

    # At x = 30, x = 20 burns first of all places within 10 m, and x = 40 last.
    first_s, last_s = 20.0 / speed_m_s, 40.0 / speed_m_s
    spare_s = 3.0 * hazard.cell_m / speed_m_s
    assert danger(30.0, first_s - 59.0)
    assert danger(30.0, last_s + 119.0)
    assert not danger(30.0, first_s - 61.0 - spare_s)
    assert not danger(30.0, last_s + 121.0 + spare_s)


def test_the_margin_reaches_farther_downwind() -> None:
    """There is a line of fire at x = 30; downwind is to the east."""
    wall = Formula(lambda x, y: np.where(np.abs(x - 30.0) < 2.0, 100.0, 1e6))
    hazard = hazard_of(wall, BOX, Margins(60.0, 6.0, 8.0, 0.0, 120.0))
    assert in_danger(hazard, 45.0, 30.0, 100.0)
    assert not in_danger(hazard, 15.0, 30.0, 100.0)
    assert in_danger(hazard, 22.5, 30.0, 100.0)


@pytest.mark.parametrize("seed", range(8))
def test_the_raster_never_misses_what_is_in_danger(seed: int) -> None:
    """The fires are small and slow, lie between nodes or meet at ridges, in any wind."""
    random = np.random.default_rng(seed)
    toward = float(random.uniform(-math.pi, math.pi))
    back = float(random.choice([0.01, 0.1]))
    spreads = [Spread(0.0, back * float(random.uniform(1, 20)), back, back, toward)]
    if seed % 3 == 0:  # the fire is very slow until the wind begins
        spreads = [Spread(-1000.0, 0.004, 0.004, 0.004, 0.0), spreads[0]._replace(from_s=50.0)]
    count = int(random.integers(1, 4))
    sources = np.column_stack([random.uniform(0, 60, (count, 2)), random.uniform(-200, 200, count)])
    fire = EllipseFire(spreads, sources)
    margins = Margins(
        *(float(random.uniform(0, 60)), float(random.uniform(0, 12))),
        *(float(random.uniform(0, 8)), toward, float(random.uniform(0, 100))),
    )
    hazard = hazard_of(fire, BOX, margins, begins_s=float(sources[:, 2].min()))
    x, y, at_s = *random.uniform(0, 60, (2, 40)), random.uniform(-200, 400, 40)
    samples = np.stack([x, y, at_s], axis=1).tolist()
    found = np.array([hazard.leg_margin_s(*place, *place) for place in samples])
    dense = np.array([brute(fire, margins, x, y, at_s) for x, y, at_s in samples])
    assert (found <= dense + 1e-6).all()
    # The raster is not much larger: each place that it marks is within three cells of danger.
    spare_s = 3.0 * hazard.cell_m / back
    wide = Margins(
        margins.time_s,
        margins.distance_m + 3.0 * hazard.cell_m,
        margins.wind_m,
        toward,
        margins.residence_s + spare_s,
    )
    wider = np.array([brute(fire, wide, x, y, at_s) for x, y, at_s in samples])
    assert (wider[found < margins.time_s] < margins.time_s + spare_s).all()


def test_a_leg_is_in_danger_where_any_of_its_samples_is() -> None:
    """The only fire is at one place, and is lit when the vehicle passes between two samples."""
    spread = [Spread(0.0, 0.001, 0.001, 0.001, 0.0)]
    fire = EllipseFire(spread, np.array([[30.0, 38.0, 50.0]]))
    hazard = hazard_of(fire, BOX, Margins(10.0, 8.5, 0.0, 0.0, 20.0))
    assert hazard.leg_margin_s(0.0, 30.0, 40.0, 60.0, 30.0, 52.0) < 10.0
    assert hazard.leg_margin_s(0.0, 10.0, 40.0, 60.0, 10.0, 52.0) > 1000.0
    # On a vertical leg the whole time counts.
    assert hazard.leg_margin_s(30.0, 30.0, 10.0, 30.0, 30.0, 45.0) < 10.0
    assert hazard.leg_margin_s(30.0, 30.0, -3000.0, 30.0, 30.0, -2900.0) > 10.0


@pytest.mark.parametrize("wrap", [lambda fire: fire, lambda fire: CombinedFires([fire])])
def test_a_fire_smaller_than_a_cell_is_represented_by_its_source(wrap: Callable[..., Any]) -> None:
    """The fire is very small for 200 s; then wind drives it to the corners of its cell."""
    slow, fast = Spread(0.0, 1e-4, 1e-4, 1e-4, 0.0), Spread(200.0, 5.0, 5.0, 5.0, 0.0)
    hazard = hazard_of(wrap(EllipseFire([slow, fast], np.array([[30.4, 30.9, 0.0]]))), BOX, CALM)
    assert in_danger(hazard, 30.0, 40.0, 5.0)
    assert not in_danger(hazard, 30.0, 55.0, 5.0)


def test_no_fire_is_faster_than_its_fastest() -> None:
    random = np.random.default_rng(5)
    spreads = [Spread(0.0, 0.4, 0.02, 0.3, 1.0), Spread(60.0, 0.1, 0.05, 0.5, 2.0)]
    fire = EllipseFire(spreads, np.array([[0.0, 0.0, 0.0]]))
    xy = random.uniform(-60, 60, (500, 2))
    assert (np.hypot(*xy.T) <= fastest_m_s(fire) * fire.ignition_time_s(xy) + 1e-9).all()
    assert fastest_m_s(Formula(never)) == math.inf


def test_what_lies_beyond_the_raster_is_in_danger() -> None:
    hazard = hazard_of(Formula(never), BOX, CALM)
    assert hazard.leg_margin_s(0.0, 0.0, 0.0, 60.0, 60.0, 10.0) == math.inf
    assert hazard.leg_margin_s(0.0, 0.0, 0.0, 90.0, 60.0, 10.0) == -math.inf


def test_cells_by_size_and_budget() -> None:
    acres = (0.0, 0.0, 284.5, 284.5)
    assert 1.5 < cell_for(acres, CALM) < 2.4
    assert cell_for(BOX, CALM) == 1.5
    assert cell_for((0.0, 0.0, 5000.0, 5000.0), CALM) == pytest.approx(10.0 / 3.0)


def test_times_that_are_no_numbers_are_refused() -> None:
    hazard = hazard_of(Formula(lambda x, y: np.where(x > 30.0, np.nan, 0.0)), BOX, CALM)
    with pytest.raises(MissionServiceError, match="not a number"):
        hazard.leg_margin_s(0.0, 0.0, 0.0, 60.0, 60.0, 10.0)


def test_the_order_in_which_legs_are_asked_does_not_matter() -> None:
    random = np.random.default_rng(3)
    fire = EllipseFire([Spread(0.0, 0.3, 0.02, 0.05, 1.0)], random.uniform(0, 200, (9, 3)))
    box = (0.0, 0.0, 200.0, 200.0)
    legs = random.uniform(0, 200, (40, 6)).tolist()
    one, other = hazard_of(fire, box, CALM), hazard_of(fire, box, CALM)
    found = [one.leg_margin_s(*leg) for leg in legs]
    assert found == [other.leg_margin_s(*leg) for leg in legs[::-1]][::-1]
    assert len(set(found)) > 20
