"""Spread rate, direction, intensity and flame length of the front at its arrival."""

import math

import numpy as np
import pytest

from firemodel.physics import rothermel
from firemodel.physics.fuels import FUEL_MODELS
from firemodel.physics.weather import WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.behaviour import behaviour_of
from firemodel.spread.devs8 import Devs8Fire
from tests.firemodel.grids import landscape, steady, weather
from tests.firemodel.spread_fields import spread_fields


@pytest.mark.parametrize("scheme", [AnyAngleFire, Devs8Fire])
def test_head_and_back_agree_with_rothermel(scheme: type[AnyAngleFire] | type[Devs8Fire]) -> None:
    land, entry = landscape(4), weather(4.0, 270.0)
    fire = scheme(land, WeatherStream([entry]), [(20, 20, 0.0)])
    fire.advance(4000.0)
    rate, _, e = (float(field[0, 0]) for field in spread_fields(land, entry))
    back = rate * (1.0 - e) / (1.0 + e)
    found = behaviour_of(fire)
    assert found.spread_rate_m_s[20, 25] == pytest.approx(rate)
    assert found.spread_rate_m_s[20, 19] == pytest.approx(back)
    assert (found.toward_deg[20, 25], found.toward_deg[20, 19]) == pytest.approx(
        (90.0, 270.0), abs=0.05
    )
    bed = rothermel.fuel_bed(FUEL_MODELS[4], entry.moisture)
    intensity = float(rothermel.fireline_intensity_kw_m(bed, rate))
    assert found.intensity_kw_m[20, 25] == pytest.approx(intensity)
    assert found.flame_length_m[20, 25] == pytest.approx(float(rothermel.flame_length_m(intensity)))
    assert found.spread_rate_m_s[20, 20] == pytest.approx(rate)  # the ignition cell
    assert np.array_equal(np.isnan(found.spread_rate_m_s), ~fire.burned())


def test_the_flank_runs_across_the_front_not_along_the_way() -> None:
    land, entry = landscape(1, shape=(161, 161)), weather(3.0, 270.0)
    fire = AnyAngleFire(land, WeatherStream([entry]), [(80, 80, 0.0)])
    rate, _, e = (float(field[0, 0]) for field in spread_fields(land, entry))
    fire.advance(70 * 30.0 / rate)
    half_length = rate / (1.0 + e)
    # One cell on each of the two sides.
    widest = half_length * e / (half_length * math.sqrt(1.0 - e * e))
    side = 12
    forward = round(side * widest)
    found = behaviour_of(fire)
    flanking = half_length * math.sqrt(1.0 - e * e)
    assert found.spread_rate_m_s[80 - side, 80 + forward] == pytest.approx(flanking, rel=0.02)
    assert found.toward_deg[80 - side, 80 + forward] == pytest.approx(0.0, abs=1.5)


def test_rates_on_a_slope_are_along_it() -> None:
    rows, _ = np.indices((41, 41))
    land = landscape(1, 15.0 * (40.0 - rows))  # rises 0.5 to the north
    fire = AnyAngleFire(land, steady(), [(20, 20, 0.0)])
    fire.advance(20_000.0)
    rate, _, e = (float(field[20, 20]) for field in spread_fields(land, weather()))
    found = behaviour_of(fire).spread_rate_m_s
    assert found[15, 20] == pytest.approx(rate, rel=1e-5)
    assert found[25, 20] == pytest.approx(rate * (1.0 - e) / (1.0 + e), rel=1e-5)


def test_each_cell_has_the_weather_it_burned_in() -> None:
    stream = WeatherStream([weather(1.0, 270.0), weather(5.0, 270.0, 3000.0)])
    fire = AnyAngleFire(landscape(1), stream, [(20, 5, 0.0)])
    fire.advance(5000.0)
    head_row = fire.arrival_time_s[20, 6:]
    before, after = (
        float(spread_fields(fire.landscape, entry)[0][0, 0]) for entry in stream.entries
    )
    expected = np.where(head_row <= 3000.0, before, after)
    found = behaviour_of(fire).spread_rate_m_s[20, 6:]
    burned = np.isfinite(head_row)
    assert (head_row[burned] <= 3000.0).any()
    assert (head_row[burned] > 3000.0).any()
    # After a change of wind, fire spreads from points on the front, up to half a cell beside the
    # row.
    np.testing.assert_allclose(found[burned], expected[burned], rtol=0.01)
