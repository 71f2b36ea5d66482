"""The coverage rule: each virtual agent moves to the position where it adds most to the coverage.

This rule replaces the paper's forces. Each cell near fire has a weight: 5 inside the augmented fire
(priority 1 in the paper), and 1 within d_mon (priority 0.2). An agent covers the cells in a circle.
The gain of an agent at a position is the total weight of the cells in the circle that no other
agent covers. A move that increases the gain of one agent also increases the total weight covered by
all agents; therefore the agents eventually stop. In experiments, this total was then at most 3 %
below the total of the best placement (``experiments/virtual_agents/static_placement.py``). With the
paper's forces, agents stop where the forces cancel, between the fire's centre and a neighbour.

An agent compares all positions of a lattice in its area. The value of a position is the gain there,
minus the cost of the path to it around the augmented fire. An agent moves only if the gain
increases by at least ``WORTH``, or if fire reaches the agent's position. The agent therefore stays
in one position long enough for the orbit around it to become a loiter item. Among positions without
a gain, an agent prefers positions far from other agents.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mission_service.guidance.formation.agent_maps import AgentMaps
from mission_service.guidance.formation.coverage_kernels import find_goal
from mission_service.guidance.formation.map_grid import MapGrid
from mission_service.guidance.formation.settings import Settings
from mission_service.guidance.formation.virtual_forces_kernels import (
    constants_array,
    tie_rad,
    velocity_of_forces,
)

Floats = NDArray[np.float64]

# Minimum increase in gain for a move: at first (0.5 % of the coverage of four agents), and after
# LATER_S at a position.
WORTH, WORTH_LATER, LATER_S = 80.0, 10.0, 120.0
COST_PER_M = 0.03  # cost per metre of path
CROWD_M = 150.0  # agents closer than this have the additional cost ``coverage_kernels.CROWD``
LATTICE_M = 60.0
MARGIN_M = 10.0  # a position this close to the augmented fire has a cost, since the fire grows
ARRIVED_M = 0.5
STILL_M = 5.0  # an agent whose goal has moved farther since the last decision is in transit
DECIDE_EVERY_S = 2.0


@dataclass(frozen=True, slots=True)
class Goal:
    """The goal of a virtual agent, and the via point on the way to the goal.

    The via point is the end of the first straight leg of the path. ``since_s`` is the time at which
    the goal was chosen.
    """

    x_m: float
    y_m: float
    via_x_m: float
    via_y_m: float
    since_s: float


class _Workspace(NamedTuple):
    """The coverage circle and the kernels' work arrays, which all agents share."""

    half_widths: NDArray[np.int64]
    sums: NDArray[np.int32]  # (rows, cols + 1)
    distances: Floats
    previous: NDArray[np.int64]
    queue: NDArray[np.int64]
    queued: NDArray[np.bool_]
    found: Floats


