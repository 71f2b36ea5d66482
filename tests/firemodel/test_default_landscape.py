"""The terrain that ships with matplotlib has the right orientation and position."""

import subprocess
import sys

import numpy as np
import pytest

from firemodel.errors import FireModelError
from firemodel.landscape.default import _elevation, jacksboro
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.devs8 import Devs8Fire
from firemodel.spread.front import perimeter


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "expected_m"),
    [
        (36.3301, -84.1838, 327.0),  # Jacksboro
        (36.3828, -84.1197, 325.0),  # LaFollette
        (36.2187, -84.1549, 262.0),  # Rocky Top
        (36.1983, -84.2306, 1077.0),  # Cross Mountain
    ],
)
def test_known_places_have_their_elevation(
    lat_deg: float, lon_deg: float, expected_m: float
) -> None:
    """The test would fail if the grid were upside down, or a grid's height too far north."""
    x_m, y_m = jacksboro(4, 4).xy_of_lat_lon(lat_deg, lon_deg)
    around = _elevation(3, 3, 60.0, x_m - 90.0, y_m + 90.0)
    assert around[1, 1] == pytest.approx(expected_m, abs=15.0)


def test_a_grid_beyond_the_terrain_is_refused() -> None:
    with pytest.raises(
        FireModelError, match=r"400 x 400 cells of 60\.0 m reach beyond the terrain"
    ):
        jacksboro(400, 400, 60.0)


def test_fuel_follows_the_stated_rule() -> None:
    land = jacksboro()
    flat = land.slope_tan < 0.10
    assert np.array_equal(land.fuel_model == 2, flat)
    dry = (land.aspect_deg >= 135.0) & (land.aspect_deg <= 315.0)
    assert np.array_equal(land.fuel_model == 5, ~flat & dry)
    assert np.array_equal(land.fuel_model == 9, ~flat & ~dry)
    for code in (2, 5, 9):
        assert 0.2 < (land.fuel_model == code).mean() < 0.6


def test_the_landscape_is_always_the_same() -> None:
    land = jacksboro()
    assert land.shape == (200, 200)
    assert land.digest() == jacksboro().digest()
    assert land.elevation_m is not None
    assert np.array_equal(land.elevation_m, np.round(land.elevation_m, 1))


def test_six_hours_of_fire_stay_on_the_grid_and_are_uneven() -> None:
    """The wind is from the north-east, and light for three hours, as in the default scenario."""
    land = jacksboro()
    winds = [(3, 40), (3, 45), (4, 50), (7, 45), (7.5, 40), (7, 50)]
    hours = [
        Weather(3600.0 * hour, speed, wind_from, 6, 8, 10, 70, 100)
        for hour, (speed, wind_from) in enumerate(winds)
    ]
    fire = Devs8Fire(land, WeatherStream(hours), [(80, 140, 0.0)])
    lengths = []
    for hour in range(1, 7):
        fire.advance(3600.0 * hour)
        lengths.append(len(perimeter(fire.burned())))
    assert lengths == sorted(lengths)
    assert 60 < lengths[2] < 120
    assert 300 < lengths[5] < 450
    rows, cols = np.nonzero(fire.burned())
    assert min(rows.min(), cols.min(), 199 - rows.max(), 199 - cols.max()) > 20
    ahead, behind = rows.max() - 80, 80 - rows.min()
    assert ahead > 4 * behind


def test_importing_the_package_loads_no_heavy_library() -> None:
    code = "import sys, firemodel; print(*{'numba', 'rasterio', 'matplotlib'} & set(sys.modules))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == ""
