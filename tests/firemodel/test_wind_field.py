"""Fires in a wind that differs from place to place."""

import copy
import math
import pickle
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from firemodel.assimilation.learned_inputs import FrontParts, LearnedInputs
from firemodel.ensemble.draws import Draw
from firemodel.ensemble.member_fires import Start
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.physics.wind_field import WindField, WindGrids, field_of, mean_wind
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.behaviour import behaviour_of
from firemodel.spread.crown_winds import crown_winds_of
from firemodel.spread.fire_scheme import Fire
from firemodel.spread.schemes import SchemeName, new_fire
from tests.firemodel.grids import landscape, weather
from tests.firemodel.spread_fields import spread_fields

ROWS, COLS = 60, 60
MIDDLE = (30, 30, 0.0)


def ratio(real: float | NDArray[np.floating] = 1.0, imaginary: float = 0.0) -> NDArray[np.floating]:
    """Return a ratio (2, y, x) on the landscape of these tests."""
    return np.stack([np.broadcast_to(part, (ROWS, COLS)) for part in (real, imaginary)])


@pytest.fixture(name="hills")
def _hills() -> Landscape:
    row, col = np.indices((ROWS, COLS))
    heights = 60.0 * np.sin(row / 9.0) * np.cos(col / 7.0)
    land = landscape(np.where((row // 15 + col // 15) % 2, 2, 10), heights)
    cover = np.where(col % 4, 0.1, 0.0).astype(np.float32)
    density = np.full(cover.shape, 0.15, np.float32)
    return replace(
        land,
        canopy_cover=cover,
        canopy_height_m=np.full(cover.shape, 15.0, np.float32),
        canopy_base_m=np.full(cover.shape, 1.0, np.float32),
        canopy_bulk_density_kg_m3=density,
    )


def burned(
    land: Landscape, entries: Sequence[Weather], scheme: SchemeName, settings: dict[str, Any]
) -> Fire:
    """Return a fire after an hour."""
    fire = new_fire(scheme, land, WeatherStream(entries), [MIDDLE], **settings)
    fire.advance(3600.0)
    return fire


CROWNS = {"crown": "scott_reinhardt", "spotting": True, "firebrands_per_ha": 50.0}


@pytest.mark.parametrize(
    ("scheme", "settings"),
    [("anyangle", {}), ("anyangle", CROWNS), ("devs8", {"crown": "cruz"})],
)
def test_a_ratio_of_one_changes_nothing(
    hills: Landscape, scheme: SchemeName, settings: dict[str, Any]
) -> None:
    entries = weather(9.0, 240.0), replace(weather(6.0, 290.0), at_s=1200.0)
    field = field_of(ratio())
    with_field = [replace(entry, wind_field=field) for entry in entries]
    plain, found = (burned(hills, each, scheme, settings) for each in (entries, with_field))
    assert np.count_nonzero(plain.burned()) > 100
    np.testing.assert_array_equal(found.arrival_time_s, plain.arrival_time_s)
    for one, other in zip(behaviour_of(found), behaviour_of(plain), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("settings", [{}, CROWNS])
def test_a_field_turned_by_90_degrees_equals_a_turned_wind(
    hills: Landscape, settings: dict[str, Any]
) -> None:
    turned = replace(weather(9.0, 240.0), wind_field=field_of(ratio(0.0, 0.5)))
    plain, found = (
        burned(hills, [each], "anyangle", settings) for each in (weather(4.5, 330.0), turned)
    )
    np.testing.assert_allclose(found.arrival_time_s, plain.arrival_time_s, rtol=1e-9)


def test_the_torching_index_is_that_of_the_local_wind_direction(hills: Landscape) -> None:
    turned = replace(weather(9.0, 240.0), wind_field=field_of(ratio(0.0, 0.5)))
    found, plain, other = (
        crown_winds_of(new_fire("anyangle", hills, WeatherStream([each]), [], crown="rothermel"))
        for each in (turned, weather(4.5, 330.0), weather(4.5, 240.0))
    )
    np.testing.assert_allclose(found.torching_m_s, plain.torching_m_s, rtol=1e-5)
    assert (found.torching_m_s != other.torching_m_s).mean() > 0.5


def test_each_half_spreads_in_its_own_wind(hills: Landscape) -> None:
    """In every cell, spread is that of a uniform wind with the cell's speed and direction."""
    factors = np.where(np.arange(COLS) < 30, 1.0, 2.0)
    both = replace(weather(4.0, 200.0), wind_field=field_of(ratio(factors)))
    found, slow, fast = (
        np.stack(spread_fields(hills, each))
        for each in (both, weather(4.0, 200.0), weather(8.0, 200.0))
    )
    np.testing.assert_array_equal(found[..., :30], slow[..., :30])
    np.testing.assert_array_equal(found[..., 30:], fast[..., 30:])
    assert (fast[0] > slow[0]).mean() > 0.9


def test_fire_beside_a_faster_half_is_not_that_of_one_wind() -> None:
    """On level grass, where cells of one fuel are alike, the scheme still sees both winds."""
    level, east = landscape(shape=(ROWS, COLS)), np.where(np.arange(COLS) < 30, 0.5, 2.0)
    field = replace(weather(2.0, 270.0), wind_field=field_of(ratio(east)))
    found = AnyAngleFire(level, WeatherStream([field]), [(30, 20, 0.0)])
    slow = AnyAngleFire(level, WeatherStream([weather(1.0, 270.0)]), [(30, 20, 0.0)])
    for fire in (found, slow):
        fire.advance(4 * 3600.0)
    np.testing.assert_allclose(
        found.arrival_time_s[30, 20:30], slow.arrival_time_s[30, 20:30], rtol=1e-6
    )
    assert found.arrival_time_s[30, 45] < 0.7 * slow.arrival_time_s[30, 45]


def test_errors_of_the_wind_apply_on_top_of_the_field(hills: Landscape) -> None:
    field = field_of(ratio(np.linspace(0.5, 1.5, COLS), 0.3))
    one = replace(weather(6.0, 250.0), wind_field=field)
    changed = AnyAngleFire(hills, WeatherStream([one]), [MIDDLE])
    changed.perturb(1.5, 40.0, 1.0)
    other = replace(one, wind_speed_m_s=9.0, wind_from_deg=290.0)
    expected = AnyAngleFire(hills, WeatherStream([other]), [MIDDLE])
    for fire in (changed, expected):
        fire.advance(3600.0)
    np.testing.assert_allclose(changed.arrival_time_s, expected.arrival_time_s, rtol=1e-6)
    assert np.count_nonzero(expected.burned()) > 30


def test_the_flame_length_of_a_member_is_computed_in_the_local_wind(hills: Landscape) -> None:
    field = field_of(ratio(np.linspace(0.5, 1.5, COLS), 0.3))
    stream = WeatherStream([replace(weather(6.0, 250.0), wind_field=field)])
    start = Start(AnyAngleFire(hills, stream, [MIDDLE]))
    draw = Draw(1.2, 10.0, 1.0, 1.0, 0.0, 0.0, (1.0,) * start.fuels)
    fire = start.member(draw, np.random.default_rng(0))
    fire.advance(1800.0)
    window = start.window(fire, draw)
    rows, cols = window.flame_m.shape
    here = np.s_[window.top : window.top + rows, window.left : window.left + cols]
    blown = replace(stream.entries[0], wind_speed_m_s=7.2, wind_from_deg=260.0)
    other = AnyAngleFire(hills, WeatherStream([blown]), [MIDDLE])
    other.advance(1800.0)
    expected = behaviour_of(other).flame_length_m[here]
    some = np.isfinite(window.flame_m)
    assert some.sum() > 20
    np.testing.assert_allclose(window.flame_m[some], expected[some], rtol=1e-4)


def test_learned_winds_apply_on_top_of_the_field(hills: Landscape) -> None:
    field = field_of(ratio(0.5))
    parts = FrontParts(np.array([30, 31]), np.array([20, 40]), np.zeros(2), np.ones(2))
    speeds = [
        LearnedInputs(hills, 0.0).speeds_m_s(parts, WeatherStream([entry]), 0.0)
        for entry in (replace(weather(8.0, 270.0), wind_field=field), weather(4.0, 270.0))
    ]
    np.testing.assert_allclose(speeds[0], speeds[1], rtol=1e-12)
    assert (speeds[0] > 0.0).all()


def test_a_fire_continues_in_the_fields_of_another_model(hills: Landscape) -> None:
    """The grids of the model are numbered differently from those of the fire."""
    fields = [field_of(ratio(factor)) for factor in (0.5, 1.5, 2.5)]
    entries = [
        replace(weather(4.0, 250.0), at_s=at_s, wind_field=field)
        for at_s, field in zip((0.0, 600.0, 1200.0), fields, strict=True)
    ]
    stream = WeatherStream(entries)
    fire, model = (AnyAngleFire(hills, each, [MIDDLE]) for each in (stream, stream.since(1300.0)))
    fire.advance(1300.0)
    found, expected = fire.continued(model), fire.copy()
    expected.perturb(1.0, 0.0, 1.0)
    for each in (found, expected):
        each.advance(2400.0)
    np.testing.assert_allclose(found.arrival_time_s, expected.arrival_time_s, rtol=1e-6)


def test_fire_in_a_sum_of_two_grids_is_that_of_their_ratio(hills: Landscape) -> None:
    west, north = np.linspace(5.0, 9.0, COLS), np.linspace(2.0, 6.0, COLS)
    grids = WindGrids(np.stack([ratio(0.0) + [[[0.0]], [[1.0]]] * west, ratio(north)]))
    between = mean_wind(grids, ((0, 0.7), (1, 0.3)))
    assert between.field is not None
    entry = weather(between.speed_m_s, hills.true_deg(between.toward_grid_deg + 180.0))
    found, expected = (
        burned(hills, [replace(entry, wind_field=field)], "anyangle", {})
        for field in (between.field, field_of(between.field.ratio()))
    )
    np.testing.assert_allclose(found.arrival_time_s, expected.arrival_time_s, rtol=1e-5)
    local = spread_fields(hills, replace(entry, wind_field=between.field))
    wind = 0.7j * west + 0.3 * north
    for col in (0, 30, 59):
        from_deg = hills.true_deg(math.degrees(np.angle(wind[col])) + 180.0)
        plain = spread_fields(hills, weather(abs(wind[col]), from_deg))
        np.testing.assert_allclose(
            np.stack(local)[..., col], np.stack(plain)[..., col], rtol=1e-5, atol=1e-6
        )


def test_the_mean_wind_of_grids() -> None:
    half = np.where(np.arange(COLS) < 30, 1.0, 3.0)
    grids = WindGrids(np.stack([ratio(0.0 * half, 1.0) * half, ratio(half)]))
    east, north = mean_wind(grids, ((0, 1.0),)), mean_wind(grids, ((1, 1.0),))
    assert east[:2] == pytest.approx((2.0, 90.0))
    assert north[:2] == pytest.approx((2.0, 0.0))
    between = mean_wind(grids, ((0, 0.5), (1, 0.5)))
    assert between[:2] == pytest.approx((math.sqrt(2.0), 45.0))
    assert between.field is not None
    np.testing.assert_allclose(between.field.ratio()[0, 0], half / 2.0, rtol=1e-6)
    np.testing.assert_allclose(between.field.ratio()[1], 0.0, atol=1e-6)


def test_the_mean_of_calm_air_and_of_opposing_winds() -> None:
    sides = np.where(np.arange(COLS) < 30, -2.0, np.nextafter(np.float32(2.0), np.float32(0.0)))
    grids = WindGrids(np.stack([ratio(0.0), ratio(sides)]))
    assert mean_wind(grids, ((0, 1.0),)) == (0.0, 0.0, None)
    opposed = mean_wind(grids, ((1, 1.0),))
    assert opposed[:2] == pytest.approx((2.0, 0.0))
    assert opposed.field is not None
    np.testing.assert_allclose(opposed.field.ratio()[0, 0], sides / 2.0, rtol=1e-6)


def test_entries_with_fields_compare_and_can_be_pickled() -> None:
    one, other = field_of(ratio()), field_of(ratio())
    entry = replace(weather(4.0), wind_field=one)
    assert entry == replace(entry, wind_field=one)
    assert entry != replace(entry, wind_field=other)
    stream = WeatherStream([entry, replace(entry, at_s=60.0)])
    assert len(stream.changes()) == 1
    back = pickle.loads(pickle.dumps(copy.deepcopy(stream)))
    assert back.entries[0].wind_field.grids is back.entries[1].wind_field.grids
    np.testing.assert_array_equal(back.entries[0].wind_field.ratio(), ratio())
    blown = stream.blown(7.0, 90.0, 30.0).weather_at(30.0)
    assert (blown.wind_speed_m_s, blown.wind_field) == (7.0, one)


def test_invalid_fields_are_refused(hills: Landscape) -> None:
    with pytest.raises(FireModelError, match=r"must have \(grids, 2, rows, columns\)"):
        field_of(np.ones((3, 4, 4)))
    with pytest.raises(FireModelError, match="not finite"):
        field_of(ratio(math.nan))
    with pytest.raises(FireModelError, match="grids 0 to 0"):
        WindField(WindGrids(ratio()[None]), ((1, 1.0 + 0.0j),))
    small = replace(weather(4.0), wind_field=field_of(np.ones((2, 5, 5))))
    with pytest.raises(FireModelError, match="read the wind with this landscape"):
        AnyAngleFire(hills, WeatherStream([small]), [MIDDLE])
