"""Computes the fire's shape from the on-board map: closes gaps, finds perimeter cells and the hull.

The methods are from Islam & Hu, sections IV.B and VI.E. Positions are in cells north and east of
the map's centre.
"""

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import compiled
from mission_service.guidance.fire_map import BEARINGS, EAST, NORTH

Floats = NDArray[np.float64]

# In the paper, the scan continues "as long as the angle keeps increasing". Because cells form a
# staircase, this scan ends only when the angle is this far below the largest angle so far.
STAIRCASE_DEG = 4.0
SCAN_DEG = 150


def close_gap(outer: Floats, foremost: int, clockwise: bool) -> Floats:
    """Join the end of the front in view to the older front ahead with a straight line (scan).

    Args:
        outer: The distance of the front in cells on each bearing (360), without NaN.
        foremost: The last bearing in the direction of flight on which the front is in view.
        clockwise: Whether the vehicle flies clockwise.

    Returns:
        A copy of ``outer`` in which no part of the front from the foremost cell to the cell with
        the largest angle in the scan is inside the straight line between these two cells.
    """
    joined: Floats = _close_gap(outer, int(foremost), 1 if clockwise else -1)
    return joined


@compiled
def _close_gap(outer, foremost, step):  # type: ignore[no-untyped-def]
    start_north = outer[foremost] * NORTH[foremost]
    start_east = outer[foremost] * EAST[foremost]
    # The angle is between the directions to the centre and to the scanned cell, positive outwards.
    inward = foremost + 180.0
    highest, best = -np.inf, 0
    for ahead in range(SCAN_DEG - 1):
        bearing = (foremost + step * (ahead + 1)) % BEARINGS
        north = outer[bearing] * NORTH[bearing] - start_north
        east = outer[bearing] * EAST[bearing] - start_east
        angle = step * (inward - np.rad2deg(np.arctan2(east, north)))
        angle = (angle + 90.0) % 360.0 - 90.0
        if angle > highest:
            highest, best = angle, ahead
        elif angle < highest - STAIRCASE_DEG:
            break
    joined = outer.copy()
    if best == 0:
        return joined
    end = (foremost + step * (best + 1)) % BEARINGS
    line_north = outer[end] * NORTH[end] - start_north
    line_east = outer[end] * EAST[end] - start_east
    for ahead in range(best):
        bearing = (foremost + step * (ahead + 1)) % BEARINGS
        across = NORTH[bearing] * line_east - EAST[bearing] * line_north
        distance = (start_north * line_east - start_east * line_north) / across
        if np.isfinite(distance) and distance > joined[bearing]:
            joined[bearing] = distance
    return joined


def ring_of_cells(
    outer: Floats, start: int, clockwise: bool
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return the closed ring of perimeter cells, from ``start`` against the direction of flight.

    The three arrays hold each cell's distances north and east of the centre, in whole cells, and
    each cell's bearing. Successive cells share a side or a corner.
    """
    cells: tuple[Floats, Floats, NDArray[np.int64]] = _ring_of_cells(
        outer, int(start), -1 if clockwise else 1
    )
    return cells


@compiled
def _ring_of_cells(outer, start, step):  # type: ignore[no-untyped-def]
    north, east = np.rint(outer * NORTH), np.rint(outer * EAST)
    size = 0
    for bearing in range(BEARINGS):
        next_bearing = (bearing + 1) % BEARINGS
        size += int(
            max(abs(north[next_bearing] - north[bearing]), abs(east[next_bearing] - east[bearing]))
        )
    cell_north, cell_east = np.empty(size), np.empty(size)
    cell_bearing = np.empty(size, dtype=np.int64)
    cell = 0
    for place in range(BEARINGS):
        bearing = (start + step * place) % BEARINGS
        next_bearing = (bearing + step) % BEARINGS
        to_north, to_east = north[next_bearing] - north[bearing], east[next_bearing] - east[bearing]
        count = int(max(abs(to_north), abs(to_east)))
        for part in range(count):
            cell_north[cell] = np.rint(north[bearing] + part / count * to_north)
            cell_east[cell] = np.rint(east[bearing] + part / count * to_east)
            cell_bearing[cell] = bearing
            cell += 1
    return cell_north, cell_east, cell_bearing


def steps_between(north: Floats, east: Floats) -> Floats:
    """Return the distance in cells from each cell of a closed ring to the next one."""
    steps: Floats = np.hypot(np.diff(north, append=north[:1]), np.diff(east, append=east[:1]))
    return steps


def hull_of(shape: Floats) -> Floats:
    """Return the convex hull of a shape; both are distances on 360 bearings (VI.E)."""
    distance: Floats = _hull_of(shape)
    return distance


@compiled
def _hull_of(shape):  # type: ignore[no-untyped-def]
    """Compute the hull with Andrew's monotone chain over the points in order of bearing.

    The chain starts at the farthest point. The order by bearing is also the order on the hull,
    because the centre is inside the hull.
    """
    north, east = shape * NORTH, shape * EAST
    first = int(np.argmax(shape))  # a corner of the hull
    corners = np.empty(BEARINGS + 1, dtype=np.int64)
    size = 0
    for place in range(BEARINGS + 1):
        added = (first + place) % BEARINGS
        while size > 1:
            last, before = corners[size - 1], corners[size - 2]
            turn = (east[last] - east[before]) * (north[added] - north[last])
            turn -= (north[last] - north[before]) * (east[added] - east[last])
            if turn < 0.0:  # a right turn, as on a convex hull
                break
            size -= 1
        corners[size] = added
        size += 1
    found = shape.copy()
    for corner in range(size - 1):
        start, end = corners[corner], corners[corner + 1]
        to_north, to_east = north[end] - north[start], east[end] - east[start]
        for step in range(1, (end - start) % BEARINGS):
            bearing = (start + step) % BEARINGS
            across = EAST[bearing] * to_north - NORTH[bearing] * to_east
            if across != 0.0:
                on_side = (east[start] * to_north - north[start] * to_east) / across
                found[bearing] = max(on_side, found[bearing])
    return found