@lru_cache(maxsize=4)
def _workspace(rows: int, cols: int, stride: int, radius: float) -> _Workspace:
    nodes = ((rows - 1) // stride + 1) * ((cols - 1) // stride + 1)
    down = np.arange(-math.floor(radius), math.floor(radius) + 1)
    return _Workspace(
        np.floor(np.sqrt(radius * radius - down * down)).astype(np.int64),
        np.zeros((rows, cols + 1), dtype=np.int32),
        np.zeros(nodes),
        np.zeros(nodes, dtype=np.int64),
        np.zeros(nodes, dtype=np.int64),
        np.zeros(nodes, dtype=np.bool_),
        np.zeros(4),
    )


def next_goal(
    at_s: float,
    x_m: float,
    y_m: float,
    goal: Goal | None,
    others_m: Floats,
    maps: AgentMaps,
    grid: MapGrid,
    settings: Settings,
) -> Goal | None:
    """Return the goal of the agent at (x, y); None if the paper's forces must move the agent.

    The result is None for an agent outside the map, or if no goal is found. ``goal`` is the
    previous result (None at first). ``others_m`` (n, 2) holds x and y of each other agent's goal,
    or of its position if it has no goal. ``AgentMover`` calls this function every few seconds.
    """
    cell_m = grid.cell_m
    row, col = grid.row_col_of(x_m, y_m)
    if not (-0.5 <= row < grid.rows - 0.5 and -0.5 <= col < grid.cols - 0.5):
        return None
    goal_row, goal_col = grid.row_col_of(goal.x_m, goal.y_m) if goal else (row, col)
    since_s = goal.since_s if goal else at_s
    patience = min(max(at_s - since_s, 0.0) / LATER_S, 1.0)
    stride = max(round(LATTICE_M / cell_m), 1)
    radius = settings.coverage_radius_m / cell_m
    workspace = _workspace(grid.rows, grid.cols, stride, radius)
    if not find_goal(
        *(row, col, goal_row, goal_col),
        (grid.north_m - others_m[:, 1]) / cell_m - 0.5,
        (others_m[:, 0] - grid.west_m) / cell_m - 0.5,
        *(maps.fire, maps.augmentation, maps.monitored, maps.area),
        WORTH + patience * (WORTH_LATER - WORTH),
        COST_PER_M * cell_m,
        math.ceil(MARGIN_M / cell_m),
        radius,
        math.ceil(settings.monitoring_m / cell_m) + 1,
        math.ceil(settings.agent_area_m / cell_m) + 1,
        settings.spacing_m / cell_m,
        CROWD_M / cell_m,
        stride,
        *workspace,
    ):
        return None
    goal_x_m, goal_y_m = grid.xy_of(*workspace.found[:2].tolist())
    if goal is None or math.hypot(goal_x_m - goal.x_m, goal_y_m - goal.y_m) > 1e-6:
        since_s = at_s
    return Goal(goal_x_m, goal_y_m, *grid.xy_of(*workspace.found[2:].tolist()), since_s)


def velocity(
    x_m: float, y_m: float, goal: Goal, max_m_s: float, step_s: float
) -> tuple[float, float]:
    """Return the agent's velocity (east, north) in m/s for one step towards the via point.

    The agent does not move past the via point.
    """
    east, north = goal.via_x_m - x_m, goal.via_y_m - y_m
    distance_m = math.hypot(east, north)
    if distance_m < ARRIVED_M or step_s <= 0.0:
        return 0.0, 0.0
    speed_m_s = min(max_m_s, distance_m / step_s)
    return east / distance_m * speed_m_s, north / distance_m * speed_m_s


class AgentMover:
    """The motion of one virtual agent, according to the coverage rule or the paper's forces.

    The coverage rule applies on the map, and the paper's forces apply outside the map. If
    ``placement`` in the settings is "forces", only the paper's forces apply.
    """

    def __init__(self, settings: Settings, grid: MapGrid, key: int) -> None:
        """Create the mover of an agent; ``key`` is its UAV's ``peer_table.priority_key``."""
        self.settings, self.grid = settings, grid
        self.goal: Goal | None = None
        self._constants = constants_array(settings.constants)
        self._key, self._tie_rad = key, tie_rad(key)
        self._due_s: float | None = None
        self._others_m: Floats = np.empty((0, 2))  # goals of the others at the last decision

    @property
    def goal_m(self) -> tuple[float, float] | None:
        """Return the goal to send to the other agents; None while forces move the agent."""
        goal = self.goal
        return None if goal is None else (goal.x_m, goal.y_m)

    def velocity(
        self,
        at_s: float,
        x_m: float,
        y_m: float,
        others: Floats,
        maps: AgentMaps,
        step_s: float,
    ) -> tuple[float, float]:
        """Return the velocity (east, north) in m/s for the next ``step_s``; 0 without fire.

        ``others`` (n, 3) holds the goals of the other virtual agents (``PeerTable.goals``).
        ``at_s`` must not decrease between calls.
        """
        settings, grid = self.settings, self.grid
        centre = maps.centre_row_col
        if centre is None:
            return 0.0, 0.0
        if self._due_s is None:  # with this offset, agents decide at different times
            self._due_s = at_s + DECIDE_EVERY_S * self._tie_rad / (2.0 * math.pi)
        if settings.placement == "coverage" and (
            at_s >= self._due_s or (self.goal and self._is_at_via(x_m, y_m, self.goal))
        ):
            # Due times keep their offset, so that two agents do not always decide at the same time.
            if at_s >= self._due_s:
                self._due_s += DECIDE_EVERY_S * (1.0 + (at_s - self._due_s) // DECIDE_EVERY_S)
            self._decide(at_s, x_m, y_m, self._without_rivals(others), maps)
        if self.goal is not None:
            return velocity(x_m, y_m, self.goal, settings.agent_speed_m_s, step_s)
        east_m_s, north_m_s = velocity_of_forces(
            *(x_m, y_m, *others[:, :2].T.copy(), *grid.xy_of(*centre)),
            *(maps.augmentation, maps.area, grid.west_m, grid.north_m, grid.cell_m),
            *(self._constants, settings.spacing_m, settings.agent_speed_m_s, self._tie_rad),
        )
        return float(east_m_s), float(north_m_s)

    def _without_rivals(self, others: Floats) -> Floats:
        """Return x and y (n, 2) of the goals to which this agent gives way.

        If several agents have chosen the same position at the same time, the agent with the lowest
        key keeps it.
        """
        if self.goal is None:
            return others[:, :2]
        away_m = np.hypot(others[:, 0] - self.goal.x_m, others[:, 1] - self.goal.y_m)
        return others[(away_m > LATTICE_M) | (others[:, 2] < self._key), :2]

    def _decide(
        self, at_s: float, x_m: float, y_m: float, others_m: Floats, maps: AgentMaps
    ) -> None:
        """Choose a goal; an agent that is at its goal does not give way to agents in transit."""
        before_m, self._others_m = self._others_m, others_m
        goal = self._next(at_s, x_m, y_m, others_m, maps)
        if self.goal and goal and goal.since_s == at_s and self._is_at(x_m, y_m, self.goal):
            # Distances between earlier (first axis) and current (second axis) goals of the others.
            away_m = np.hypot(*(others_m[:, None] - before_m).T)
            still_m = others_m[(away_m < STILL_M).any(axis=0)]
            without = self._next(at_s, x_m, y_m, still_m, maps)
            goal = goal if without is None or without.since_s == at_s else self.goal
        self.goal = goal

    def _next(
        self, at_s: float, x_m: float, y_m: float, others_m: Floats, maps: AgentMaps
    ) -> Goal | None:
        return next_goal(at_s, x_m, y_m, self.goal, others_m, maps, self.grid, self.settings)

    def _is_at(self, x_m: float, y_m: float, goal: Goal) -> bool:
        return math.dist((x_m, y_m), (goal.x_m, goal.y_m)) < ARRIVED_M

    def _is_at_via(self, x_m: float, y_m: float, goal: Goal) -> bool:
        """Return whether the agent is at the via point, but not yet at its goal."""
        at_via = math.dist((x_m, y_m), (goal.via_x_m, goal.via_y_m)) < ARRIVED_M
        return at_via and not self._is_at(x_m, y_m, goal)
