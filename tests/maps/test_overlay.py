"""Images are aligned with the cells."""

import numpy as np
import pytest
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from mission_service.interfaces.maps.overlay import (
    OPAQUE,
    arrival_png,
    arrival_scale,
    overlay_frame,
)
from tests.firemodel.grids import CELL_M, CRS, NORTH_M, WEST_M
from tests.maps.fires import NOW_S, TO_MERCATOR, fire, land, pixels_of


def pixel_of(landscape: Landscape, row: float, col: float) -> tuple[float, float]:
    """Return the expected pixel (row, column) of a place of the grid, computed only by pyproj."""
    frame = overlay_frame(landscape)
    lat, lon = landscape.lat_lon_of(*landscape.xy_of(row, col))
    x_m, y_m = TO_MERCATOR.transform(lon, lat)
    (west, north), _, (east, south), _ = (TO_MERCATOR.transform(*c) for c in frame["corners"])
    down = (north - y_m) / (north - south) * frame["height_px"] - 0.5
    across = (x_m - west) / (east - west) * frame["width_px"] - 0.5
    return float(down), float(across)


@pytest.mark.parametrize("size", [(101, 91), (1900, 40)])
def test_cells_are_where_they_lie_on_the_map(size: tuple[int, int]) -> None:
    """Errors are at most a pixel, also in corners; the second image has under 2 pixels a cell."""
    rows, cols = size
    codes = np.ones(size, dtype=np.int16)
    fix = Landscape(CRS, WEST_M + 150_000.0, NORTH_M, CELL_M, codes, codes.astype(np.float32))
    for row, col in ((0, 0), (0, cols - 1), (rows - 1, 0), (rows - 1, cols - 1), (rows // 3, 7)):
        arrival_s = np.full(size, np.inf)
        arrival_s[row, col] = 0.0
        drawn = np.argwhere(pixels_of(arrival_png(arrival_s, fix, 0.0, 10.0))[..., 3])
        assert 1 <= len(drawn) <= 9
        assert drawn.mean(axis=0) == pytest.approx(pixel_of(fix, row, col), abs=1.0)
    everything = pixels_of(arrival_png(np.zeros(size), fix, 0.0, 10.0))[..., 3]
    frame = overlay_frame(fix)
    assert everything.shape == (frame["height_px"], frame["width_px"])
    assert max(everything.shape) <= 2048
    west, south, east, north = frame["bounds"]
    assert frame["corners"] == [[west, north], [east, north], [east, south], [west, south]]
    edges = [pixel_of(fix, *place) for place in ((-0.5, -0.5), (rows - 0.5, cols - 0.5))]
    assert np.array(edges).min() > -1.0
    assert np.array(edges).max() < max(everything.shape)


def test_colours_are_those_of_the_legend_and_what_is_later_is_clear() -> None:
    burning = fire()
    png = arrival_png(burning.arrival_time_s, land(), 1800.0, NOW_S)
    pixels = pixels_of(png)
    scale = arrival_scale(1800.0, NOW_S)
    assert [scale[0]["at_s"], scale[-1]["at_s"]] == [1800.0, NOW_S]
    times = np.array([stop["at_s"] for stop in scale])
    colours = np.array([list(bytes.fromhex(stop["colour"][1:])) for stop in scale], dtype=float)

    def at(row: int, col: int) -> NDArray[np.uint8]:
        down, across = pixel_of(land(), row, col)
        found: NDArray[np.uint8] = pixels[round(down), round(across)]
        return found

    burned = np.argwhere(burning.burned())
    for row, col in burned[:: len(burned) // 25]:
        when = burning.arrival_time_s[row, col]  # the first colour ends at 1800 s
        due = [np.interp(when, times, colours[:, band]) for band in range(3)]
        assert at(row, col)[:3] == pytest.approx(due, abs=4.0)
        assert at(row, col)[3] == OPAQUE
    for row, col in np.argwhere(~burning.burned())[::700]:
        assert at(row, col)[3] == 0
    assert len(png) < 60_000


def test_all_at_one_time_has_a_colour_too() -> None:
    pixels = pixels_of(arrival_png(np.full(land().shape, 7.0), land(), 7.0, 7.0))
    assert pixels[50, 50].tolist() == [30, 12, 69, OPAQUE]
