"""The any-angle scheme where fuels meet: the same fire on smaller cells of the same fuels."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.mixed_fuel import FUELS, burned_ha, cut, duration_s, flat, middle
from firemodel.physics.weather import WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.burning import burning_from_arrival
from tests.firemodel.grids import landscape, steady, weather
from tests.firemodel.test_anyangle import ellipse_s, wind_for


def patches(seed: int) -> NDArray[np.int64]:
    """Return random fuels in patches."""
    return np.random.default_rng(seed).choice(FUELS, (31, 31))


@pytest.mark.parametrize(("precise", "worst"), [(False, 0.02), (True, 0.012)])
@pytest.mark.parametrize("seed", [11, 12])
def test_smaller_cells_burn_the_same_area(seed: int, precise: bool, worst: float) -> None:
    stream = steady(5.0, 250.0)
    land = cut(flat(patches(seed), 120.0), 5)
    end_s = duration_s(land, stream, 0.4)
    area, fine = (burned_ha(cut(land, n), stream, end_s, precise) for n in (1, 3))
    assert area.whole_ha > 100.0
    assert area == pytest.approx(fine, rel=worst)


@pytest.mark.parametrize("precise", [False, True])
@pytest.mark.parametrize("direction_deg", [0.0, 30.0, 45.0])
def test_fire_runs_along_a_strip_of_one_cell(direction_deg: float, precise: bool) -> None:
    steps, angle = np.arange(0.0, 26.0, 0.01), math.radians(direction_deg)
    codes = np.full((61, 61), 8)
    rows = (30.5 - steps * math.sin(angle)).astype(int)
    cols = (30.5 + steps * math.cos(angle)).astype(int)
    codes[rows, cols] = 1
    found = []
    for pieces in (1, 5):
        land = cut(flat(codes, 30.0), pieces)
        fire = AnyAngleFire(land, steady(), [middle(land)], precise=precise)
        end = (pieces * rows[-1] + pieces // 2, pieces * cols[-1] + pieces // 2)
        while not fire.burned()[end]:
            fire.advance(fire.time_s + 500.0)
        found.append(fire.arrival_time_s[end])
    assert found[0] == pytest.approx(found[1], rel=0.01)


@pytest.mark.parametrize(("precise", "worst"), [(False, 0.02), (True, 0.01)])
@pytest.mark.parametrize("mixed", [False, True])
def test_changes_of_weather_without_effect_change_no_area(
    mixed: bool, precise: bool, worst: float
) -> None:
    land = cut(flat(patches(13) if mixed else np.ones((31, 31), dtype=np.int64), 120.0), 4)
    one = weather(10.0, 250.0)
    end_s = duration_s(land, WeatherStream([one]), 0.4)
    entries = [
        replace(one, at_s=end_s * n / 16, wind_speed_m_s=10.0 * (1.0 + 1e-6 * (n % 2)))
        for n in range(16)
    ]
    stream = WeatherStream(entries)
    assert len(stream.changes()) == 16
    expected = burned_ha(land, WeatherStream([one]), end_s, precise)
    assert burned_ha(land, stream, end_s, precise) == pytest.approx(expected, rel=worst)


@pytest.mark.parametrize("precise", [False, True])
def test_an_interpolated_area_is_that_of_a_circle(precise: bool) -> None:
    fire = AnyAngleFire(landscape(1, shape=(41, 41)), steady(), [(20, 20, 0.0)], precise=precise)
    fire.advance(1e5)
    rate_cells_s = 10.0 / fire.arrival_time_s[20, 30]
    cell_ha = fire.landscape.cell_size_m**2 / 1e4
    for radius in (4.3, 8.7, 12.2):
        again = AnyAngleFire(fire.landscape, steady(), [(20, 20, 0.0)], precise=precise)
        again.advance(radius / rate_cells_s)
        assert again.interpolated_ha == pytest.approx(np.pi * radius**2 * cell_ha, rel=0.01)


def test_an_interpolated_area_depends_less_on_the_size_of_cells() -> None:
    errors = []
    for seed in range(21, 27):
        land, stream = cut(flat(patches(seed), 120.0), 3), steady(5.0, 250.0)
        end_s = duration_s(land, stream, 0.3)
        coarse, fine = (burned_ha(cut(land, n), stream, end_s, True) for n in (1, 5))
        errors.append(coarse.error(fine))
    whole, parts = np.abs(errors).mean(axis=0)
    assert parts < 0.3 * whole


@pytest.mark.parametrize("precise", [False, True])
def test_cells_of_an_initial_fire_count_as_a_whole(precise: bool) -> None:
    land = cut(flat(patches(14), 120.0), 2)
    fire = AnyAngleFire(land, steady(5.0, 250.0), [middle(land)], precise=precise)
    fire.advance(4000.0)
    begun = fire.restarted(burning_from_arrival(fire.expected_s(), land, 4000.0))
    assert begun.burned_ha > 3.0
    assert begun.interpolated_ha == pytest.approx(begun.burned_ha)
    begun.advance(20000.0)
    assert begun.interpolated_ha == pytest.approx(begun.burned_ha, rel=0.03)


@pytest.mark.parametrize(("precise", "worst"), [(False, 0.005), (True, 1e-9)])
def test_a_very_narrow_ellipse_is_exact_from_its_ignition_on(precise: bool, worst: float) -> None:
    entry = weather(wind_for(6.0), 20.0)
    land = landscape(1, shape=(81, 81))
    exact_s = ellipse_s(land, entry, 40, 40)
    fire = AnyAngleFire(land, WeatherStream([entry]), [(40, 40, 0.0)], precise=precise)
    fire.advance(float(np.quantile(exact_s, 0.05)))
    burned = fire.burned()
    assert burned.sum() > 100
    np.testing.assert_allclose(fire.arrival_time_s[burned], exact_s[burned], rtol=worst)


def test_fire_reaches_exactly_the_cells_connected_by_sides() -> None:
    from scipy import ndimage

    for seed in range(4):
        codes = np.where(np.random.default_rng(seed).random((60, 60)) < 0.35, 98, 1)
        codes[30, 30] = 1
        labels, _ = ndimage.label(codes == 1)
        for precise in (False, True):
            fire = AnyAngleFire(flat(codes, 30.0), steady(4.0), [(30, 30, 0.0)], precise=precise)
            fire.advance(1e7)
            assert np.array_equal(fire.burned(), labels == labels[30, 30])
