"""Divides the estimated fronts into nodes, and computes the growth of each node's expected error.

The error of a node is the distance between the estimated and the true front. While the node is out
of view, the error grows at a rate that equals the standard deviation of the front's speed. Lengths
are in cells, times in seconds, and speeds in cells per second.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mission_service.events import EstimatedFront
from mission_service.guidance.front.sweeps import flight_times

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MAX_NODES = 96  # of all fronts together
MIN_NODES = 4  # of each front
LEFT_CELLS = 0.5  # error of a front in view
# Minimum growth of the error: as a fraction of the mean growth, and in cells per second. The
# minimum represents model errors that are not explained by wrong inputs.
MIN_GROWTH_SHARE = 1.0
MIN_GROWTH_CELLS_S = 2e-5
MIN_STEP_CELLS = 1e-9
MAX_UNSEEN_S = 86_400.0


class Front(NamedTuple):
    """A closed front: n points in clockwise order, as seen on the map."""

    inner: bool  # whether the front surrounds an unburned island
    points: Floats  # (n, 2) row and column
    speed_sd_cells_s: Floats  # standard deviation of the speed
    seen_at_s: Floats  # time of the last observation
    along_cells: Floats  # distance from the first point (n + 1); the last is the front's length

    @property
    def length_cells(self) -> float:
        """The length of the front."""
        return float(self.along_cells[-1])

    def nearest(self, row: float, col: float) -> tuple[int, float]:
        """Return the index of the point nearest to a position, and the distance to it in cells."""
        away = np.hypot(self.points[:, 0] - row, self.points[:, 1] - col)
        index = int(away.argmin())
        return index, float(away[index])


class FrontNodes(NamedTuple):
    """The nodes of all fronts; a node is an index into these arrays, which have equal lengths."""

    front: Integers  # the index of the front
    point: Integers  # index of the node's first point on its front
    row: Floats  # the midpoint of the node
    col: Floats
    first: Integers  # the first node of the front
    nodes_of_front: Integers  # the number of nodes of the front
    weight: Floats  # the length of the node in cells
    ahead_s: Floats  # flight time along the node clockwise
    back_s: Floats  # flight time along the node anticlockwise
    seen_at_s: Floats
    growth: Floats  # growth of the error out of view, in cells/s


def front_of(estimated: EstimatedFront, at_s: float, cell_m: float) -> Front:
    """Return a front from an event at ``at_s``, with lengths in cells."""
    points = np.column_stack([estimated.rows, estimated.cols])
    steps = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
    return Front(
        estimated.inner,
        points,
        np.array(estimated.speed_sds_m_s) / cell_m,
        at_s - np.minimum(estimated.unseen_s, MAX_UNSEEN_S),
        np.concatenate([[0.0], np.cumsum(steps)]),
    )


def nodes_of(
    fronts: Sequence[Front], airspeed_cells_s: float, wind_cells_s: tuple[float, float]
) -> FrontNodes:
    """Return the nodes of the given fronts.

    Args:
        fronts: The fronts; at least one.
        airspeed_cells_s: The airspeed of the vehicle.
        wind_cells_s: The speeds towards north and east at which the wind carries the vehicle.
    """
    total = sum(front.length_cells for front in fronts)
    parts = []
    first = 0
    for number, front in enumerate(fronts):
        share = front.length_cells / total
        count = max(round(MAX_NODES * share), MIN_NODES)
        parts.append(_nodes_on(number, front, first, count, airspeed_cells_s, wind_cells_s))
        first += count
    columns = [np.concatenate(each) for each in zip(*parts, strict=True)]
    found = FrontNodes(*columns)
    least = max(
        MIN_GROWTH_CELLS_S, MIN_GROWTH_SHARE * float(np.average(found.growth, weights=found.weight))
    )
    return found._replace(growth=np.maximum(found.growth, least))


def _nodes_on(
    number: int,
    front: Front,
    first: int,
    count: int,
    airspeed: float,
    wind: tuple[float, float],
) -> tuple[NDArray[np.generic], ...]:
    size = len(front.points)
    edges = front.length_cells * np.arange(count + 1) / count
    place = np.clip(np.searchsorted(front.along_cells, edges[:-1], side="right") - 1, 0, size - 1)
    following = np.roll(front.points, -1, axis=0)
    steps = following - front.points
    length = np.maximum(np.hypot(*steps.T), MIN_STEP_CELLS)
    ahead, back = flight_times(-steps[:, 0], steps[:, 1], length, airspeed, wind)
    ends = np.append(place[1:], size)
    members = [
        np.arange(start, max(end, start + 1)) for start, end in zip(place, ends, strict=True)
    ]
    middle = [int(each[each.size // 2]) for each in members]
    growth = [float(front.speed_sd_cells_s[each].max()) for each in members]
    seen = [float(front.seen_at_s[each].min()) for each in members]
    node_length = front.length_cells / count

    def along(times_s: Floats) -> Floats:
        """Return the flight time along each node, from the flight times along the steps."""
        passed = np.concatenate([[0.0], np.cumsum(times_s)])
        return np.diff(np.interp(edges, front.along_cells, passed))

    return (
        np.full(count, number),
        place,
        front.points[middle, 0],
        front.points[middle, 1],
        np.full(count, first),
        np.full(count, count),
        np.full(count, node_length),
        along(ahead),
        along(back),
        np.array(seen),
        np.array(growth),
    )


def hop_times_s(
    nodes: FrontNodes, airspeed_cells_s: float, wind_cells_s: tuple[float, float]
) -> Floats:
    """Return the flight time (n, n) in a straight line from each node to every other node."""
    north = nodes.row[:, None] - nodes.row[None, :]
    east = nodes.col[None, :] - nodes.col[:, None]
    length = np.maximum(np.hypot(north, east), MIN_STEP_CELLS)
    found: Floats = flight_times(north, east, length, airspeed_cells_s, wind_cells_s)[0]
    return found
