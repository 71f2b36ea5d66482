"""Computes a vehicle's position on a front, the bearings in view, and the path to fly.

All planners use these functions, which need only the on-board map. Positions are rows and columns
of the landscape's grid, as floats. ``clockwise`` is the direction of flight around the fire.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import kernel
from mission_service.guidance.fire_map import BEARINGS, EAST, NORTH, FireMap, circular_mean
from mission_service.guidance.front.front_shape import close_gap

Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]

PATH_SMOOTHING_DEG = 2
WIDEST_GAP_DEG = 3
MIN_AREA_CELLS = 1e-9


@dataclass(frozen=True, slots=True)
class PathSettings:
    """The length of a path, and how far ahead of the vehicle the path starts, both in cells."""

    horizon_cells: float
    lookahead_cells: float


class PolarMap(Protocol):
    """A map around a centre.

    ``burned`` (360) is the distance in cells to the outermost ground seen burned on each bearing.
    """

    centre_row: float
    centre_col: float
    burned: Floats


def bearing_deg(fire_map: PolarMap, row: float, col: float) -> float:
    """Return the bearing of a position from the map's centre, in degrees clockwise from north."""
    angle_rad = float(np.arctan2(col - fire_map.centre_col, fire_map.centre_row - row))
    return math.degrees(angle_rad) % 360.0


def turned_deg(from_deg: float, to_deg: float, clockwise: bool) -> float:
    """Return the angle (-180 to 180) from one bearing to another in the direction of flight."""
    turned = (to_deg - from_deg + 180.0) % 360.0 - 180.0
    return turned if clockwise else -turned


def foremost_in_view(in_view: Booleans, bearing: int, clockwise: bool) -> int:
    """Return the farthest bearing ahead up to which the front is in view without a wide gap."""
    found: int = _foremost(in_view, int(bearing), 1 if clockwise else -1)
    return found


@kernel
def _foremost(in_view, bearing, step):  # type: ignore[no-untyped-def]
    last = -1
    for ahead in range(BEARINGS // 2):
        if last >= 0 and ahead - last > WIDEST_GAP_DEG:
            break
        if in_view[(bearing + step * ahead) % BEARINGS]:
            last = ahead
    return (bearing + step * max(last, 0)) % BEARINGS


def reconstructed_front(
    fire_map: FireMap, in_view: Booleans, row: float, col: float, clockwise: bool
) -> Floats:
    """Return the reconstructed front in cells on 360 bearings (Islam & Hu, section IV.B)."""
    outer, _ = fire_map.filled_outer()
    bearing = round(bearing_deg(fire_map, row, col))
    return close_gap(outer, foremost_in_view(in_view, bearing, clockwise), clockwise)


def extrapolated_front(
    fire_map: FireMap, in_view: Booleans, row: float, col: float, clockwise: bool
) -> Floats:
    """Return the front in cells on 360 bearings, extended ahead of the view by a straight line."""
    step = 1 if clockwise else -1
    outer, _ = fire_map.filled_outer()
    foremost = foremost_in_view(in_view, round(bearing_deg(fire_map, row, col)), clockwise)
    behind = (foremost - step * np.arange(BEARINGS // 3)) % BEARINGS
    points = np.column_stack([outer[behind] * NORTH[behind], outer[behind] * EAST[behind]])
    back = int(np.argmax(np.hypot(*(points - points[0]).T) >= 4.0))
    if back == 0:
        return np.where(np.isnan(fire_map.outer), outer[foremost], outer)
    heading = (points[0] - points[back]) / np.hypot(*(points[0] - points[back]))
    front = outer.copy()
    unseen = (foremost + step * np.arange(1, 120)) % BEARINGS
    across = NORTH[unseen] * heading[1] - EAST[unseen] * heading[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        line = (points[0, 0] * heading[1] - points[0, 1] * heading[0]) / across
    ends = np.flatnonzero(~np.isfinite(line) | (line <= 0) | (line > 3 * outer[foremost] + 20))
    reach = int(ends[0]) if ends.size else line.size
    front[unseen] = line[reach - 1] if reach else outer[foremost]
    front[unseen[:reach]] = line[:reach]
    return front


def path_along(
    front: Floats,
    fire_map: PolarMap,
    row: float,
    col: float,
    clockwise: bool,
    settings: PathSettings,
    smoothing_deg: int = PATH_SMOOTHING_DEG,
) -> Floats:
    """Return the path to fly along the front ahead: an array (n, 2) with row and column.

    ``front`` is in cells on 360 bearings. The path never crosses ground seen burned: where
    ``front`` is inside such ground, the path follows the outer edge of that ground.
    """
    step = 1 if clockwise else -1
    front = circular_mean(np.maximum(front, fire_map.burned + 0.5), smoothing_deg)
    start = round(bearing_deg(fire_map, row, col))
    order = (start + step * np.arange(BEARINGS * 5 // 6)) % BEARINGS
    north, east = front[order] * NORTH[order], front[order] * EAST[order]
    own_north, own_east = fire_map.centre_row - row, col - fire_map.centre_col
    far = np.hypot(north - own_north, east - own_east) >= settings.lookahead_cells
    first = int(np.argmax(far)) if far.any() else 0
    north, east = north[first:], east[first:]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(north), np.diff(east)))])
    keep = along <= settings.horizon_cells
    return np.column_stack([fire_map.centre_row - north[keep], fire_map.centre_col + east[keep]])


def centre_of_area(outer: Floats, centre_row: float, centre_col: float) -> tuple[float, float]:
    """Return the centroid (row, col) of the polygon described by ``outer`` (360).

    A polygon without area, such as a front within one cell, has the given centre.
    """
    north, east = outer * NORTH, outer * EAST
    cross = north * np.roll(east, -1) - np.roll(north, -1) * east
    area = float(cross.sum()) / 2.0
    if not abs(area) > MIN_AREA_CELLS:  # also if the front is unseen
        return centre_row, centre_col
    mean_north = ((north + np.roll(north, -1)) * cross).sum() / (6.0 * area)
    mean_east = ((east + np.roll(east, -1)) * cross).sum() / (6.0 * area)
    return centre_row - float(mean_north), centre_col + float(mean_east)
