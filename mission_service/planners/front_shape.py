"""Fire shape from the on-board map: the scan method and the ring of perimeter cells.

Islam & Hu, section IV.B. Positions are in cells north and east of the map's centre.
"""

import numpy as np
from numpy.typing import NDArray

from mission_service.fire_map import BEARINGS, EAST, NORTH

Floats = NDArray[np.float64]

# The paper scans "as long as the angle keeps increasing"; cells are a staircase, so the scan ends
# only when the angle has fallen this far below the largest one.
STAIRCASE_DEG = 4.0
SCAN_DEG = 150


def close_gap(outer: Floats, foremost: int, clockwise: bool) -> Floats:
    """Join the freshly seen front to the older one ahead by a straight line (scan method).

    Args:
        outer: distance of the front in cells for each bearing (360), no NaN.
        foremost: bearing of the last fresh front cell in the flying direction.
        clockwise: flying direction.

    Returns a copy in which the bearings between the foremost cell and the best cell lie on the
    straight line that connects them.
    """
    step = 1 if clockwise else -1
    ahead = (foremost + step * np.arange(1, SCAN_DEG)) % BEARINGS
    north = outer[ahead] * NORTH[ahead] - outer[foremost] * NORTH[foremost]
    east = outer[ahead] * EAST[ahead] - outer[foremost] * EAST[foremost]
    # Turn from "towards the centre" to the cell, counted outwards along the flying direction.
    inward = foremost + 180.0
    angle = step * (inward - np.rad2deg(np.arctan2(east, north)))
    angle = np.mod(angle + 90.0, 360.0) - 90.0
    highest = np.maximum.accumulate(angle)
    fallen = np.flatnonzero(angle < highest - STAIRCASE_DEG)
    scanned = angle[: fallen[0]] if fallen.size else angle
    best = int(np.argmax(scanned))
    joined = outer.copy()
    if best > 0:
        between = ahead[:best]
        on_line = _line_distance(outer, foremost, int(ahead[best]), between)
        joined[between] = np.maximum(outer[between], on_line)
    return joined


def _line_distance(outer: Floats, start: int, end: int, bearings: NDArray[np.int64]) -> Floats:
    """Distance from the centre, along each bearing, of the line through two front cells."""
    start_north, start_east = outer[start] * NORTH[start], outer[start] * EAST[start]
    line_north = outer[end] * NORTH[end] - start_north
    line_east = outer[end] * EAST[end] - start_east
    across = NORTH[bearings] * line_east - EAST[bearings] * line_north
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (start_north * line_east - start_east * line_north) / across
    return np.where(np.isfinite(distance) & (distance > 0), distance, 0.0)


def ring_of_cells(
    outer: Floats, start: int, clockwise: bool
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """The closed ring of perimeter cells, from the vehicle's bearing against its direction.

    Returns (north, east, bearing) of each cell in whole cells relative to the centre; cells
    follow each other without gaps (8 neighbours).
    """
    step = -1 if clockwise else 1
    order = (start + step * np.arange(BEARINGS)) % BEARINGS
    north = np.rint(outer[order] * NORTH[order])
    east = np.rint(outer[order] * EAST[order])
    to_north = np.roll(north, -1) - north
    to_east = np.roll(east, -1) - east
    count = np.maximum(np.abs(to_north), np.abs(to_east)).astype(np.int64)
    segment = np.repeat(np.arange(BEARINGS), count)
    first = np.cumsum(count) - count
    share = (np.arange(segment.size) - first[segment]) / np.maximum(count[segment], 1)
    cell_north = np.rint(north[segment] + share * to_north[segment])
    cell_east = np.rint(east[segment] + share * to_east[segment])
    return cell_north, cell_east, order[segment]


def steps_between(north: Floats, east: Floats) -> Floats:
    """Distance in cells from each ring cell to the next one, the last to the first."""
    steps: Floats = np.hypot(np.roll(north, -1) - north, np.roll(east, -1) - east)
    return steps
