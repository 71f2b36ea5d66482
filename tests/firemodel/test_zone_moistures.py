"""Moisture by elevation, aspect, sun and shade, and fires that burn with it."""

from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from firemodel.ensemble.draws import latin_draws
from firemodel.ensemble.member_fires import Start
from firemodel.ensemble.uncertainty import Uncertainty
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.readers.weather_files import read_weather
from firemodel.landscape.zone_moistures import ZoneConditions
from firemodel.physics.rothermel import Moisture
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.behaviour import behaviour_of
from firemodel.spread.crown_spread import crown_factor
from tests.firemodel.grids import CELL_M, landscape

SHAPE = (41, 41)
MOISTURE = Moisture(0.06, 0.07, 0.08, 0.6, 0.9)
NOON = datetime(2026, 6, 23, 12)  # noqa: DTZ001  # standard time of the place


def ridge(rise: float = 0.5) -> Landscape:
    """Return a ridge from west to east: the northern half faces north, the other half south."""
    rows = np.abs(np.arange(SHAPE[0]) - SHAPE[0] // 2)
    height_m = 600.0 - CELL_M * rise * rows
    return landscape(2, np.repeat(height_m[:, None], SHAPE[1], axis=1))


def station(tmp_path: Path, header: str = "", row: str = "") -> Path:
    """Write three days of hourly weather, warm and dry by day; return the file."""
    lines = [f"time,temperature_c,humidity_pct,wind_speed_m_s,wind_from_deg{header}"]
    for hour in range(72):
        swing = np.sin((hour % 24 - 9) * np.pi / 12.0)
        time = f"2026-06-{21 + hour // 24}T{hour % 24:02d}:00"
        lines.append(f"{time},{25 + 8 * swing:.2f},{45 - 20 * swing:.2f},0,0{row}")
    path = tmp_path / "station.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def conditioned(path: Path, land: Landscape, station_m: float | None = None) -> WeatherStream:
    zones = ZoneConditions(land, station_m)
    return read_weather(path, start=NOON, moisture=MOISTURE, conditioned=True, zones=zones)


def fine_moisture(weather: WeatherStream, land: Landscape) -> NDArray[np.float64]:
    """Return the moisture (y, x) of the 1-h fuel at the first entry."""
    fine = np.array(weather.entries[0].of_zones)[:, 0]
    return np.asarray(fine[land.moisture_zones.of_cell])


def test_slopes_that_face_the_sun_are_drier_and_burn_faster(tmp_path: Path) -> None:
    land = ridge()
    weather = conditioned(station(tmp_path), land)
    fine = fine_moisture(weather, land)
    north, south = fine[5, 20], fine[35, 20]
    assert south < north - 0.001
    fire = AnyAngleFire(land, weather, [(5, 20, 0.0), (35, 20, 0.0)])
    fire.advance(1800.0)
    rate = behaviour_of(fire).spread_rate_m_s
    assert rate[35, 20] > rate[5, 20] > 0.0


def test_shade_and_clouds_keep_fuel_moist(tmp_path: Path) -> None:
    land = landscape(2, shape=SHAPE)
    cover = np.zeros(SHAPE, dtype=np.float32)
    cover[:, 20:] = 0.8
    shaded = replace(land, canopy_cover=cover, canopy_height_m=np.sign(cover) * np.float32(20.0))
    sunny = fine_moisture(conditioned(station(tmp_path), shaded), shaded)
    assert sunny[0, 40] > sunny[0, 0] + 0.005
    cloudy = fine_moisture(conditioned(station(tmp_path, ",cloud_pct", ",100"), land), land)
    assert cloudy[0, 0] > sunny[0, 0] + 0.005
    measured = fine_moisture(conditioned(station(tmp_path, ",sun_w_m2", ",0"), land), land)
    assert measured[0, 0] > cloudy[0, 0]


def test_high_ground_is_cooler_and_damper_than_the_station(tmp_path: Path) -> None:
    path, land = station(tmp_path), landscape(2, shape=SHAPE)
    low, high = (
        fine_moisture(conditioned(path, land, at_m), land)[0, 0] for at_m in (0.0, -2000.0)
    )
    assert high > low + 0.002


def test_one_zone_burns_exactly_as_the_same_moistures_without_zones(tmp_path: Path) -> None:
    land = landscape(2, shape=SHAPE)
    weather = conditioned(station(tmp_path), land)
    plain = WeatherStream(
        [
            replace(
                entry,
                dead_1h_pct=100.0 * entry.of_zones[0][0],
                dead_10h_pct=100.0 * entry.of_zones[0][1],
                dead_100h_pct=100.0 * entry.of_zones[0][2],
                of_zones=(),
            )
            for entry in weather.entries
        ]
    )
    fires = [AnyAngleFire(land, each, [(20, 20, 0.0)]) for each in (weather, plain)]
    for fire in fires:
        fire.advance(7200.0)
    zoned, other = (fire.arrival_time_s for fire in fires)
    assert np.isfinite(zoned).sum() > 30
    assert np.allclose(zoned, other, rtol=1e-9)
    assert crown_factor("cruz", weather.entries[0]) == pytest.approx(
        crown_factor("cruz", plain.entries[0])
    )


def test_factors_of_fuels_and_members_reach_all_zones(tmp_path: Path) -> None:
    codes = np.full(SHAPE, 2)
    codes[:, 20:] = 8
    land = replace(ridge(), fuel_model=codes.astype(np.int16))
    weather = conditioned(station(tmp_path), land)
    lit = [(20, 10, 0.0)]
    one, by_fuel, halted = (AnyAngleFire(land, weather, lit) for _ in range(3))
    one.perturb(1.0, 0.0, 0.5)
    by_fuel.perturb(1.0, 0.0, np.array([0.5, 0.5]))
    halted.perturb(1.0, 0.0, np.array([1.0, 0.0]))
    for fire in (one, by_fuel, halted):
        fire.advance(3600.0)
    assert np.array_equal(one.arrival_time_s, by_fuel.arrival_time_s)
    assert not halted.burned()[:, 20:].any()
    start = Start(AnyAngleFire(land, weather, []), [(20, 10, 0.0)])
    wetter, drier = (
        start.rate_factors(draw._replace(moisture_factor=factor))[..., 0]
        for draw in latin_draws(Uncertainty(), 1, 1, start.fuels)
        for factor in (1.5, 0.7)
    )
    assert wetter.shape[1] > 2
    assert np.all(wetter < drier)


def test_weather_of_another_landscape_and_missing_inputs_are_refused(tmp_path: Path) -> None:
    weather = conditioned(station(tmp_path), ridge())
    with pytest.raises(FireModelError, match="read the weather with this landscape"):
        AnyAngleFire(landscape(2, shape=SHAPE), weather, [])
    level = landscape(2, shape=SHAPE)
    with pytest.raises(FireModelError, match="no elevation"):
        conditioned(station(tmp_path), replace(level, elevation_m=None))
    with pytest.raises(FireModelError, match="correct the elevation of the station"):
        conditioned(station(tmp_path), level, station_m=9000.0)
    path = tmp_path / "seconds.csv"
    names = "at_s,temperature_c,humidity_pct,wind_speed_m_s,wind_from_deg"
    path.write_text(f"{names}\n0,20,30,0,0\n3600,20,30,0,0\n")
    with pytest.raises(FireModelError, match="no calendar times"):
        read_weather(path, moisture=MOISTURE, conditioned=True, zones=ZoneConditions(level))


def test_a_factor_of_dead_moisture_changes_all_kinds_of_moistures() -> None:
    entry = Weather(
        0.0,
        1.0,
        0.0,
        6.0,
        7.0,
        8.0,
        60.0,
        90.0,
        of_fuels=((1, MOISTURE),),
        of_zones=((0.1, 0.2, 0.3),),
    )
    found = entry.with_dead_moisture(2.0)
    assert (found.dead_1h_pct, found.dead_10h_pct, found.dead_100h_pct) == (12.0, 14.0, 16.0)
    assert found.of_fuels == ((1, Moisture(0.12, 0.14, 0.16, 0.6, 0.9)),)
    assert found.of_zones == ((0.2, 0.4, 0.6),)
    assert found.moisture_of(2) == Moisture(0.2, 0.4, 0.6, 0.6, 0.9)
