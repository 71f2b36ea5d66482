"""Compute the fronts of the estimated fire, with their speed and the time since observation.

A front is a closed line between burned and unburned ground. A fire has an outer front, and an inner
front around each unburned island; spot fires have their own fronts.

A part of a front counts as observed at the time of a sighting (an image of a cell) that showed the
front's position at that time. The estimated front has since moved on, so the time since observation
is that of the front's earlier position. ``last_seen_s`` searches for this position on the ground
``behind`` the front.
"""

from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from firemodel.arrays import Floats, Place, evenly_along
from firemodel.assimilation.camera_window import signed_distance_m
from firemodel.assimilation.distance_kernels import distance_cells
from firemodel.assimilation.learned_inputs import FrontParts, LearnedInputs
from firemodel.assimilation.observation import UNSEEN
from firemodel.spread.fire_scheme import Fire

MAX_POINTS = 600  # maximum number of points of all fronts; gives a journal line of about 20 kB
MIN_SPACING_CELLS = 1.0
MIN_LENGTH_CELLS = 4.0  # shorter fronts, such as islands of one cell, are omitted
GROUP_CELLS = 8  # parts of a front in a square of this size form one measurement
BACK_CELLS = 60  # distance behind the front up to which its earlier positions are searched
BESIDE = 1  # a sighting within this many positions of the front at that time shows the front


class FrontLine(NamedTuple):
    """A front: points (n) in clockwise order on the map, with their speed and last observation."""

    inner: bool
    row: Floats
    col: Floats
    ahead: FrontParts  # the cells in front of the points, and the normals there
    speed_m_s: Floats
    unseen_s: Floats


def front_lines(fire: Fire, seen_s: Floats, learned: LearnedInputs) -> list[FrontLine]:
    """Return the fronts of a fire at its current time, longest first.

    Args:
        fire: The estimated fire.
        seen_s: (y, x) the time of the last sighting of each cell, -infinity if there was none.
        learned: The learned inputs, from which the speeds are computed.
    """
    land, at_s = fire.landscape, fire.time_s
    cell_m = land.cell_size_m
    loops = _loops(fire.front(at_s), MIN_LENGTH_CELLS * cell_m)
    total_m = sum(line.length for line, _ in loops)
    spacing_m = max(MIN_SPACING_CELLS * cell_m, total_m / MAX_POINTS)
    arrival_s = fire.arrival_time_s
    begun_s = float(arrival_s.min())
    found = []
    for line, inner in loops:
        points = _points_along(line, spacing_m)
        row, col = (np.asarray(each) for each in land.row_col_of(points[:, 0], points[:, 1]))
        north, east = _outward(row, col, inner)
        ahead = (_cells(row - 0.5 * north, land.shape[0]), _cells(col + 0.5 * east, land.shape[1]))
        parts = FrontParts(*ahead, north, east)
        speed_m_s = learned.speeds_m_s(parts, fire.weather, at_s)
        ground = behind(arrival_s, seen_s, row, col, parts)
        last_s = np.clip(last_seen_s(ground), begun_s, at_s)
        found.append(FrontLine(inner, row, col, parts, speed_m_s, at_s - last_s))
    return found


def _loops(
    area: shapely.MultiPolygon, min_length_m: float
) -> list[tuple[shapely.LineString, bool]]:
    """Return the boundary lines of an area, clockwise on the map, with True for inner lines."""
    loops = []
    for polygon in area.geoms:
        for inner, rings in ((False, [polygon.exterior]), (True, list(polygon.interiors))):
            for ring in rings:
                if ring.length >= min_length_m:
                    loops.append((ring.reverse() if ring.is_ccw else ring, inner))
    return sorted(loops, key=lambda each: (-each[0].length, each[0].coords[0]))


def _points_along(line: shapely.LineString, spacing_m: float) -> Floats:
    """Return points (n, 2) at equal distances along a closed line, without the last one."""
    count = max(round(line.length / spacing_m), 3)
    return evenly_along(shapely.get_coordinates(line), count)


def _outward(rows: Floats, cols: Floats, inner: bool) -> tuple[Floats, Floats]:
    """Return the normals to the unburned side, north and east, of a clockwise loop."""
    north, east = np.roll(rows, 1) - np.roll(rows, -1), np.roll(cols, -1) - np.roll(cols, 1)
    length = np.maximum(np.hypot(north, east), 1e-9) * (-1.0 if inner else 1.0)
    return east / length, -north / length  # the outside of the loop is to the left of its direction


