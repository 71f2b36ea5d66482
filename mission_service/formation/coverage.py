"""A rule for virtual agents beyond the paper's forces: each goes where it adds most to the others.

What an agent adds, the weight in its circle that no other covers, is its part of a potential that
all share, the weight they cover together. So whoever gains lets all gain, and they come to rest,
which measured is within 3 % of the best placement (``experiments/static_placement.py``). Forces
stop wherever they cancel: between the fire's centre and a neighbour.

An agent weighs all places in its area, on a lattice, with the way there: around the augmented
fire, never through. It moves only for what is worth it (``WORTH``) or when the fire comes, so that
a loiter item can fly a settled one. Where coverage has no use for it, it keeps away from others.

Weights count in fifths: 5 for a cell within the augmentation (priority 1), 1 within d_mon (0.2).
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import kernel
from mission_service.formation.coverage_kernels import (
    NO_WAY,
    crowding,
    extent,
    find_ways,
    is_clear,
    is_free,
    sum_left_over,
    weight_within,
    wider,
)
from mission_service.formation.grid import Grid
from mission_service.formation.settings import Settings

Floats = NDArray[np.float64]

WORTH = 80.0  # a move must gain so much: half a percent of what four cover
WAY_PER_M = 0.1  # what a metre of way costs
# Others nearer than the spacing cost up to this, nearer than the second number up to the third.
NEIGHBOUR, CROWD_M, CROWD = 100.0, 150.0, 5000.0
LATTICE_M = 40.0
MARGIN_M = 20.0  # a new place is so far from the augmented fire, to last for a while
ARRIVED_M = 0.5


@dataclass(frozen=True, slots=True)
class Errand:
    """Where a virtual agent goes, and the place up to which it can go straight."""

    goal_x_m: float
    goal_y_m: float
    via_x_m: float
    via_y_m: float


@dataclass(frozen=True, eq=False, slots=True)
class _Room:
    """Circles, and what the kernels write in; shared by all agents of a process."""

    half_widths: NDArray[np.int64]
    sums: NDArray[np.int32]  # (rows, cols + 1)
    ways: Floats
    before: NDArray[np.int64]
    times: Floats
    keys: NDArray[np.int64]
    found: Floats


@lru_cache(maxsize=4)
def _room(rows: int, cols: int, stride: int, radius: float) -> _Room:
    nodes = ((rows - 1) // stride + 1) * ((cols - 1) // stride + 1)
    down = np.arange(-math.floor(radius), math.floor(radius) + 1)
    return _Room(
        np.floor(np.sqrt(radius * radius - down * down)).astype(np.int64),
        np.zeros((rows, cols + 1), dtype=np.int32),
        np.zeros(nodes),
        np.zeros(nodes, dtype=np.int64),
        np.zeros(8 * nodes + 512),
        np.zeros(8 * nodes + 512, dtype=np.int64),
        np.zeros(4),
    )


def next_errand(
    x_m: float,
    y_m: float,
    errand: Errand | None,
    others_x_m: Floats,
    others_y_m: Floats,
    fire: NDArray[np.bool_],
    augmentation: NDArray[Any],
    monitored: NDArray[Any],
    area: NDArray[Any],
    grid: Grid,
    settings: Settings,
) -> Errand | None:
    """Where the agent at (x, y) goes now; None outside its area, where forces must bring it.

    ``errand`` is what this said last (None at first), ``others_*`` (n) the places of the other
    agents. Maps are (rows, cols), not 0 within their distances of fire (``AgentMaps``):
    ``monitored`` is d_mon. To be asked every few seconds; between, see ``velocity``.
    """
    cell_m = grid.cell_m
    row, col = grid.row_col_of(x_m, y_m)
    if not (-0.5 <= row < grid.rows - 0.5 and -0.5 <= col < grid.cols - 0.5):
        return None
    goal_row, goal_col = (
        grid.row_col_of(errand.goal_x_m, errand.goal_y_m) if errand else (row, col)
    )
    stride = max(round(LATTICE_M / cell_m), 1)
    radius = settings.coverage_radius_m / cell_m
    room = _room(grid.rows, grid.cols, stride, radius)
    found = room.found
    if not _next_errand(
        row,
        col,
        goal_row,
        goal_col,
        (grid.north_m - others_y_m) / cell_m - 0.5,
        (others_x_m - grid.west_m) / cell_m - 0.5,
        fire,
        augmentation,
        monitored,
        area,
        cell_m,
        radius,
        math.ceil(settings.monitoring_m / cell_m) + 1,
        math.ceil(settings.agent_area_m / cell_m) + 1,
        settings.spacing_m / cell_m,
        stride,
        room.half_widths,
        room.sums,
        room.ways,
        room.before,
        room.times,
        room.keys,
        found,
    ):
        return None
    return Errand(*grid.xy_of(*found[:2].tolist()), *grid.xy_of(*found[2:].tolist()))


def settled(x_m: float, y_m: float, errand: Errand) -> bool:
    """Whether the agent has nowhere to go."""
    return math.hypot(errand.goal_x_m - x_m, errand.goal_y_m - y_m) < ARRIVED_M


def velocity(
    x_m: float, y_m: float, errand: Errand, most_m_s: float, step_s: float
) -> tuple[float, float]:
    """East and north in m/s with which the agent goes on for a step; it stops where it must."""
    east, north = errand.via_x_m - x_m, errand.via_y_m - y_m
    way_m = math.hypot(east, north)
    if way_m < 1e-6:
        return 0.0, 0.0
    speed_m_s = min(most_m_s, way_m / step_s)
    return east / way_m * speed_m_s, north / way_m * speed_m_s


@kernel
def _next_errand(  # type: ignore[no-untyped-def]
    row,
    col,
    goal_row,
    goal_col,
    others_row,
    others_col,
    fire,
    augmentation,
    monitored,
    area,
    cell_m,
    radius,
    monitored_reach,
    area_reach,
    spacing,
    stride,
    half_widths,
    sums,
    ways,
    before,
    times,
    keys,
    found,
):
    """``next_errand`` in cells; ``found`` (4) is the goal and the via. False for None."""
    rows, cols = fire.shape
    wide = (cols - 1) // stride + 1
    if area[math.floor(row + 0.5), math.floor(col + 0.5)] == 0:
        return False
    burning = extent(fire)
    box = wider(burning, monitored_reach, fire.shape)
    sum_left_over(fire, augmentation, monitored, others_row, others_col, radius, box, sums)
    field = wider(burning, area_reach, fire.shape)
    if not find_ways(row, col, augmentation, field, stride, ways, before, times, keys):
        return False
    margin = math.ceil(MARGIN_M / cell_m)
    crowd_at = CROWD_M / cell_m
    # What there is already: the goal, unless the fire has come.
    r, c = math.floor(goal_row + 0.5), math.floor(goal_col + 0.5)
    found[0], found[1] = goal_row, goal_col
    node = nearest_node(r, c, stride, rows, cols)
    least = -NO_WAY
    if is_free(r, c, augmentation, 0):
        least = WORTH + (
            weight_within(r, c, half_widths, box, sums)
            - crowding(r, c, others_row, others_col, spacing, NEIGHBOUR, crowd_at, CROWD)
            - WAY_PER_M * cell_m * math.hypot(r - row, c - col)
        )
        if not is_clear(row, col, r, c, augmentation):
            least -= WAY_PER_M * cell_m * (min(ways[node], 1e9) - math.hypot(r - row, c - col))
    best, best_node = least, -1
    for i in range((field[0] + stride - 1) // stride, (field[1] - 1) // stride + 1):
        for j in range((field[2] + stride - 1) // stride, (field[3] - 1) // stride + 1):
            way = ways[i * wide + j]
            r, c = i * stride, j * stride
            if way == NO_WAY or area[r, c] == 0 or not is_free(r, c, augmentation, margin):
                continue
            value = (
                weight_within(r, c, half_widths, box, sums)
                - crowding(r, c, others_row, others_col, spacing, NEIGHBOUR, crowd_at, CROWD)
                - WAY_PER_M * cell_m * way
            )
            if value > best:
                best, best_node = value, i * wide + j
    if best_node >= 0:
        node = best_node
        r0, c0 = node // wide * stride, node % wide * stride
        found[0], found[1] = r0, c0
        # Between the nodes there may be better.
        best = -NO_WAY
        for r in range(r0 - stride + 1, r0 + stride):
            for c in range(c0 - stride + 1, c0 + stride):
                if is_free(r, c, augmentation, margin):
                    value = weight_within(r, c, half_widths, box, sums) - crowding(
                        r, c, others_row, others_col, spacing, NEIGHBOUR, crowd_at, CROWD
                    )
                    if value > best:
                        best, found[0], found[1] = value, r, c
    elif least == -NO_WAY:
        return False
    first_leg(row, col, node, augmentation, stride, wide, ways, before, found)
    return True


@kernel
def nearest_node(row, col, stride, rows, cols):  # type: ignore[no-untyped-def]
    """The number of the node nearest to a cell."""
    high, wide = (rows - 1) // stride + 1, (cols - 1) // stride + 1
    i = min((row + stride // 2) // stride, high - 1)
    j = min((col + stride // 2) // stride, wide - 1)
    return i * wide + j


@kernel
def first_leg(row, col, node, augmentation, stride, wide, ways, before, found):  # type: ignore[no-untyped-def]
    """Put into ``found`` how far one can go straight towards the goal, which is next to a node."""
    found[2], found[3] = found[0], found[1]
    if is_clear(row, col, found[0], found[1], augmentation) or ways[node] == NO_WAY:
        return
    while True:
        found[2], found[3] = node // wide * stride, node % wide * stride
        if before[node] < 0 or is_clear(row, col, found[2], found[3], augmentation):
            return
        node = before[node]
