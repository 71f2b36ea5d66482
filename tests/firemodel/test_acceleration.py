"""Acceleration of new fires: the equations, and fires with a rate that depends on their age."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from firemodel.ensemble.draws import latin_draws
from firemodel.ensemble.member_fires import Start
from firemodel.ensemble.uncertainty import Uncertainty
from firemodel.physics.acceleration import (
    LINE_PER_S,
    POINT_PER_S,
    rate_share,
    steady_time_s,
    time_since_s,
)
from firemodel.physics.weather import WeatherStream
from firemodel.spread.behaviour import behaviour_of
from firemodel.spread.burning import burning_from_perimeter
from firemodel.spread.fire_scheme import Fire, Ignition
from firemodel.spread.schemes import SPOT_FIRE_DELAY_S, SchemeName, new_fire
from tests.firemodel.grids import landscape, steady, weather
from tests.firemodel.test_crown_fire import forest

SCHEMES: tuple[SchemeName, ...] = ("anyangle", "devs8")
WIND = steady(4.0, 240.0)
CHANGING = WeatherStream(
    [
        weather(4.0, 240.0),
        weather(2.0, 300.0, at_s=300.0),
        weather(5.0, 200.0, at_s=700.0),
        weather(3.0, 240.0, at_s=2400.0),
    ]
)
MIDDLE = (30, 30, 0.0)


def burned(
    scheme: SchemeName,
    lit: list[Ignition],
    until_s: float,
    stream: WeatherStream = WIND,
    steps: int = 1,
    **settings: Any,
) -> Fire:
    """Return a fire in grass after a time, advanced in equal steps."""
    settings = {"acceleration": True} | settings
    fire = new_fire(scheme, landscape(2, shape=(61, 61)), stream, lit, **settings)
    for step in range(steps):
        fire.advance(until_s * (step + 1) / steps)
    return fire


def test_a_point_source_has_90_percent_of_its_rate_after_20_minutes() -> None:
    assert rate_share(0.0, POINT_PER_S) == 0.0
    assert rate_share(1200.0, POINT_PER_S) == pytest.approx(0.8997, abs=1e-4)
    assert rate_share(480.0, LINE_PER_S) == pytest.approx(1.0 - math.exp(-2.4))


@pytest.mark.parametrize("since_s", [1e-6, 0.5, 20.0, 521.0, 3600.0, 1e6])
def test_the_clock_is_the_integral_of_the_share_and_can_be_inverted(since_s: float) -> None:
    times_s = np.linspace(0.0, since_s, 2001)
    shares = [rate_share(float(time_s), POINT_PER_S) for time_s in times_s]
    integral_s = np.trapezoid(shares, times_s)
    steady_s = steady_time_s(since_s, POINT_PER_S)
    assert steady_s == pytest.approx(integral_s, rel=2e-3)
    assert time_since_s(steady_s, POINT_PER_S) == pytest.approx(since_s, rel=1e-6)
    assert time_since_s(math.inf, POINT_PER_S) == math.inf == steady_time_s(math.inf, 1.0)
    assert time_since_s(0.0, POINT_PER_S) == 0.0


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize(
    ("lit", "per_s"),
    [([MIDDLE], POINT_PER_S), ([(30, col, 0.0) for col in range(25, 35)], LINE_PER_S)],
)
def test_arrival_times_are_those_of_a_steady_fire_on_the_clock(
    scheme: SchemeName, lit: list[Ignition], per_s: float
) -> None:
    found = burned(scheme, lit, 3000.0)
    steady_fire = burned(scheme, lit, 3000.0, acceleration=False)
    cells = found.burned()
    assert 50 < cells.sum() < steady_fire.burned().sum()
    expected_s = [time_since_s(each, per_s) for each in steady_fire.arrival_time_s[cells]]
    assert found.arrival_time_s[cells] == pytest.approx(np.array(expected_s), rel=1e-9)
    later = steady_fire.arrival_time_s > steady_time_s(3000.0, per_s)
    assert (cells == ~later).all()


@pytest.mark.parametrize("scheme", SCHEMES)
def test_weather_changes_at_its_own_time(scheme: SchemeName) -> None:
    """After a change at 700 s the fire is a steady fire in weather that changes on the clock."""
    found = burned(scheme, [MIDDLE], 3000.0, CHANGING)
    on_clock = WeatherStream(
        [
            replace(entry, at_s=steady_time_s(entry.at_s, POINT_PER_S))
            for entry in CHANGING.changes()
        ]
    )
    expected = burned(
        scheme, [MIDDLE], steady_time_s(3000.0, POINT_PER_S), on_clock, acceleration=False
    )
    assert (found.burned() == expected.burned()).all()
    assert not (found.burned() == burned(scheme, [MIDDLE], 3000.0, WIND).burned()).all()


@pytest.mark.parametrize("scheme", SCHEMES)
def test_each_ignition_has_its_own_clock(scheme: SchemeName) -> None:
    lit: list[Ignition] = [(20, 20, 0.0), (45, 45, 1500.0)]
    both = burned(scheme, lit, 3000.0, CHANGING)
    alone = [burned(scheme, [each], 3000.0, CHANGING) for each in lit]
    expected_s = np.minimum(*(each.burned_arrival_s() for each in alone))
    assert np.array_equal(both.burned_arrival_s(), expected_s)
    assert all(each.burned().sum() > 5 for each in alone)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_neither_steps_nor_copies_nor_later_lighting_change_the_fire(scheme: SchemeName) -> None:
    lit: list[Ignition] = [(20, 20, 0.0), (20, 21, 0.0), (45, 45, 1500.0), (46, 46, 1500.0)]
    once = burned(scheme, lit, 3000.0, CHANGING)
    assert np.array_equal(
        once.arrival_time_s, burned(scheme, lit, 3000.0, CHANGING, 37).arrival_time_s
    )
    fire = burned(scheme, lit[:2], 1400.0, CHANGING)
    other = fire.copy()
    other.light(*lit[2])  # before its time
    other.advance(1500.0)
    other.light(*lit[3])  # at its time: both cells together are a line
    other.advance(3000.0)
    assert np.array_equal(once.burned_arrival_s(), other.burned_arrival_s())
    fire.advance(3000.0)
    assert not np.array_equal(once.burned(), fire.burned())
    assert (once.expected_s()[once.burned()] == once.arrival_time_s[once.burned()]).all()
    assert once.front(3000.0).area > once.front(1500.0).area > 0.0


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_mapped_perimeter_is_not_a_new_fire_but_later_ignitions_are(scheme: SchemeName) -> None:
    land = landscape(2, shape=(61, 61))
    first = burned(scheme, [MIDDLE], 1800.0)
    burning = burning_from_perimeter([first.front(1800.0)], land, 1800.0)
    steady_fire = new_fire(scheme, land, WIND, [], burning)
    again = new_fire(scheme, land, WIND, [(5, 5, 2000.0)], burning, acceleration=True)
    assert again.time_s == 1800.0
    for fire in (steady_fire, again):
        fire.advance(2600.0)
    around = np.isfinite(again.arrival_time_s[:15, :15])
    assert 0 < around.sum() < 20
    alone = new_fire(scheme, land, WIND, [(5, 5, 2000.0)], acceleration=True)
    alone.advance(2600.0)
    expected_s = np.minimum(steady_fire.burned_arrival_s(), alone.burned_arrival_s())
    assert np.array_equal(again.burned_arrival_s(), expected_s)
    assert again.front(2600.0).area > steady_fire.front(2600.0).area


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_cell_that_has_burned_is_not_lit_again(scheme: SchemeName) -> None:
    fire = burned(scheme, [MIDDLE], 1800.0)
    before = fire.copy()
    fire.light(30, 30, 2000.0)
    for each in (fire, before):
        each.advance(3000.0)
    assert np.array_equal(fire.arrival_time_s, before.arrival_time_s)


def test_rate_and_intensity_are_those_of_the_age() -> None:
    fire = burned("anyangle", [MIDDLE], 3000.0)
    steady_fire = burned("anyangle", [MIDDLE], 3000.0, acceleration=False)
    found, expected = behaviour_of(fire), behaviour_of(steady_fire)
    cells = fire.burned()
    share = np.array([rate_share(each, POINT_PER_S) for each in fire.arrival_time_s[cells]])
    for name in ("spread_rate_m_s", "intensity_kw_m"):
        steady_values = getattr(expected, name)[cells]
        assert getattr(found, name)[cells] == pytest.approx(share * steady_values, rel=1e-4)
    assert found.spread_rate_m_s[30, 30] == 0.0
    assert found.toward_deg[cells] == pytest.approx(expected.toward_deg[cells], abs=1e-3)


def test_members_of_an_ensemble_accelerate_like_their_fire() -> None:
    """A member without errors is the fire, though its cells are lit one after another."""
    lit: list[Ignition] = [(30, col, 0.0) for col in range(25, 35)]
    fire = burned("anyangle", lit, 2000.0, CHANGING)
    start = Start(burned("anyangle", [], 0.0, CHANGING), lit)
    draw = latin_draws(Uncertainty(*[0.0] * 6), 1, 1, start.fuels)[0]
    member = start.member(draw, np.random.default_rng(0))
    member.advance(2000.0)
    assert np.array_equal(member.burned(), fire.burned())
    flame_m = start.window(member, draw).flame_m
    expected_m = behaviour_of(fire).flame_length_m[fire.burned()]
    assert flame_m[np.isfinite(flame_m)] == pytest.approx(expected_m, rel=2e-2)
    perturbed = start.member(draw._replace(wind_factor=1.5), np.random.default_rng(0))
    perturbed.advance(2000.0)
    assert perturbed.burned().sum() > member.burned().sum()


def test_spot_fires_begin_later() -> None:
    land = forest(shape=(61, 121), base_m=0.5, cover=0.2)
    land.fuel_model[:, 40:45] = 98
    first_s, arrivals = [], []
    for accelerates, steps in ((False, 1), (True, 1), (True, 17)):
        fire = new_fire(
            "anyangle",
            land,
            steady(15.0, 270.0),
            [(30, 10, 0.0)],
            seed=1,
            crown="scott_reinhardt",
            spotting=True,
            firebrands_per_ha=20.0,
            acceleration=accelerates,
        )
        for step in range(steps):
            fire.advance(5400.0 * (step + 1) / steps)
        first_s.append(float(fire.arrival_time_s[:, 45:].min()))
        arrivals.append(fire.burned_arrival_s())
    assert np.array_equal(arrivals[1], arrivals[2])
    # Later still, because spot fires in front of the water slow the fire down, too.
    first_possible_s = time_since_s(first_s[0] + SPOT_FIRE_DELAY_S, POINT_PER_S)
    assert first_possible_s <= first_s[1] < 5400.0
