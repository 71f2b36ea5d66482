"""Fires from a plan's own drops: no leg returns over them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from firemodel.ellipses.ellipse import EllipseFire, Spread
from mission_service.guidance.burn.lines.flight_constraints import FlightPoint
from mission_service.guidance.burn.lines.line_flight import fly_line
from mission_service.guidance.burn.lines.line_planner import constraints_of, drop_orders, next_line
from mission_service.guidance.burn.lines.sphere_fires import SphereFires
from tests.service.burns import SETTINGS, lights, situation
from tests.service.test_burn_planner import planned

LOW_M, SAFE_M = SETTINGS.drop_height_m, SETTINGS.safe_height_m


@pytest.fixture
def own() -> SphereFires:
    """Return one drop at 100 s, which ignites at 130 s."""
    found = SphereFires(constraints_of(situation(), SETTINGS))
    found.add_drop(100.0, 20.0, 100.0)
    return found


def level(x0_m: float, x1_m: float, at_s: float) -> tuple[FlightPoint, FlightPoint]:
    taken_s = abs(x1_m - x0_m) / SETTINGS.speed_m_s
    return FlightPoint(x0_m, 20.0, LOW_M, at_s), FlightPoint(x1_m, 20.0, LOW_M, at_s + taken_s)


def test_away_from_the_drop_and_straight_up_above_it(own: SphereFires) -> None:
    assert own.margin_s(level(100.0, 160.0, 100.0)) == math.inf
    up = (FlightPoint(100.0, 20.0, LOW_M, 100.0), FlightPoint(100.0, 20.0, SAFE_M, 115.0))
    assert own.margin_s(up) == math.inf
    # Far away for a long time: fire at the start of a leg is not dangerous, for any length of the
    # leg.
    assert own.margin_s(level(100.0, 280.0, 100.0)) == math.inf


def test_not_back_over_it_before_it_ignites(own: SphereFires) -> None:
    back = level(150.0, 60.0, 112.0)
    assert own.margin_s(back) < SETTINGS.time_margin_s
    # Nearer places are dangerous.
    assert own.margin_s(level(150.0, 130.0, 112.0)) > SETTINGS.time_margin_s
    high = tuple(place._replace(height_m=SAFE_M) for place in back)
    assert own.margin_s((high[0], high[1])) == math.inf


def test_not_above_it_when_it_burns(own: SphereFires) -> None:
    late = (FlightPoint(100.0, 20.0, LOW_M, 120.0), FlightPoint(100.0, 20.0, SAFE_M, 135.0))
    assert own.margin_s(late) < 0.0
    # Leaving is allowed, but not from burning ground.
    assert own.margin_s(level(108.0, 120.0, 131.0)) < 0.0


def test_not_down_next_to_it(own: SphereFires) -> None:
    down = (FlightPoint(105.0, 20.0, SAFE_M, 105.0), FlightPoint(105.0, 20.0, LOW_M, 127.5))
    assert own.margin_s(down) < SETTINGS.time_margin_s
    next_to_it = tuple(place._replace(x_m=130.0) for place in down)
    assert own.margin_s((next_to_it[0], next_to_it[1])) > SETTINGS.time_margin_s


def test_a_climb_that_takes_longer_than_the_delay_begins_farther_on() -> None:
    settings = SETTINGS.model_copy(update={"ignition_delay_s": 10.0})
    plan = planned(situation(), settings)
    assert plan.path[-1, 2] == SAFE_M
    away_m = np.hypot(*(plan.path[-1, :2] - plan.drops[-1, :2]))
    assert away_m >= 15.0


def test_no_drop_on_ground_that_an_earlier_drop_will_have_burned() -> None:
    """The fire spreads along the line faster than the vehicle flies."""
    spreads = (Spread(0.0, 12.0, 0.05, 0.05, 0.0),)
    now = replace(situation(), lights=lambda sources: EllipseFire(spreads, sources))
    air, start = (
        constraints_of(now, SETTINGS),
        FlightPoint(now.x_m, now.y_m, now.height_m, now.at_s),
    )
    line = planned(now).line
    west, east = (
        fly_line(air, start, places, 450, 1e4)
        for places in drop_orders(now, SETTINGS, now.area, line)
    )
    assert len(west.drops) == 19  # beginning in the east, away from the fire
    assert len(east.drops) < 19
    burns = east.drops + np.array([0.0, 0.0, SETTINGS.ignition_delay_s])
    comes_s = EllipseFire(spreads, burns).ignition_time_s(burns[:, :2])
    assert comes_s == pytest.approx(burns[:, 2])


def test_lights_are_asked_for_all_that_was_lit() -> None:
    """Drops of an earlier plan count as fires, so no drop is planned on them or beside them."""
    lit = np.array([[x, 20.0, 100.0] for x in range(10, 280, 15)])
    plan = next_line(situation(fire=lights(lit)), SETTINGS)
    places = getattr(plan, "drops", np.empty((0, 3)))[:, :2]
    away = np.abs(places[:, 1] - 20.0)
    assert (away > SETTINGS.distance_margin_m).all()
