"""Computes paths along closed fronts that an aircraft can fly at its turn radius.

The turn centre is the centre of the circle on which the vehicle would turn away from the burned
ground. The turn centre must stay at least one turn radius from all burned ground, so the turn
centre's curve is the front, offset by the turn radius. This offset bridges bays. Around a tip of
the burned ground, the turn centre moves on a larger circle than the vehicle: the radius of the
vehicle's turn is the radius of the larger circle less the turn radius. Therefore tips of the offset
curve are widened to twice the turn radius (``tip_kernels``). The path is the widened curve, offset
back by the turn radius.

Positions are rows and columns of the landscape's grid, as floats; lengths are in cells.
"""

import math

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from firemodel.arrays import evenly_along, lengths_along
from mission_service.guidance.front.informative.tip_kernels import widen_tips

Floats = NDArray[np.float64]

MIN_RADIUS_CELLS = 1.0  # smaller bays and tips are not resolved by the grid
SIMPLIFIED_CELLS = 0.2
STEPS_PER_RADIUS = 8  # number of path points per turn radius
TIP_TOLERANCE_RAD = 0.03
SMOOTHED_RADII = 0.5  # length of the moving average, in turn radii


def path_on_loop(
    points: Floats,
    start: int,
    clockwise: bool,
    length_cells: float,
    turn_radius_cells: float,
    inner: bool = False,
) -> Floats:
    """Return the path (m, 2) along a closed front: rows and columns of equidistant points.

    The path bridges bays narrower than the turn circle, and passes around tips narrower than the
    turn circle on the unburned side. Elsewhere the path is within one cell of the front. The burned
    ground of other fronts is not taken into account.

    Args:
        points: The front (n, 2), rows and columns, clockwise as seen on a map with north up,
            without a repeated end point.
        start: The index in ``points`` at which the path begins. If the vehicle cannot fly there,
            the path begins at the nearest position where the vehicle can fly.
        clockwise: The direction of travel as seen on the map.
        length_cells: The length of the path, which may be more than one lap.
        turn_radius_cells: The smallest turn radius.
        inner: Whether the front surrounds unburned ground (an island). The path is then inside the
            front, in the part nearest to ``start`` in which the vehicle can turn.

    Returns:
        The path. If the fire or the island is too small for a turn circle, the path is a circle
        with the turn radius around the centre of the fire or island. Around an island, this circle
        is over burned ground.
    """
    loop = flyable_loop(points, start, turn_radius_cells, inner)
    if clockwise == inner:
        loop = loop[::-1]
    nearest = int(np.argmin(np.hypot(*(loop - points[start]).T)))
    return _part(loop, nearest, length_cells)


def flyable_loop(points: Floats, start: int, turn_radius_cells: float, inner: bool) -> Floats:
    """Return the closed curve (n, 2) for flight along a front, without a repeated end point.

    Burned ground is on the right of the direction of travel. The arguments are those of
    ``path_on_loop``.
    """
    radius = max(turn_radius_cells, MIN_RADIUS_CELLS)
    # x is the column and y the row: with y southwards, a positive area is clockwise on the map.
    ground: BaseGeometry = shapely.simplify(shapely.Polygon(points[:, ::-1]), SIMPLIFIED_CELLS)
    if not ground.is_valid:  # the front crosses itself
        ground = shapely.make_valid(ground)
    centres = _turn_centres(ground, points[start][::-1], radius, inner)
    if centres is None:
        return _circle(ground, radius, inner)
    spacing = radius / STEPS_PER_RADIUS
    centres = _evenly(centres, spacing)
    widen_tips(centres, np.empty(len(centres)), 2.0 * radius, TIP_TOLERANCE_RAD)
    loop = _evenly(_offset_right(centres, radius), spacing)
    return _smoothed(loop, round(SMOOTHED_RADII * STEPS_PER_RADIUS))[:, ::-1]


def _turn_centres(ground: BaseGeometry, place: Floats, radius: float, inner: bool) -> Floats | None:
    """Return the closed curve (n, 2) of the turn centre; None if the front is too small to follow.

    Burned ground is on the right of the direction of travel.
    """
    west, north, east, south = ground.bounds
    may_fit = not inner and max(east - west, south - north) <= 2.0 * radius
    if may_fit and shapely.minimum_bounding_radius(ground) <= radius:
        return None
    around = ground.buffer(-radius if inner else radius, quad_segs=STEPS_PER_RADIUS)
    parts = [part for part in shapely.get_parts(around) if not part.is_empty]
    if not parts:
        return None
    part = parts[int(np.argmin(shapely.distance(parts, shapely.Point(place))))]
    ring = shapely.get_coordinates(part.exterior)
    return ring[::-1] if shapely.is_ccw(part.exterior) == inner else ring


def _circle(ground: BaseGeometry, radius: float, inner: bool) -> Floats:
    centre = ground.centroid if inner else shapely.minimum_bounding_circle(ground).centroid
    angles = np.linspace(0.0, math.tau, 8 * STEPS_PER_RADIUS, endpoint=False)
    circle = np.column_stack([np.sin(angles), np.cos(angles)]) * radius
    circle += [centre.y, centre.x]
    return circle[::-1] if inner else circle


def _evenly(ring: Floats, spacing: float) -> Floats:
    """Return equidistant points on a closed curve, without a repeated end point."""
    closed = np.concatenate([ring, ring[:1]])
    length = float(lengths_along(closed)[-1])
    return evenly_along(closed, max(8, math.ceil(length / spacing)))


def _offset_right(curve: Floats, distance: float) -> Floats:
    """Return a closed curve, offset to the right; arcs join the pieces at left turns."""
    steps = np.roll(curve, -1, axis=0) - curve
    heading = np.arctan2(steps[:, 1], steps[:, 0])
    before = np.roll(heading, 1)
    turn = (heading - before + math.pi) % math.tau - math.pi
    count = 1 + np.ceil(np.maximum(-turn, 0.0) * STEPS_PER_RADIUS).astype(int)
    place = np.repeat(np.arange(len(curve)), count)
    number = np.arange(len(place)) - np.repeat(np.cumsum(count) - count, count)
    # From the previous to the next heading, or halfway between them where one point is enough.
    share = np.where(count[place] > 1, number / np.maximum(count[place] - 1, 1), 0.5)
    heading = before[place] + share * turn[place]
    return curve[place] + distance * np.column_stack([-np.sin(heading), np.cos(heading)])


def _smoothed(loop: Floats, count: int) -> Floats:
    """Return the moving average of a closed curve over ``count`` steps."""
    total = np.cumsum(np.concatenate([loop[-count // 2 - 1 :], loop, loop[: count // 2]]), axis=0)
    smoothed: Floats = (total[count:] - total[:-count])[: len(loop)] / count
    return smoothed


def _part(loop: Floats, first: int, length: float) -> Floats:
    """Return the part of a closed curve that begins at an index and has a given length."""
    closed = np.concatenate([loop[first:], loop[: first + 1]])
    along = lengths_along(closed)
    count = max(2, math.ceil(length / along[-1] * len(loop)) + 1)
    places = np.linspace(0.0, length, count) % along[-1]
    return np.column_stack([np.interp(places, along, part) for part in closed.T])