def _cells(places: Floats, count: int) -> NDArray[np.int64]:
    return np.clip(np.rint(places), 0, count - 1).astype(np.int64)


class Behind(NamedTuple):
    """The ground behind a front, against its normals: (BACK_CELLS + 1, n), from one cell ahead.

    At time t the front was at the first position behind the present front that had burned by t.
    """

    burned_s: Floats  # the time from which this position or one nearer to the front has burned
    seen_s: Floats  # the time of the last sighting


def behind(
    arrival_s: Floats, seen_s: Floats, rows: Floats, cols: Floats, parts: FrontParts
) -> Behind:
    """Return the ground behind the parts of a front.

    Args:
        arrival_s: (y, x) the arrival times of the fire.
        seen_s: (y, x) the time of the last sighting of each cell.
        rows, cols: The positions of the parts of the front (n).
        parts: The parts of the front (n), with the normals to the unburned side.
    """
    back = np.arange(-1.0, BACK_CELLS)[:, None]
    at = (
        _cells(rows + back * parts.north, arrival_s.shape[0]),
        _cells(cols - back * parts.east, arrival_s.shape[1]),
    )
    return Behind(np.minimum.accumulate(arrival_s[at], axis=0), seen_s[at])


def last_seen_s(ground: Behind) -> Floats:
    """Return the time (n) at which each part of a front was last observed; -infinity if never."""
    burned_s, seen_s = ground
    # The position BESIDE further back, and the nearest position more than BESIDE further ahead.
    further_s = np.pad(burned_s[BESIDE:], ((0, BESIDE), (0, 0)), mode="edge")
    nearer_s = np.pad(burned_s[: -BESIDE - 1], ((BESIDE + 1, 0), (0, 0)), constant_values=np.inf)
    shows = (further_s <= seen_s) & (seen_s < nearer_s)
    found_s = np.where(shows, seen_s, -np.inf).max(axis=0)
    return _gaps_closed(found_s)


def _gaps_closed(found_s: Floats) -> Floats:
    """Return the times (n) along a closed line, with gaps of one or two parts closed.

    Parts between two observed parts were also in view; only the ground behind them was not imaged.
    """
    wide_s = np.maximum.reduce([np.roll(found_s, shift) for shift in (-1, 0, 1)])
    return np.asarray(np.minimum.reduce([np.roll(wide_s, shift) for shift in (-1, 0, 1)]))


class FrontDistances(NamedTuple):
    """The arguments of ``LearnedInputs.learn`` for parts of a front that have come into view."""

    parts: FrontParts
    advance_cells: Floats
    ahead_cells: Floats
    groups: NDArray[np.int64]


def front_distances(
    fronts: list[FrontLine], here: Place, state: NDArray[np.uint8], cell_m: float
) -> FrontDistances:
    """Return the distances between the estimated fronts and the front in images.

    Each distance is limited to the distance to the nearest cell that is not in the images.

    Args:
        fronts: The estimated fronts.
        here: The window of the images in the grid.
        state: (y, x) the observed states in the window: UNSEEN, UNBURNED or BURNED.
        cell_m: The size of a cell.
    """
    top, left = here[0].start, here[1].start
    row = np.concatenate([np.empty(0), *(each.row for each in fronts)])
    col = np.concatenate([np.empty(0), *(each.col for each in fronts)])
    advance_m = np.concatenate([np.empty(0), *(each.speed_m_s * each.unseen_s for each in fronts)])
    ahead_rows, ahead_cols, north, east = (
        np.concatenate([np.empty(0, dtype), *(each.ahead[k] for each in fronts)])
        for k, dtype in enumerate((np.int64, np.int64, np.float64, np.float64))
    )
    at = np.rint(row).astype(np.int64) - top, np.rint(col).astype(np.int64) - left
    inside = (at[0] >= 0) & (at[1] >= 0)
    inside &= (at[0] < state.shape[0]) & (at[1] < state.shape[1])
    inside[inside] = state[at[0][inside], at[1][inside]] != UNSEEN
    at = at[0][inside], at[1][inside]
    ahead = signed_distance_m(state, cell_m)[at] / cell_m
    padded = np.pad(state == UNSEEN, 1, constant_values=True)
    in_view = distance_cells(padded)[1:-1, 1:-1][at]
    groups = (at[0] // GROUP_CELLS) * 4096 + at[1] // GROUP_CELLS
    return FrontDistances(
        FrontParts(ahead_rows[inside], ahead_cols[inside], north[inside], east[inside]),
        advance_m[inside] / cell_m,
        np.clip(ahead, -in_view, in_view),
        groups,
    )
