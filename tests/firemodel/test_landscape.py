"""Positions of cells, slope of the ground, and invalid landscapes."""

from dataclasses import replace
from typing import Any

import numpy as np
import pyproj
import pytest
from numpy.typing import NDArray

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import ROWS_AT_ONCE, Landscape, crs_label, horn, same_crs
from tests.firemodel.grids import CELL_M, CRS, NORTH_M, WEST_M, landscape

FUEL = np.array([[1, 2, 99], [4, 5, 98]], dtype=np.int16)
HEIGHTS = np.array([[10.0, 11.5, 12.0], [13.0, 14.0, 15.0]], dtype=np.float32)


def heights_of(land: Landscape) -> NDArray[np.float32]:
    assert land.elevation_m is not None
    return land.elevation_m


def test_cell_centres_and_grid_positions() -> None:
    land = landscape(shape=(4, 6))
    assert land.shape == (4, 6)
    assert land.xy_of(0, 0) == (500_015.0, 3_999_985.0)
    assert land.xy_of(3, 5) == (500_165.0, 3_999_895.0)
    assert land.row_col_of(500_165.0, 3_999_895.0) == (3.0, 5.0)
    rows, cols = np.indices(land.shape)
    again = land.row_col_of(*land.xy_of(rows, cols))
    np.testing.assert_allclose(again, (rows, cols), atol=1e-9)


def test_what_lies_on_the_grid() -> None:
    land = landscape(shape=(4, 6))
    assert land.contains(WEST_M + 0.1, NORTH_M - 0.1)
    assert land.contains(WEST_M + 179.9, NORTH_M - 119.9)
    assert not land.contains(WEST_M - 0.1, NORTH_M - 0.1)
    assert not land.contains(WEST_M + 0.1, NORTH_M - 120.1)


def test_latitude_and_longitude() -> None:
    """500 km east is the central meridian of the zone: 87 W for zone 16."""
    land = landscape()
    lat_deg, lon_deg = land.lat_lon_of(WEST_M, NORTH_M)
    assert lon_deg == pytest.approx(-87.0, abs=1e-9)
    assert lat_deg == pytest.approx(36.1440, abs=1e-3)
    assert land.xy_of_lat_lon(lat_deg, lon_deg) == pytest.approx((WEST_M, NORTH_M), abs=1e-3)
    lats, lons = land.lat_lon_of(np.array([WEST_M, WEST_M + 90.0]), np.array([NORTH_M, NORTH_M]))
    assert lats[0] == lat_deg
    assert lons[1] > lons[0]


