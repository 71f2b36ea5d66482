"""Spot fires: where they begin, how often, and that they are reproducible."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.physics.spotting import canopy_wind_m_s, crown_distance_m, firebrand_flights
from firemodel.physics.weather import WeatherStream
from firemodel.physics.wind_field import field_of
from firemodel.spread.fire_scheme import Fire
from firemodel.spread.schemes import new_fire
from tests.firemodel.grids import CELL_M, weather
from tests.firemodel.test_crown_fire import forest

LIT = (50, 10)
SHAPE = (101, 161)
WIND = WeatherStream([weather(15.0, 270.0)])  # dry, from the west


def burned(
    land: Landscape,
    until_s: float = 3600.0,
    steps: int = 1,
    seed: int = 1,
    wind: WeatherStream = WIND,
    **settings: Any,
) -> Fire:
    """Return a fire in a forest after a time, advanced in equal steps."""
    given: dict[str, Any] = {
        "crown": "scott_reinhardt",
        "spotting": True,
        "firebrands_per_ha": 20.0,
    } | settings
    fire = new_fire("anyangle", land, wind, [(*LIT, 0.0)], seed=seed, **given)
    for step in range(steps):
        fire.advance(until_s * (step + 1) / steps)
    return fire


@pytest.fixture(scope="module")
def wood() -> Landscape:
    """Return a forest with a lake 150 m wide across the way of the fire."""
    land = forest(shape=SHAPE, base_m=0.5, cover=0.2)
    fuel = land.fuel_model.copy()
    fuel[:, 40:45] = 98
    return replace(land, fuel_model=fuel)


@pytest.mark.parametrize("steps", [7, 360])
def test_a_fire_with_firebrands_crosses_water_and_does_not_depend_on_the_steps(
    wood: Landscape, steps: int
) -> None:
    without, once = burned(wood, spotting=False), burned(wood)
    assert without.burned()[:, :40].sum() > 200
    assert not without.burned()[:, 45:].any()
    assert once.burned()[:, 45:].any()
    assert not once.burned()[:, 40:45].any()
    again = burned(wood, steps=steps)
    assert np.array_equal(once.arrival_time_s, again.arrival_time_s)


def test_spot_fires_are_downwind_and_begin_after_the_flight(wood: Landscape) -> None:
    """A cell that burns before its neighbours is a spot fire, or was lit."""
    arrival_s = burned(wood).arrival_time_s
    over = np.argwhere(np.isfinite(arrival_s) & (np.arange(SHAPE[1]) >= 45))
    first = min(arrival_s[row, col] for row, col in over)
    front_at_s = np.nanmin(np.where(np.isfinite(arrival_s[:, 39]), arrival_s[:, 39], np.nan))
    assert first >= 60.0
    assert first < 3600.0
    assert abs(first - front_at_s) < 1800.0
    assert abs(over[:, 0].mean() - LIT[0]) < 25


def test_firebrands_fly_with_the_local_wind(wood: Landscape) -> None:
    """The mean wind is half as fast and turned; the local wind is that of ``WIND``."""
    turned = field_of(np.stack([np.zeros(SHAPE), np.full(SHAPE, 2.0)]))  # twice as fast, by 90°
    wind = WeatherStream([replace(weather(7.5, 180.0), wind_field=turned)])
    local, plain = burned(wood, wind=wind), burned(wood)
    assert plain.burned()[:, 45:].any()
    np.testing.assert_allclose(local.arrival_time_s, plain.arrival_time_s, rtol=1e-6)


def test_seeds_differ_and_copies_continue_alike(wood: Landscape) -> None:
    one, other = burned(wood, seed=1), burned(wood, seed=2)
    assert not np.array_equal(one.arrival_time_s, other.arrival_time_s)
    half = burned(wood, 1800.0)
    copy = half.copy()
    half.advance(3600.0)
    copy.advance(3600.0)
    assert np.array_equal(half.arrival_time_s, copy.arrival_time_s)
    assert np.array_equal(half.arrival_time_s, one.arrival_time_s)
    member = burned(wood, 0.0)
    member.draw_from(np.random.default_rng(3))
    member.advance(3600.0)
    assert not np.array_equal(member.arrival_time_s, one.arrival_time_s)


def test_surface_fires_and_wet_fuel_have_no_spot_fires(wood: Landscape) -> None:
    high = replace(wood, canopy_base_m=np.full(SHAPE, 19.0, dtype=np.float32))
    assert not burned(high).burned()[:, 45:].any()
    assert not burned(wood, firebrands_per_ha=0.0).burned()[:, 45:].any()


def test_flights_are_of_the_published_size() -> None:
    """Most firebrands fly some tens of metres; the maximum is some hundred to some thousand."""
    wind_m_s = canopy_wind_m_s(20.0, 15.0)
    mu, sigma = firebrand_flights(20_000.0, wind_m_s)
    assert 5.0 < np.exp(mu) < 100.0
    assert 0.5 < sigma < 2.0
    assert 5 * CELL_M < crown_distance_m(20.0, 20_000.0, 15.0) < 5_000.0
    slow = firebrand_flights(20_000.0, 1.0)
    assert slow[0] > mu  # driven by buoyancy: lifted higher


def test_spotting_without_crown_fire_is_refused(wood: Landscape) -> None:
    with pytest.raises(FireModelError, match="only burning crowns"):
        new_fire("anyangle", wood, WIND, [], spotting=True)
