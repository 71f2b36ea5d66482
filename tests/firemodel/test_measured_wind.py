"""Winds measured at several places, the vegetation's profile, and winds of weather entries."""

import numpy as np
import pytest

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.physics.wind_field import WindGrids
from firemodel.wind import (
    MeasuredWind,
    TerrainWind,
    fit_wind,
    local_wind,
    over_terrain,
    responses_of,
    surface_of,
    surface_of_height,
    terrain_wind,
    wind_of_landscape,
)
from firemodel.wind.flow_grid import flow_grid
from firemodel.wind.terrain_weather import relative_to_station
from firemodel.wind.vegetation import (
    BLENDING_M,
    REFERENCE_M,
    Surface,
    mean_roughness_m,
    profile_at,
    profile_means,
)

CELLS, CELL_M = 40, 60.0
HELD_OUT = 3


def ground() -> Floats:
    row, col = np.indices((CELLS, CELLS))
    ridge = 150.0 * np.exp(-(((col - 14.0 - row / 5.0) / 5.0) ** 2))
    return ridge + 60.0 * np.exp(-(((row - 28.0) / 5.0) ** 2 + ((col - 30.0) / 4.0) ** 2))


@pytest.fixture(scope="module")
def terrain() -> TerrainWind:
    return terrain_wind(ground(), CELL_M, surface_of_height(np.full((CELLS, CELLS), 0.3)))


@pytest.fixture(scope="module")
def landscape() -> Landscape:
    fuel = np.full((CELLS, CELLS), 2, np.int16)
    return Landscape("EPSG:32613", 6e5, 4.5e6, CELL_M, fuel, ground().astype(np.float32))


def measured_of(wind: Floats, places: Floats, sd_m_s: float) -> list[MeasuredWind]:
    speed = np.hypot(*wind)
    from_deg = np.rad2deg(np.arctan2(-wind[1], -wind[0])) % 360.0
    rows = zip(*places, speed, from_deg, strict=True)
    return [MeasuredWind(*map(float, each))._replace(sd_m_s=sd_m_s) for each in rows]


def test_one_measurement_is_met_exactly(terrain: TerrainWind) -> None:
    at = MeasuredWind(20.3, 17.8, 9.0, 7.0, 250.0)
    fitted = fit_wind(terrain, [at])
    place = [np.array([value]) for value in (at.row, at.col, at.above_ground_m)]
    north, east = fitted.wind_at(terrain, *place)[:, 0]
    assert np.hypot(north, east) == pytest.approx(7.0)
    assert np.rad2deg(np.arctan2(-east, -north)) % 360.0 == pytest.approx(250.0)
    # On the ridge the free wind is slower.
    assert fitted.speed_m_s < 6.0


def test_measurements_with_small_errors_count_more(terrain: TerrainWind) -> None:
    slow = MeasuredWind(5.0, 35.0, 8.0, 3.0, 270.0, 0.2)
    fast = MeasuredWind(5.0, 36.0, 8.0, 9.0, 270.0, 2.0)
    assert fit_wind(terrain, [slow, fast]).speed_m_s < 5.0
    careless, careful = slow._replace(sd_m_s=2.0), fast._replace(sd_m_s=0.2)
    assert fit_wind(terrain, [careless, careful]).speed_m_s > 7.0


def test_the_fit_of_noisy_stations_and_aircraft_predicts_other_places(
    terrain: TerrainWind,
) -> None:
    """Over many draws, the fit is better than one free wind, and this than the stations' mean."""
    errors: list[tuple[float, float, float]] = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        places = np.array(
            [*rng.uniform(2.0, 37.0, (2, 9)), [8.0] * 7 + rng.uniform(80.0, 250.0, 2).tolist()]
        )
        down, across = rng.normal(0.0, 1.0, (2, 2, 1)) * (places[:2] - CELLS / 2) / (CELLS / 2)
        free = np.array([[4.0], [-6.0]]) + down + across
        true = np.einsum("rcm,rm->cm", terrain.responses_at(*places), free)
        noisy = measured_of(true + rng.normal(0.0, 0.7, true.shape), places, 0.7)
        used = noisy[HELD_OUT:]
        held = slice(0, HELD_OUT)
        fits = [fit_wind(terrain, used), fit_wind(terrain, used, deviation_m_s=0.0)]
        found = [fit.wind_at(terrain, *places[:, held]) for fit in fits]
        stations = [local_wind(np.eye(2), each.speed_m_s, each.from_deg) for each in used[:4]]
        found.append(np.mean(stations, axis=0)[:, None])
        rms = [float(np.sqrt(np.mean((each - true[:, held]) ** 2))) for each in found]
        errors.append((rms[0], rms[1], rms[2]))
    fit, one_wind, mean = np.mean(errors, axis=0)
    assert fit < 0.9 * one_wind
    assert one_wind < 0.8 * mean
    assert sum(each[0] < each[2] for each in errors) >= 18


