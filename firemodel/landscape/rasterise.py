"""Convert geometries to cells: to ignitions, or to barriers that fire cannot cross."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from firemodel.arrays import Floats, Mask
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.physics.fuels import NON_BURNABLE

BARE_GROUND = 99
SHORTEST = 1e-12  # parts of a segment below this fraction of its length are left out


def cells_of(geometries: Iterable[BaseGeometry], landscape: Landscape) -> NDArray[np.int32]:
    """Return the cells (n, 2) that geometries in the landscape's CRS touch, sorted by row.

    Each cell is (row, col). A point touches its cell. A line touches all cells it crosses;
    consecutive cells share a side. A polygon touches the cells whose centre is inside, or one cell
    if the polygon contains no centre. Parts off the grid are ignored.
    """
    return np.argwhere(mask_of(geometries, landscape)).astype(np.int32)


def mask_of(geometries: Iterable[BaseGeometry], landscape: Landscape) -> Mask:
    """Return the mask (y, x) of the cells that geometries touch (``cells_of``)."""
    touched = np.zeros(landscape.shape, dtype=np.bool_)
    for part in parts_of(geometries):
        if part.geom_type == "Polygon":
            _mark_polygon(part, landscape, touched)
        elif part.geom_type == "Point":
            _mark(_col_row(part, landscape), touched)
        else:
            _mark_line(part, landscape, touched)
    return touched


def burnable_cells(
    geometries: Iterable[BaseGeometry], landscape: Landscape
) -> list[tuple[int, int]]:
    """Return the (row, column) of each burnable cell that geometries touch (``cells_of``)."""
    cells = cells_of(geometries, landscape)
    burns = ~np.isin(landscape.fuel_model[tuple(cells.T)], list(NON_BURNABLE))
    return [(int(row), int(col)) for row, col in cells[burns]]


def with_barriers(
    landscape: Landscape, geometries: Iterable[BaseGeometry], code: int = BARE_GROUND
) -> Landscape:
    """Return the landscape with a non-burnable fuel code in all cells that geometries touch.

    Fire cannot cross a line in any direction, because consecutive cells of the line share a side.
    The outline of a polygon is a barrier too, so that a river narrower than a cell stops fire as a
    line does.

    Args:
        landscape: The landscape; it is not modified.
        geometries: shapely geometries in the landscape's CRS.
        code: A fuel code that does not burn (91 to 99).

    Returns:
        The landscape with barriers.

    Raises:
        FireModelError: ``code`` is a fuel that burns.
    """
    if code not in NON_BURNABLE:
        codes = ", ".join(map(str, NON_BURNABLE))
        raise FireModelError(f"barriers: fuel code {code} burns; use one of {codes}")
    shapes = list(geometries)
    outlines = [part.boundary for part in parts_of(shapes) if part.geom_type == "Polygon"]
    fuel = landscape.fuel_model.copy()
    fuel[mask_of([*shapes, *outlines], landscape)] = code
    return replace(landscape, fuel_model=fuel)


def cells_along(line: BaseGeometry, landscape: Landscape) -> tuple[NDArray[np.int64], Floats]:
    """Return the cells of a line, and for each cell the line's length up to the next cell.

    The cells are those of ``cells_of``. A length ends at the midpoint of the part of the line that
    is in the next cell.

    Args:
        line: A LineString in the landscape's CRS.
        landscape: The grid.

    Returns:
        The cells (k), as indices of the flattened cells, and the lengths (k) in m on the map. Of
        several visits to a cell, the first one counts.
    """
    rows, cols = landscape.shape
    points = _steps(_col_row(line, landscape))
    chain = np.floor(points).astype(np.int64)
    steps_m = landscape.cell_size_m * np.hypot(*np.diff(points, axis=0).T)
    at_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    enters = np.concatenate([[True], (chain[1:] != chain[:-1]).any(axis=1)])
    first = np.flatnonzero(enters)
    exits_m = np.append(at_m[first[1:]], at_m[-1])
    visits = chain[first]
    joints = np.stack([visits[1:, 0], visits[:-1, 1]], axis=1)  # cells that adjoin both
    diagonal = (visits[1:] != visits[:-1]).all(axis=1)
    col, row = np.concatenate([visits, joints[diagonal]]).T
    lengths_m = np.concatenate([exits_m, exits_m[:-1][diagonal]])
    on = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    found = np.full(rows * cols, np.inf)
    np.minimum.at(found, row[on] * cols + col[on], lengths_m[on])
    cells = np.flatnonzero(found < np.inf)
    return cells, found[cells]


def parts_of(geometries: Iterable[BaseGeometry]) -> Iterator[BaseGeometry]:
    """Yield the points, lines and polygons of geometries, including those in collections."""
    for geometry in geometries:
        if hasattr(geometry, "geoms"):
            yield from parts_of(geometry.geoms)
        elif not geometry.is_empty:
            yield geometry


def _col_row(geometry: BaseGeometry, landscape: Landscape) -> Floats:
    """Return the vertices (n, 2) as column and row from the grid's north-west corner.

    The integer parts of these numbers are the column and row of the cell.
    """
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
    """Mark the cells of every segment; join cells that touch only at a corner."""
    if line.length == 0.0:  # the intersection with the grid would be empty
        _mark(_col_row(line, landscape)[:1], touched)
        return
    rows, cols = touched.shape
    near = shapely.box(-1.0, -1.0, cols + 1.0, rows + 1.0)  # removes parts far outside the grid
    for part in parts_of([shapely.LineString(_col_row(line, landscape)).intersection(near)]):
        vertices = shapely.get_coordinates(part)
        chain = np.floor(_steps(vertices) if len(vertices) > 1 else vertices)
        joints = np.stack([chain[1:, 0], chain[:-1, 1]], axis=1)  # cells that adjoin both
        _mark(chain, touched)
        _mark(joints, touched)


def _steps(vertices: Floats) -> Floats:
    """Return points (m, 2) in order along a line (n, 2): one in each cell, and all vertices.

    The lines between columns and rows cut each segment into parts, each of which lies in one cell.
    The vertices are included so that lines that share a vertex mark a common cell, even if the
    vertex lies on the edge of a cell.
    """
    start, segments_xy = vertices[:-1], np.diff(vertices, axis=0)
    numbers = np.arange(len(segments_xy))
    segment = [numbers, numbers]
    at = [np.zeros(len(segments_xy)), np.ones(len(segments_xy))]
    for axis in (0, 1):
        low, high = np.sort(np.stack([vertices[:-1, axis], vertices[1:, axis]]), axis=0)
        first = np.floor(low) + 1.0
        count = np.maximum(np.ceil(high) - first, 0.0).astype(np.int64)
        of = np.repeat(numbers, count)
        edge = first[of] + np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
        segment.append(of)
        at.append((edge - start[of, axis]) / segments_xy[of, axis])
    segments, cuts = np.concatenate(segment), np.concatenate(at)
    order = np.lexsort((cuts, segments))
    segments, cuts = segments[order], cuts[order]
    inside = (segments[1:] == segments[:-1]) & (np.diff(cuts) > SHORTEST)
    of, middle = segments[:-1][inside], ((cuts[:-1] + cuts[1:]) / 2.0)[inside]
    points = np.concatenate([start, start[of] + middle[:, None] * segments_xy[of], vertices[1:]])
    place = np.concatenate(
        [np.full(len(segments_xy), -1.0), middle, np.full(len(segments_xy), 2.0)]
    )
    return points[np.lexsort((place, np.concatenate([numbers, of, numbers])))]
