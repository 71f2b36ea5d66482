"""A rule for virtual agents beyond the paper's forces: each goes where it adds most to the others.

What an agent adds, the weight in its circle that no other covers, is its part of a potential that
all share, the weight they cover together. So whoever gains lets all gain, and they come to rest,
which measured is within 3 % of the best placement (``virtual_agents/static_placement.py`` of the
experiments). Forces stop wherever they cancel: between the fire's centre and a neighbour.

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
from mission_service.guidance.formation.coverage_kernels import (
    crowding,
    extent,
    find_ways,
    first_leg,
    is_clear,
    is_free,
    sum_left_over,
    weight_within,
    wider,
)
from mission_service.guidance.formation.fire_maps import AgentMaps
from mission_service.guidance.formation.forces import as_array, velocity_of_forces
from mission_service.guidance.formation.grid import Grid
from mission_service.guidance.formation.settings import Settings

Floats = NDArray[np.float64]

# What a move must gain at once (half a percent of what four cover), and after some time in a place.
WORTH, WORTH_LATER, LATER_S = 80.0, 10.0, 120.0
WAY_PER_M = 0.03  # what a metre of way costs
# Others nearer than the spacing cost up to this, nearer than the second number up to the third.
NEIGHBOUR, CROWD_M, CROWD = 800.0, 150.0, 5000.0
LATTICE_M = 60.0
MARGIN_M, TOUCHING = 10.0, 50.0  # what it costs to be so near to the augmented fire, for it grows
ARRIVED_M = 0.5
STILL_M = 5.0  # another that went farther since the last decision is on its way
DECIDE_EVERY_S = 2.0


@dataclass(frozen=True, slots=True)
class Errand:
    """Where a virtual agent goes, and the place up to which it can go straight.

    ``since_s`` is when it chose the goal.
    """

    goal_x_m: float
    goal_y_m: float
    via_x_m: float
    via_y_m: float
    since_s: float


@dataclass(frozen=True, eq=False, slots=True)
class _Room:
    """Circles, and what the kernels write in; shared by all agents of a process."""

    half_widths: NDArray[np.int64]
    sums: NDArray[np.int32]  # (rows, cols + 1)
    ways: Floats
    before: NDArray[np.int64]
    queue: NDArray[np.int64]
    queued: NDArray[np.bool_]
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
        np.zeros(nodes, dtype=np.int64),
        np.zeros(nodes, dtype=np.bool_),
        np.zeros(4),
    )


def next_errand(
    at_s: float,
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
    """Where the agent at (x, y) goes now; None outside its area, to which forces must bring it.

    ``errand`` is what this said last (None at first), ``others_*`` (n) the places of the other
    agents. Maps are (rows, cols), not 0 within their distances of fire
    (``AgentMaps``): ``monitored`` is d_mon. To be asked every few seconds (``Mover``).
    """
    cell_m = grid.cell_m
    row, col = grid.row_col_of(x_m, y_m)
    if not (-0.5 <= row < grid.rows - 0.5 and -0.5 <= col < grid.cols - 0.5):
        return None
    goal_row, goal_col = grid.row_col_of(errand.goal_x_m, errand.goal_y_m) if errand else (row, col)
    since_s = errand.since_s if errand else at_s
    patience = min(max(at_s - since_s, 0.0) / LATER_S, 1.0)
    stride = max(round(LATTICE_M / cell_m), 1)
    radius = settings.coverage_radius_m / cell_m
    room = _room(grid.rows, grid.cols, stride, radius)
    found = room.found
    if not _next_errand(
        row,
        col,
        errand is not None,
        goal_row,
        goal_col,
        (grid.north_m - others_y_m) / cell_m - 0.5,
        (others_x_m - grid.west_m) / cell_m - 0.5,
        fire,
        augmentation,
        monitored,
        area,
        WORTH + patience * (WORTH_LATER - WORTH),
        WAY_PER_M * cell_m,
        math.ceil(MARGIN_M / cell_m),
        radius,
        math.ceil(settings.monitoring_m / cell_m) + 1,
        math.ceil(settings.agent_area_m / cell_m) + 1,
        settings.spacing_m / cell_m,
        CROWD_M / cell_m,
        stride,
        room.half_widths,
        room.sums,
        room.ways,
        room.before,
        room.queue,
        room.queued,
        found,
    ):
        return None
    goal_x_m, goal_y_m = grid.xy_of(*found[:2].tolist())
    if errand is None or math.hypot(goal_x_m - errand.goal_x_m, goal_y_m - errand.goal_y_m) > 1e-6:
        since_s = at_s
    return Errand(goal_x_m, goal_y_m, *grid.xy_of(*found[2:].tolist()), since_s)


def velocity(
    x_m: float, y_m: float, errand: Errand, most_m_s: float, step_s: float
) -> tuple[float, float]:
    """East and north in m/s with which the agent goes on for a step; it stops where it must."""
    east, north = errand.via_x_m - x_m, errand.via_y_m - y_m
    way_m = math.hypot(east, north)
    if way_m < ARRIVED_M or step_s <= 0.0:
        return 0.0, 0.0
    speed_m_s = min(most_m_s, way_m / step_s)
    return east / way_m * speed_m_s, north / way_m * speed_m_s


class Mover:
    """Moves one virtual agent: by this rule within its area, by the paper's forces up to there.

    With ``placement`` "forces" of the settings it moves by the paper's forces alone.
    """

    def __init__(self, settings: Settings, grid: Grid, tie_rad: float) -> None:
        self.settings, self.grid = settings, grid
        self.errand: Errand | None = None
        self._constants = as_array(settings.constants)
        self._tie_rad = tie_rad
        self._due_s: float | None = None
        self._others_m: Floats = np.empty((0, 2))  # when it decided last

    @property
    def goal_m(self) -> tuple[float, float] | None:
        """Where it is going, for the others to know; None while forces move it."""
        errand = self.errand
        return None if errand is None else (errand.goal_x_m, errand.goal_y_m)

    def velocity(
        self,
        at_s: float,
        x_m: float,
        y_m: float,
        others_x_m: Floats,
        others_y_m: Floats,
        maps: AgentMaps,
        step_s: float,
    ) -> tuple[float, float]:
        """East and north in m/s for the next ``step_s``; times only rise. No fire, no move.

        ``others_*`` (n): where the other virtual agents in range are or go, nan for one not there.
        """
        settings, grid = self.settings, self.grid
        centre = maps.centre_row_col
        if centre is None:
            return 0.0, 0.0
        if self._due_s is None:  # not all at once
            self._due_s = at_s + DECIDE_EVERY_S * self._tie_rad / (2.0 * math.pi)
        if settings.placement == "coverage" and (
            at_s >= self._due_s or (self.errand and self._is_at_via(x_m, y_m, self.errand))
        ):
            # Its own moments stay its own, so that no two decide together again and again.
            if at_s >= self._due_s:
                self._due_s += DECIDE_EVERY_S * (1.0 + (at_s - self._due_s) // DECIDE_EVERY_S)
            others_m = np.stack([others_x_m, others_y_m], axis=1)
            self._decide(at_s, x_m, y_m, others_m[np.isfinite(others_x_m)], maps)
        if self.errand is not None:
            return velocity(x_m, y_m, self.errand, settings.agent_speed_m_s, step_s)
        east_m_s, north_m_s = velocity_of_forces(
            x_m,
            y_m,
            others_x_m,
            others_y_m,
            *grid.xy_of(*centre),
            maps.augmentation,
            maps.area,
            grid.west_m,
            grid.north_m,
            grid.cell_m,
            self._constants,
            settings.spacing_m,
            settings.agent_speed_m_s,
            self._tie_rad,
        )
        return float(east_m_s), float(north_m_s)

    def _decide(
        self, at_s: float, x_m: float, y_m: float, others_m: Floats, maps: AgentMaps
    ) -> None:
        """A new errand. Who stands still does not give way to others that are only passing."""
        before_m, self._others_m = self._others_m, others_m
        errand = self._next(at_s, x_m, y_m, others_m, maps)
        if self.errand and errand and errand.since_s == at_s and self._is_at(x_m, y_m, self.errand):
            away_m = np.hypot(*(others_m[:, None] - before_m).T)  # (before, now)
            still_m = others_m[(away_m < STILL_M).any(axis=0)]
            alone = self._next(at_s, x_m, y_m, still_m, maps)
            errand = errand if alone is None or alone.since_s == at_s else self.errand
        self.errand = errand

    def _next(
        self, at_s: float, x_m: float, y_m: float, others_m: Floats, maps: AgentMaps
    ) -> Errand | None:
        return next_errand(
            at_s,
            x_m,
            y_m,
            self.errand,
            others_m[:, 0].copy(),
            others_m[:, 1].copy(),
            maps.fire,
            maps.augmentation,
            maps.monitored,
            maps.area,
            self.grid,
            self.settings,
        )

    def _is_at(self, x_m: float, y_m: float, errand: Errand) -> bool:
        return math.dist((x_m, y_m), (errand.goal_x_m, errand.goal_y_m)) < ARRIVED_M

    def _is_at_via(self, x_m: float, y_m: float, errand: Errand) -> bool:
        """At a corner of its way, before the goal."""
        at_via = math.dist((x_m, y_m), (errand.via_x_m, errand.via_y_m)) < ARRIVED_M
        return at_via and not self._is_at(x_m, y_m, errand)


@kernel
def _next_errand(  # type: ignore[no-untyped-def]
    row,
    col,
    has_goal,
    goal_row,
    goal_col,
    others_row,
    others_col,
    fire,
    augmentation,
    monitored,
    area,
    worth,
    way_cost,
    margin,
    radius,
    monitored_reach,
    area_reach,
    spacing,
    crowd_at,
    stride,
    half_widths,
    sums,
    ways,
    before,
    queue,
    queued,
    found,
):
    """``next_errand`` in cells; ``found`` (4) is the goal and the via. False for None."""
    if not has_goal and area[math.floor(row + 0.5), math.floor(col + 0.5)] == 0:
        return False
    burning = extent(fire)
    box = wider(burning, monitored_reach, fire.shape)
    sum_left_over(fire, augmentation, monitored, others_row, others_col, radius, box, sums)
    scene = (
        augmentation,
        margin,
        half_widths,
        box,
        sums,
        others_row,
        others_col,
        spacing,
        crowd_at,
    )
    # What there is already: the goal, unless the fire has come; and what is near it.
    found[0], found[1] = goal_row, goal_col
    r, c = math.floor(goal_row + 0.5), math.floor(goal_col + 0.5)
    least, best = -math.inf, -math.inf
    if is_free(r, c, augmentation, 0):
        least = worth + value(r, c, scene) - way_cost * math.hypot(r - row, c - col)
        near_row, near_col = climb(r, c, stride, area, scene)
        way = math.hypot(near_row - row, near_col - col)
        best = value(near_row, near_col, scene) - way_cost * way
        if best > least:
            found[0], found[1] = near_row, near_col
    # What there is elsewhere: on the lattice, and from there uphill.
    field = wider(burning, area_reach, fire.shape)
    on_lattice, node_row, node_col = -math.inf, -1, -1
    for r in range((field[0] + stride - 1) // stride * stride, field[1], stride):
        for c in range((field[2] + stride - 1) // stride * stride, field[3], stride):
            if area[r, c] != 0 and augmentation[r, c] == 0:
                new = value(r, c, scene) - way_cost * math.hypot(r - row, c - col)
                if new > on_lattice:
                    on_lattice, node_row, node_col = new, r, c
    if node_row >= 0:
        r, c = climb(node_row, node_col, stride, area, scene)
        new = value(r, c, scene) - way_cost * math.hypot(r - row, c - col)
        if new > max(best, least):
            found[0], found[1] = r, c
    elif least == -math.inf:
        return False
    found[2], found[3] = found[0], found[1]
    if is_clear(row, col, found[0], found[1], augmentation):
        return True
    if not find_ways(row, col, augmentation, field, stride, ways, before, queue, queued):
        return False
    return first_leg(row, col, augmentation, field, stride, ways, before, found)


@kernel
def value(row, col, scene):  # type: ignore[no-untyped-def]
    """What a free cell is worth to an agent."""
    augmentation, margin, half_widths, box, sums, others_row, others_col, spacing, crowd_at = scene
    gain = weight_within(row, col, half_widths, box, sums) - crowding(
        row, col, others_row, others_col, spacing, NEIGHBOUR, crowd_at, CROWD
    )
    return gain if is_free(row, col, augmentation, margin) else gain - TOUCHING


@kernel
def climb(row, col, step, area, scene):  # type: ignore[no-untyped-def]
    """The best place near a cell, in the area: uphill with smaller and smaller steps."""
    augmentation = scene[0]
    best = value(row, col, scene)
    while step > 1:
        step = (step + 1) // 2
        gained = True
        while gained:
            gained = False
            for side in range(9):
                r, c = row + step * (side // 3 - 1), col + step * (side % 3 - 1)
                if is_free(r, c, augmentation, 0) and area[r, c] != 0:
                    new = value(r, c, scene)
                    if new > best + 1e-9:
                        best, next_row, next_col, gained = new, r, c, True
            if gained:
                row, col = next_row, next_col
    return row, col
