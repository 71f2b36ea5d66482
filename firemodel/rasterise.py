"""From geometries to cells: where a fire is lit, and barriers that it cannot slip through."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from firemodel.errors import FireModelError
from firemodel.fuels import NON_BURNABLE
from firemodel.landscape import Landscape

Floats = NDArray[np.float64]

BARE_GROUND = 99
SHORTEST = 1e-12  # part of a segment


def cells_of(geometries: Iterable[BaseGeometry], landscape: Landscape) -> NDArray[np.int32]:
    """Cells that geometries in the landscape's CRS touch, (n, 2) as (row, col), by rows.

    Of a point the cell it lies in; of a line all cells it crosses, in a chain joined by sides; of a
    polygon those whose centre is inside, or one cell inside if it is too small to have any. What
    lies off the grid is left out.
    """
    touched = np.zeros(landscape.shape, dtype=np.bool_)
    for part in _parts(geometries):
        if part.geom_type == "Polygon":
            _mark_polygon(part, landscape, touched)
        elif part.geom_type == "Point":
            _mark(_col_row(part, landscape), touched)
        else:
            _mark_line(part, landscape, touched)
    return np.argwhere(touched).astype(np.int32)


def with_barriers(
    landscape: Landscape, geometries: Iterable[BaseGeometry], code: int = BARE_GROUND
) -> Landscape:
    """The landscape with a fuel code that does not burn in all cells that geometries touch.

    Lines are closed to spread in any direction, since their cells are joined by sides. Of polygons
    the outline counts as well, so that a river narrower than a cell holds as a line does.

    Raises FireModelError if the code burns.
    """
    if code not in NON_BURNABLE:
        known = ", ".join(map(str, NON_BURNABLE))
        raise FireModelError(f"barriers: fuel code {code} burns; give one of {known}")
    shapes = list(geometries)
    outlines = [part.boundary for part in _parts(shapes) if part.geom_type == "Polygon"]
    fuel = landscape.fuel_model.copy()
    fuel[tuple(cells_of([*shapes, *outlines], landscape).T)] = code
    return replace(landscape, fuel_model=fuel)


def _parts(geometries: Iterable[BaseGeometry]) -> Iterator[BaseGeometry]:
    """Points, lines and polygons, out of collections too."""
    for geometry in geometries:
        if hasattr(geometry, "geoms"):
            yield from _parts(geometry.geoms)
        elif not geometry.is_empty:
            yield geometry


def _col_row(geometry: BaseGeometry, landscape: Landscape) -> Floats:
    """Vertices (n, 2) as column and row from the grid's corner, so that their floor is the cell."""
    x_m, y_m = shapely.get_coordinates(geometry).T
    row, col = landscape.row_col_of(x_m, y_m)
    return np.stack([col + 0.5, row + 0.5], axis=1)


def _mark(col_row: Floats, touched: NDArray[np.bool_]) -> None:
    col, row = np.floor(col_row).astype(np.int64).T
    on = (row >= 0) & (row < touched.shape[0]) & (col >= 0) & (col < touched.shape[1])
    touched[row[on], col[on]] = True


def _mark_polygon(polygon: BaseGeometry, landscape: Landscape, touched: NDArray[np.bool_]) -> None:
    from rasterio import Affine
    from rasterio.features import rasterize

    vertices = _col_row(polygon, landscape)
    size = touched.shape[::-1]
    west, north = np.clip(np.floor(vertices.min(axis=0)).astype(int), 0, size)
    east, south = np.clip(np.ceil(vertices.max(axis=0)).astype(int), 0, size)
    if west == east or north == south:
        return  # off the grid
    cell_m = landscape.cell_size_m
    west_m, north_m = landscape.west_m + west * cell_m, landscape.north_m - north * cell_m
    inside = rasterize(
        [polygon],
        out_shape=(south - north, east - west),
        transform=Affine(cell_m, 0.0, west_m, 0.0, -cell_m, north_m),
        dtype=np.uint8,
    )
    touched[north:south, west:east] |= inside > 0
    if not inside.any():
        _mark(_col_row(polygon.representative_point(), landscape), touched)


def _mark_line(line: BaseGeometry, landscape: Landscape, touched: NDArray[np.bool_]) -> None:
    """The cells of every segment, and those that join two which meet in a corner only."""
    rows, cols = touched.shape
    near = shapely.box(-1.0, -1.0, cols + 1.0, rows + 1.0)  # spares walking far off the grid
    for part in _parts([shapely.LineString(_col_row(line, landscape)).intersection(near)]):
        vertices = shapely.get_coordinates(part)
        chain = np.floor(
            np.concatenate([_steps(a, b) for a, b in pairwise(vertices)] or [vertices])
        )
        joints = np.stack([chain[1:, 0], chain[:-1, 1]], axis=1)  # a side neighbour of both
        _mark(chain, touched)
        _mark(joints, touched)


def _steps(start: Floats, end: Floats) -> Floats:
    """A point in each cell from start to end, in order, both ends among them (n, 2).

    The lines between columns and rows cut the segment into pieces; each lies in one cell. The ends
    are there so that lines which share a vertex share its cell, even where it lies on an edge.
    """
    way = end - start
    cuts = [np.array([0.0, 1.0])]
    for axis in (0, 1):
        low, high = sorted((start[axis], end[axis]))
        edges = np.arange(np.floor(low) + 1.0, np.ceil(high))
        if edges.size:
            cuts.append((edges - start[axis]) / way[axis])
    at = np.sort(np.concatenate(cuts))
    long_enough = np.diff(at) > SHORTEST
    middles = ((at[:-1] + at[1:]) / 2.0)[long_enough]
    return np.concatenate([start[None], start + middles[:, None] * way, end[None]])
