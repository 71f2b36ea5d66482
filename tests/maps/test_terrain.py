"""Elevation tiles, decoded as in a browser."""

import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import Transformer

from firemodel.landscape.landscape import Landscape
from mission_service.interfaces.maps.terrain import TILE, TerrainTiles, terrarium_png
from tests.maps.fires import TO_MERCATOR, land, pixels_of

HALF_WORLD_M = np.pi * 6378137.0
ROUNDING_M = 1 / 256


def decoded(png: bytes) -> NDArray[np.float64]:
    red, green, blue = np.moveaxis(pixels_of(png, "RGB").astype(np.float64), -1, 0)
    found: NDArray[np.float64] = red * 256.0 + green + blue / 256.0 - 32768.0
    return found


def places_of(z: int, x: int, y: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return latitude and longitude of a tile's pixels, computed only by pyproj."""
    pixel_m = 2.0 * HALF_WORLD_M / 2**z / TILE
    across, down = np.meshgrid(np.arange(TILE) + 0.5, np.arange(TILE) + 0.5)
    to_degrees = Transformer.from_crs("EPSG:3857", "EPSG:4326", always_xy=True)
    lon, lat = to_degrees.transform(
        (x * TILE + across) * pixel_m - HALF_WORLD_M, HALF_WORLD_M - (y * TILE + down) * pixel_m
    )
    return lat, lon


def middle_tile(landscape: Landscape, z: int) -> tuple[int, int]:
    rows, cols = landscape.shape
    lat, lon = landscape.lat_lon_of(*landscape.xy_of(rows / 2, cols / 2))
    x_m, y_m = TO_MERCATOR.transform(lon, lat)
    side = 2.0 * HALF_WORLD_M / 2**z
    return int((x_m + HALF_WORLD_M) / side), int((HALF_WORLD_M - y_m) / side)


def test_elevation_is_that_of_the_place() -> None:
    tiles = TerrainTiles(land())
    z = tiles.describe()["maxzoom"]
    x, y = middle_tile(land(), z)
    png = tiles.tile(z, x, y)
    assert png is not None
    lat, lon = places_of(z, x, y)
    where = land().xy_of_lat_lon(lat, lon)
    row, col = land().row_col_of(*where)
    rows, cols = land().shape
    inside = (row >= 0) & (row <= rows - 1) & (col >= 0) & (col <= cols - 1)
    due = land().elevation_at(*where)
    # Only some pixels are projected exactly: errors are at most 0.1 m on slopes of up to 1 in 1.
    np.testing.assert_allclose(decoded(png)[inside], due[inside], atol=ROUNDING_M / 2 + 0.05)
    assert inside.sum() > 2000
    assert np.ptp(due[inside]) > 50.0


def test_beyond_the_landscape_its_edge_goes_on_ever_smoother() -> None:
    tiles = TerrainTiles(land())
    z = tiles.describe()["maxzoom"]
    x, y = middle_tile(land(), z)
    tile = next(
        (x + dx, y + dy)
        for dx, dy in ((0, 1), (0, -1), (1, 0), (-1, 0))
        if tiles.tile(z, x + dx, y + dy)
    )
    png = tiles.tile(z, *tile)
    assert png is not None
    lat, lon = places_of(z, *tile)
    where = land().xy_of_lat_lon(lat, lon)
    row, col = land().row_col_of(*where)
    rows, cols = land().shape
    off = np.hypot(
        np.maximum(np.maximum(-row, row - rows + 1), 0),
        np.maximum(np.maximum(-col, col - cols + 1), 0),
    )
    steps = (
        np.abs(np.diff(decoded(png), axis=1))[1:, :],
        np.abs(np.diff(decoded(png), axis=0))[:, 1:],
    )
    rough = np.maximum(*steps)
    near, far = (off > 0.0) & (off < 3.0), off > 60.0
    edge_m = land().elevation_at(*where)
    assert np.abs(decoded(png) - edge_m)[near].max() < 30.0
    assert near.sum() > 50
    assert far.sum() > 1000
    assert rough[far[1:, 1:]].mean() < 0.4 * rough[near[1:, 1:]].mean()
    assert rough[far[1:, 1:]].max() < 0.5 * rough[near[1:, 1:]].max()


def test_heights_are_kept_to_a_256th_of_a_metre() -> None:
    heights = np.array([[-430.5, 0.0, 0.001], [8848.86, 123.456, -0.3]])
    found = decoded(terrarium_png(heights))
    np.testing.assert_allclose(found, heights, atol=ROUNDING_M / 2 + 1e-9)


def test_tiles_join_without_steps_and_so_does_what_is_beyond() -> None:
    tiles = TerrainTiles(land())
    z = tiles.describe()["maxzoom"]
    x, y = middle_tile(land(), z)
    found = [[tiles.tile(z, x + dx, y + dy) for dx in (-1, 0, 1)] for dy in (-1, 0, 1)]
    near = [(dy, dx) for dy in range(3) for dx in range(3) if found[dy][dx] is not None]
    assert len(near) >= 2
    whole = np.full((3 * TILE, 3 * TILE), np.nan)
    for dy, dx in near:
        png = found[dy][dx]
        assert png is not None
        whole[dy * TILE : (dy + 1) * TILE, dx * TILE : (dx + 1) * TILE] = decoded(png)
    steepest_m = 3.0 * land().slope_tan.max() * land().cell_size_m / 2.0
    for axis in (0, 1):
        steps = np.abs(np.diff(whole, axis=axis))
        assert np.nanmax(steps) < steepest_m


def test_lower_zooms_are_means_and_fit_the_landscape() -> None:
    tiles = TerrainTiles(land())
    described = tiles.describe()
    assert described["tiles"] == ["terrain/{z}/{x}/{y}.png"]
    low, high = described["minzoom"], described["maxzoom"]
    assert 8 <= low < high <= 15
    west, south, east, north = described["bounds"]
    rows, cols = land().shape
    lat, lon = land().lat_lon_of(*land().xy_of(np.array([0, rows - 1]), np.array([0, cols - 1])))
    assert west < lon.min() < lon.max() < east
    assert south < lat.min() < lat.max() < north
    pixel_m = 2.0 * HALF_WORLD_M / 2**high / TILE * np.cos(np.deg2rad(36.35))
    assert pixel_m <= land().cell_size_m < 2.0 * pixel_m
    png = tiles.tile(low, *middle_tile(land(), low))
    assert png is not None
    lat, lon = places_of(low, *middle_tile(land(), low))
    row, col = land().row_col_of(*land().xy_of_lat_lon(lat, lon))
    inside = (row > 0) & (row < rows - 1) & (col > 0) & (col < cols - 1)
    assert inside.sum() > 500
    # In a pixel, which is a disc in the landscape, all cells count, not only the middle one.
    near = np.asarray(land().elevation_m)[:-1:2, :-1:2]
    shown, due = decoded(png)[inside], land().elevation_at(*land().xy_of_lat_lon(lat, lon))[inside]
    assert shown.mean() == pytest.approx(due.mean(), abs=2.0)
    assert np.std(shown) < np.std(due) < 1.5 * np.std(near)


def test_a_plane_stays_where_it_is_at_every_zoom() -> None:
    """The mean of two cells belongs between them, not to the middle of the first."""
    rows, cols = land().shape
    heights = np.add.outer(10.0 * np.arange(rows), 3.0 * np.arange(cols)).astype(np.float32)
    fix = land()
    plane = Landscape(fix.crs, fix.west_m, fix.north_m, 30.0, fix.fuel_model, heights)
    tiles = TerrainTiles(plane)
    described = tiles.describe()
    for z in range(described["minzoom"], described["maxzoom"] + 1):
        png = tiles.tile(z, *middle_tile(plane, z))
        assert png is not None
        lat, lon = places_of(z, *middle_tile(plane, z))
        row, col = plane.row_col_of(*plane.xy_of_lat_lon(lat, lon))
        inside = (row > 8) & (row < rows - 9) & (col > 8) & (col < cols - 9)
        due = 10.0 * row[inside] + 3.0 * col[inside]
        np.testing.assert_allclose(decoded(png)[inside], due, atol=0.1)


def test_where_there_is_nothing_there_is_no_tile() -> None:
    tiles = TerrainTiles(land())
    z = tiles.describe()["maxzoom"]
    x, y = middle_tile(land(), z)
    assert tiles.tile(z, x, y) is tiles.tile(z, x, y)  # from the cache
    for other in ((z, x + 40, y), (z, x, 2**z), (z, -1, y), (z + 1, 2 * x, 2 * y), (0, 0, 0)):
        assert tiles.tile(*other) is None
    bare = Landscape(
        land().crs, land().west_m, land().north_m, 30.0, land().fuel_model, None, land().gradient
    )
    assert TerrainTiles(bare).tile(z, x, y) is None
    assert TerrainTiles(bare).describe()["tiles"] == []


def test_ground_of_one_row_has_tiles() -> None:
    flat = Landscape(
        land().crs, land().west_m, land().north_m, 30.0, np.ones((1, 5), dtype=np.int16),
        np.arange(5, dtype=np.float32).reshape(1, 5),
    )  # fmt: skip
    tiles = TerrainTiles(flat)
    z = tiles.describe()["maxzoom"]
    png = tiles.tile(z, *middle_tile(flat, z))
    assert png is not None
    assert decoded(png).max() <= 4.0