@pytest.mark.parametrize(
    ("rise_east", "rise_north", "aspect_deg"),
    [(0.3, 0.0, 270.0), (-0.3, 0.0, 90.0), (0.0, 0.3, 180.0), (0.0, -0.3, 0.0), (0.3, 0.3, 225.0)],
)
def test_slope_and_aspect_of_a_plane(
    rise_east: float, rise_north: float, aspect_deg: float
) -> None:
    rows, cols = np.indices((7, 8))
    land = landscape(1, (rise_east * cols - rise_north * rows) * CELL_M)
    inside = np.s_[1:-1, 1:-1]
    np.testing.assert_allclose(land.slope_tan[inside], np.hypot(rise_east, rise_north), rtol=1e-5)
    turned = (land.aspect_deg[inside] - aspect_deg + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(turned, 0.0, atol=1e-3)


def test_elevation_between_cells_and_beyond_the_edge() -> None:
    land = landscape(1, np.array([[0.0, 10.0], [20.0, 30.0]]))
    x_m, y_m = land.xy_of(0.5, 0.5)
    assert land.elevation_at(x_m, y_m) == pytest.approx(15.0)
    assert land.elevation_at(*land.xy_of(1, 0)) == pytest.approx(20.0)
    assert land.elevation_at(WEST_M - 1e4, NORTH_M + 1e4) == 0.0
    assert land.elevation_at(WEST_M + 1e4, NORTH_M - 1e4) == 30.0
    several = land.elevation_at(*land.xy_of(np.array([0, 1]), np.array([0.5, 0.5])))
    np.testing.assert_allclose(several, [5.0, 25.0])


def test_the_digest_changes_with_everything_that_matters() -> None:
    base = landscape(1)
    fuel, heights = base.fuel_model, heights_of(base)
    other_fuel, other_heights = fuel.copy(), heights.copy()
    other_fuel[3, 3], other_heights[3, 3] = 2, 0.1
    trees, level = np.full(base.shape, 0.5, np.float32), np.zeros((2, *base.shape), np.float32)
    variants = [
        base,
        replace(base, canopy_cover=trees),
        replace(base, canopy_height_m=trees),
        replace(base, canopy_base_m=trees),
        replace(base, gradient=level + np.float32(0.1)),
        replace(base, elevation_m=None),
        Landscape("EPSG:32617", WEST_M, NORTH_M, CELL_M, fuel, heights),
        Landscape(CRS, WEST_M + 1, NORTH_M, CELL_M, fuel, heights),
        Landscape(CRS, WEST_M, NORTH_M + 1, CELL_M, fuel, heights),
        Landscape(CRS, WEST_M, NORTH_M, 20.0, fuel, heights),
        Landscape(CRS, WEST_M, NORTH_M, CELL_M, other_fuel, heights),
        Landscape(CRS, WEST_M, NORTH_M, CELL_M, fuel, other_heights),
    ]
    assert len({variant.digest() for variant in variants}) == len(variants)
    assert base.digest() == landscape(1).digest() == replace(base, gradient=level).digest()
    # As recorded before landscapes had trees and a given gradient.
    recorded = "0c96de090006e21caf8256786842a0f7282a2df16a5b2fa5f1c774dee1475771"
    assert landscape(FUEL, HEIGHTS).digest() == recorded


def test_a_gradient_that_is_given_wins_over_the_elevation() -> None:
    base = landscape(1, shape=(3, 4))
    gradient = np.zeros((2, 3, 4), dtype=np.float32)
    gradient[0], gradient[1] = 0.3, -0.4
    for land in (
        replace(base, gradient=gradient),
        replace(base, gradient=gradient, elevation_m=None),
    ):
        np.testing.assert_allclose(land.slope_tan, 0.5, rtol=1e-6)
        np.testing.assert_allclose(land.aspect_deg, np.rad2deg(np.arctan2(0.4, -0.3)), rtol=1e-6)
    with pytest.raises(FireModelError, match="this landscape has no elevation; add an elevation"):
        land.elevation_at(WEST_M, NORTH_M)


def test_the_gradient_is_the_same_whatever_is_worked_out_at_once() -> None:
    """Rough ground of several blocks of rows is compared with Horn's weights for single cells."""
    height = np.random.default_rng(1).normal(0.0, 30.0, (2 * ROWS_AT_ONCE + 3, 5))
    found = horn(height.astype(np.float32), 30.0)
    assert found.dtype == np.float32
    z = np.pad(height.astype(np.float32), 1, mode="edge").astype(np.float64)
    for row in (0, 1, ROWS_AT_ONCE - 1, ROWS_AT_ONCE, 2 * ROWS_AT_ONCE, 2 * ROWS_AT_ONCE + 2):
        for col in range(5):
            near = z[row : row + 3, col : col + 3]
            north = (near[0] - near[2]) @ [1, 2, 1] / 240.0
            east = (near[:, 2] - near[:, 0]) @ [1, 2, 1] / 240.0
            np.testing.assert_allclose(found[:, row, col], (north, east), rtol=1e-6, atol=1e-9)


def test_impossible_landscapes_are_refused() -> None:
    codes, heights = np.ones((3, 3), dtype=np.int16), np.zeros((3, 3), dtype=np.float32)
    wrong = codes.copy()
    wrong[1, 2] = 14
    flat = (CRS, 0.0, 0.0, 30.0, codes, heights)
    hole = np.zeros((2, 3, 3))
    hole[1, 2, 1] = np.nan
    cases: list[tuple[tuple[Any, ...], str]] = [
        (
            (CRS, 0.0, 0.0, 30.0, codes, heights[:2]),
            r"fuel has the shape \(3, 3\), but elevation \(2, 3\)",
        ),
        ((CRS, 0.0, 0.0, 0.0, codes, heights), "cell_size_m = 0.0 must be 0.01 to 1000000"),
        (("EPSG:4326", 0.0, 0.0, 30.0, codes, heights), "EPSG:4326 is not a projection in metres"),
        (("EPSG:2264", 0.0, 0.0, 30.0, codes, heights), "EPSG:2264 is not a projection in metres"),
        (("nowhere", 0.0, 0.0, 30.0, codes, heights), "CRS 'nowhere' is invalid"),
        ((CRS, 0.0, 0.0, 30.0, wrong, heights), "unknown fuel code 14 at row 1, column 2"),
        ((CRS, 0.0, 0.0, 30.0, codes, heights + np.inf), "elevation is inf at row 0, column 0"),
        ((CRS, 0.0, 0.0, 30.0, codes[0], heights), r"fuel has the shape \(3,\), but must"),
        ((CRS, 0.0, 0.0, 30.0, codes, None), "elevation and gradient are both missing"),
        ((*flat, heights), r"gradient has the shape \(3, 3\), but must have \(2, 3, 3\)"),
        ((*flat, hole), "gradient towards east is nan at row 2, column 1"),
        ((*flat, None, heights[:2]), r"fuel has the shape \(3, 3\), but canopy cover \(2, 3\)"),
        ((*flat, None, heights + 35.0), "canopy cover is 35.0 at row 0, column 0; .* from 0 to 1"),
        ((*flat, None, None, heights + 150.0), "canopy height is 150.0 at row 0, column 0"),
        ((*flat, None, None, None, heights - 1.0), "canopy base is -1.0 at row 0, column 0"),
    ]
    for arguments, message in cases:
        with pytest.raises(FireModelError, match=message):
            Landscape(*arguments)


def test_the_grid_s_north_is_not_everywhere_the_true_one() -> None:
    flat = np.zeros((4, 4), dtype=np.float32)
    fuel = np.ones((4, 4), dtype=np.int16)
    east_of_its_meridian = Landscape("EPSG:32616", 700_000.0, 4_000_000.0, 30.0, fuel, flat)
    found = east_of_its_meridian.grid_convergence_deg
    x_m, y_m = east_of_its_meridian.xy_of(1.5, 1.5)
    lat_deg, lon_deg = east_of_its_meridian.lat_lon_of(x_m, y_m)
    to_x_m, to_y_m = east_of_its_meridian.xy_of_lat_lon(lat_deg + 1e-3, lon_deg)
    # There, true north is to the left of grid north.
    assert found == pytest.approx(-np.rad2deg(np.arctan2(to_x_m - x_m, to_y_m - y_m)), abs=1e-3)
    assert found == pytest.approx(1.3, abs=0.1)


SPHERE = "+proj=lcc +lat_0=35.5 +lon_0={} +lat_1=35.5 +lat_2=41.5 +R=6371200 +units=m +no_defs"


def test_crss_are_the_same_if_their_coordinates_are() -> None:
    """A meridian of 237.3 equals -122.7; a CRS without a name is described by its parameters."""
    east, west = (
        pyproj.CRS.from_user_input(SPHERE.format(lon)).to_wkt() for lon in (237.3, -122.7)
    )
    assert same_crs(east, west)
    assert same_crs(east, SPHERE.format(-122.7))
    assert not same_crs(east, SPHERE.format(-122.6))
    assert not same_crs(east, SPHERE.format(-122.7).replace("6371200", "6370000"))
    assert not same_crs("EPSG:32616", "EPSG:26916")
    assert not same_crs("EPSG:32616", "EPSG:4326")
    assert same_crs("EPSG:32616", pyproj.CRS.from_epsg(32616).to_wkt())
    label = crs_label(east)
    assert label.startswith("Lambert Conic Conformal (2SP) (Latitude of false origin 35.5, Long")
    assert label.endswith("on a sphere of radius 6371200 m")
    assert crs_label(pyproj.CRS.from_epsg(5070).to_wkt()) == "NAD83 / Conus Albers"