def test_the_wind_of_cells_is_that_at_their_centres(terrain: TerrainWind) -> None:
    used = [MeasuredWind(5.0, 5.0, 8.0, 5.0, 200.0), MeasuredWind(30.0, 30.0, 90.0, 12.0, 280.0)]
    fitted = fit_wind(terrain, used)
    cells = fitted.wind_of_cells(terrain.responses(REFERENCE_M))
    row, col = np.array([3.0, 38.0]), np.array([10.0, 20.0])
    height = np.full(2, 0.3 + REFERENCE_M)
    expected = fitted.wind_at(terrain, row, col, height)
    assert np.allclose(cells[:, [3, 38], [10, 20]], expected, atol=1e-4)
    assert fitted.reference_at(row, col).std(axis=1).max() > 0.01


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"row": 40.0}, "is outside the landscape"),
        ({"above_ground_m": 0.1}, "is within the vegetation"),
        ({"speed_m_s": -1.0}, "the speed must be 0 to 100 m/s"),
        ({"speed_m_s": 101.0}, "the speed must be 0 to 100 m/s"),
        ({"sd_m_s": 0.0}, "standard deviation 0.01 to 100 m/s"),
        ({"sd_m_s": 1e-300}, "standard deviation 0.01 to 100 m/s"),
        ({"sd_m_s": 1e300}, "standard deviation 0.01 to 100 m/s"),
        ({"from_deg": np.nan}, "not a number"),
    ],
)
def test_impossible_measurements_are_refused(
    terrain: TerrainWind, change: dict[str, float], message: str
) -> None:
    good = MeasuredWind(5.0, 5.0, 8.0, 5.0, 200.0)
    with pytest.raises(FireModelError, match=rf"measured wind 1: .*{message}"):
        fit_wind(terrain, [good, good._replace(**change)])
    with pytest.raises(FireModelError, match="no measurements"):
        fit_wind(terrain, [])


def test_the_profile_is_1_at_the_reference_height_above_any_vegetation() -> None:
    surface = surface_of_height(np.array([0.0, 0.1, 0.5, 3.0, 25.0]))
    rough = mean_roughness_m(surface)
    at_reference = profile_at(surface.height_m + REFERENCE_M, surface, rough, REFERENCE_M)
    assert np.allclose(at_reference, 1.0)
    heights = surface.displacement_m + np.geomspace(0.001, 3000.0, 200)[:, None]
    assert (profile_at(heights, surface, rough, REFERENCE_M)[0, 1:] == 0.0).all()
    for height_m in surface.height_m:
        one = surface_of_height(np.full(1, height_m))
        lifted = one.displacement_m + np.geomspace(0.001, 3000.0, 200)
        profile = profile_at(lifted, one, mean_roughness_m(one), REFERENCE_M)
        assert (np.diff(profile) >= -1e-9).all()
    # Andrews 2012, equation for the wind at 20 ft above the vegetation: ln((20 + 0.36 H)/0.13 H).
    alone = surface_of_height(np.array([5.0]))
    at_m = np.array([alone.displacement_m[0] + 0.13 * 5.0 * np.e])
    slope = profile_at(at_m, alone, mean_roughness_m(alone), REFERENCE_M)
    assert slope == pytest.approx(1.0 / np.log((REFERENCE_M + 0.36 * 5.0) / (0.13 * 5.0)))


def test_high_above_different_vegetation_the_profile_is_the_same() -> None:
    surface = Surface(np.array([0.0, 0.0]), np.array([0.01, 1.0]), np.array([0.0, 0.0]))
    near, far = profile_at(np.array([[20.0], [BLENDING_M + 1.0]]), surface, 0.1, REFERENCE_M)
    assert near[0] != pytest.approx(near[1])
    assert far[0] == pytest.approx(far[1])


def test_the_means_of_the_profile_are_its_integrals() -> None:
    grid = flow_grid(np.array([[0.0, 1500.0]]), 30.0)  # the flow is deeper than the boundary layer
    surface = surface_of_height(np.full(grid.elevation_m.shape, 1.5))
    means = profile_means(grid, surface)[:, 0, 0]
    corner = surface_of_height(np.array([1.5]))
    rough = mean_roughness_m(corner)
    for low, high, mean in zip(grid.volume_bounds, grid.volume_bounds[1:], means, strict=False):
        parts = low + (high - low) * (np.arange(4000) + 0.5) / 4000
        exact = profile_at(parts * grid.depth_m[0, 0], corner, rough, REFERENCE_M).mean()
        assert mean == pytest.approx(exact, abs=2e-3)


def test_the_vegetation_is_the_canopy_or_else_the_fuel() -> None:
    fuel = np.array([[1, 98], [145, 145]], np.int16)
    cover = np.array([[0.0, 0.0], [0.5, 0.01]], np.float32)
    height = np.array([[0.0, 0.0], [18.0, 18.0]], np.float32)
    plain = np.zeros((2, 2), np.float32)
    layers = {"canopy_cover": cover, "canopy_height_m": height}
    found = surface_of(Landscape("EPSG:32613", 6e5, 4.5e6, 30.0, fuel, plain, **layers))  # type: ignore[arg-type]
    expected = np.array([[0.3048, 0.0012], [18.0, 6.0 * 0.3048]])
    assert np.allclose(found.height_m, expected)
    assert np.allclose(found.roughness_m, 0.13 * expected)
    assert np.allclose(found.displacement_m, 0.64 * expected)


def entry(from_deg: float, speed_m_s: float = 5.0) -> Weather:
    return Weather(0.0, speed_m_s, from_deg, 6.0, 7.0, 8.0, 70.0, 90.0)


def winds_of(weather: Weather, landscape: Landscape) -> Floats:
    """Return the local winds (2, y, x) of a weather entry by its field."""
    assert weather.wind_field is not None
    toward = np.deg2rad(landscape.grid_deg(weather.wind_from_deg + 180.0))
    north, east = weather.wind_field.ratio()
    found = weather.wind_speed_m_s * np.exp(1j * toward) * (north + 1j * east)
    return np.array([found.real, found.imag])


def test_entries_have_the_winds_of_their_direction(landscape: Landscape) -> None:
    responses = responses_of(landscape)
    stream = over_terrain(WeatherStream([entry(230.0)]), responses, landscape)
    expected = local_wind(responses.toward, 5.0, landscape.grid_deg(230.0))
    assert np.allclose(winds_of(stream.entries[0], landscape), expected, atol=1e-5)
    changed = stream.blown(8.0, 320.0, 100.0).entries[-1]
    expected = local_wind(responses.toward, 8.0, landscape.grid_deg(320.0))
    assert np.allclose(winds_of(changed, landscape), expected, atol=1e-5)
    assert changed.wind_field is not None
    assert changed.wind_field.grids is responses


def test_the_wind_at_the_station_is_that_of_the_entry(landscape: Landscape) -> None:
    row, col = 14, 17
    responses = responses_of(landscape, (row, col))
    stream = over_terrain(WeatherStream([entry(230.0)]), responses, landscape)
    found = winds_of(stream.entries[0], landscape)[:, row, col]
    toward = np.deg2rad(landscape.grid_deg(50.0))
    assert np.allclose(found, [5.0 * np.cos(toward), 5.0 * np.sin(toward)], atol=1e-5)


def test_stations_that_measure_nothing_are_refused(landscape: Landscape) -> None:
    responses = wind_of_landscape(landscape).responses(REFERENCE_M)
    sheltered = responses.copy()
    sheltered[:, :, 3, 3] *= 0.01
    with pytest.raises(FireModelError, match="is sheltered from the wind"):
        relative_to_station(sheltered, 3, 3)


def test_a_landscape_without_elevation_is_refused(landscape: Landscape) -> None:
    flat = Landscape(
        *("EPSG:32613", 6e5, 4.5e6, CELL_M, landscape.fuel_model, None),
        np.zeros((2, CELLS, CELLS), np.float32),
    )
    with pytest.raises(FireModelError, match="has no elevation"):
        responses_of(flat)


def test_fields_of_files_do_not_depend_on_the_direction() -> None:
    from firemodel.physics.wind_field import WindField

    field = WindField(WindGrids(np.ones((1, 2, 3, 3), np.float32)), ((0, 1.0 + 0.0j),))
    assert field.turned(40.0) is field
