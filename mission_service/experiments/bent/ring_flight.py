"""Simulate the ideal flight of a team along the front of a growing fire, as Bent does.

The front is a ring of cells. Each vehicle flies from cell to cell at its speed, turns on the spot
and observes its current cell. At each cell that a vehicle reaches, the rule makes one decision.
When the ring grows, cells, vehicles and regions are moved to the new ring.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from mission_service.experiments.bent.ring_history import RingStep
from mission_service.experiments.fires import CELL_M
from mission_service.guidance.team.front_ring import ActiveFleet, FrontRing, TeamRule

Floats = NDArray[np.float64]

LAYER_M = 30.0


@dataclass(frozen=True)
class TeamFlight:
    """The results of a flight; costs are evaluated at each step of the ring.

    The cost is defined as in Bent's thesis (3.3): the mean importance (3.2) of all cells, with
    spread rates in m/s.
    """

    at_s: Floats
    linear: Floats  # cost by spread rate * age, m
    exponential: Floats  # cost by age ** (1 + spread rate)
    worst_linear: Floats  # highest linear importance of a cell, m
    tracks: dict[int, Floats]  # tracks by member: (n, 3) time in s, row, column
    decisions: int
    min_separation_m: float  # smallest distance between two vehicles, in separate layers

    def mean_std(self, importance: str) -> tuple[float, float]:
        """Return the mean and the standard deviation over time of one of the two costs."""
        cost = self.exponential if importance == "exponential" else self.linear
        return float(cost.mean()), float(cost.std())


def linear_importance(spread_rate_m_s: Floats, age_s: Floats) -> Floats:
    """Return Bent's linear importance (3.2): metres that the front may have advanced unseen."""
    return spread_rate_m_s * age_s


def exponential_importance(spread_rate_m_s: Floats, age_s: Floats) -> Floats:
    """Return Bent's exponential importance (3.2), with the spread rate in m/s in the exponent.

    The tables of the thesis fit no other unit. The linear cost of 64 in the thesis is near the
    importance at an age of 5 minutes and 0.2 m/s (300 * 0.2 = 60). The exponential cost of 3,000 is
    explained by fast parts of the front with 0.5 m/s (300 ** 1.5 = 5,200). If rates were in m/min,
    a linear cost of 64 would mean ages of 5 s, and the exponential cost would be 5 ** 13 = 10 ** 9.
    """
    importance: Floats = age_s ** (1.0 + spread_rate_m_s)
    return importance


def equidistant(step_m: Floats, count: int) -> NDArray[np.int64]:
    """Return ``count`` cells, beginning with cell 0, that divide a ring into parts of equal length.

    ``step_m`` (n) is the distance from each cell to the next one.
    """
    along_m = np.concatenate([[0.0], np.cumsum(step_m)])
    goal_m = along_m[-1] * np.arange(count) / count
    after = np.searchsorted(along_m, goal_m)
    nearer_before = goal_m - along_m[after - 1] < along_m[after] - goal_m
    cells: NDArray[np.int64] = np.where((after > 0) & nearer_before, after - 1, after)
    return cells % step_m.size


@dataclass
class _Vehicle:
    """A vehicle that is flying from a position (row, col) to a cell of the ring."""

    member: int
    speed_m_s: float
    goal: int
    goal_place: tuple[float, float]
    left: tuple[float, float, float]  # time, row and column at which the vehicle left the last cell
    arrival_s: float
    track: list[tuple[float, float, float]]


def fly_team(
    history: Sequence[RingStep],
    rule: TeamRule,
    uavs: int,
    speed_m_s: float,
    *,
    cell_m: float = CELL_M,
    leaving: Sequence[tuple[float, int]] = (),
    joining: Sequence[tuple[float, int]] = (),
    turn_s: float = 0.0,
) -> TeamFlight:
    """Fly ``uavs`` vehicles along a growing ring whose cells have all been visited at the start.

    The vehicles start equally spaced, as members 0, 1, 2 ... clockwise. ``leaving`` and ``joining``
    contain (time in s, member). Each change takes effect at the first step of the ring at or after
    its time. A vehicle joins at the cell with the oldest visit. ``rule.decide`` receives the same
    ``FrontRing`` during a step and the same ``ActiveFleet`` until the team changes. The rule must
    copy arrays that it stores, because they are modified in place. A reversal takes ``turn_s``.
    """
    team = _Team(rule, speed_m_s, cell_m, turn_s)
    first = history[0]
    team.on(first, np.full(len(first.cells), first.at_s))
    for member, cell in enumerate(equidistant(first.step_m, uavs)):
        team.join(member, int(cell))
    samples = []
    for index, step in enumerate(history):
        if index:
            team.grow(step)
        for at_s, member in leaving:
            if _due(at_s, history, index):
                team.leave(member)
        for at_s, member in joining:
            if _due(at_s, history, index):
                team.join(member, int(np.argmin(team.ring.visited_at_s)))
        samples.append((step.at_s, *_costs(team.ring, step.at_s)))
        if index + 1 < len(history):
            team.fly_until(history[index + 1].at_s)
    at, linear, exponential, worst = np.array(samples).T
    tracks = {member: np.array(track) for member, track in sorted(team.tracks.items())}
    closest_m = min_separation_m(tracks, cell_m, LAYER_M)
    return TeamFlight(at, linear, exponential, worst, tracks, team.decisions, closest_m)


def _due(at_s: float, history: Sequence[RingStep], index: int) -> bool:
    before_s = history[index - 1].at_s if index else -np.inf
    return before_s < at_s <= history[index].at_s


def _costs(ring: FrontRing, at_s: float) -> tuple[float, float, float]:
    age_s = at_s - ring.visited_at_s
    linear = linear_importance(ring.spread_rate_m_s, age_s)
    exponential = exponential_importance(ring.spread_rate_m_s, age_s)
    return float(linear.mean()), float(exponential.mean()), float(linear.max())


class _Team:
    """The vehicles in the air, and the ring on which they fly."""

    def __init__(self, rule: TeamRule, speed_m_s: float, cell_m: float, turn_s: float) -> None:
        self.ring: FrontRing
        self.tracks: dict[int, list[tuple[float, float, float]]] = {}
        self.decisions = 0
        self._rule = rule
        self._speed_m_s = speed_m_s
        self._cell_m = cell_m
        self._turn_s = turn_s
        self._vehicles: list[_Vehicle] = []
        self._fleet = ActiveFleet(*(np.array([], kind) for kind in (int, int, bool, float)))

    def on(self, step: RingStep, visited_at_s: Floats) -> None:
        """Replace the ring."""
        self._at_s = step.at_s
        self.ring = FrontRing(step.step_m, step.spread_rate_m_s, visited_at_s)
        # Lists are used, because access to single array elements is slow.
        self._places = [(float(row), float(col)) for row, col in step.cells.tolist()]
        self._step_m: list[float] = step.step_m.tolist()

    def grow(self, step: RingStep) -> None:
        """Replace the ring with the next one, whose cells inherit visits; move all goals to it."""
        self.on(step, self.ring.visited_at_s[step.came_from])
        self._fleet.cell[:] = step.place_of[self._fleet.cell]
        for vehicle in self._vehicles:
            vehicle.left = _underway(vehicle, step.at_s)
            vehicle.track.append(vehicle.left)
            vehicle.goal = int(step.place_of[vehicle.goal])
            vehicle.goal_place = self._places[vehicle.goal]
            away = math.dist(vehicle.left[1:], vehicle.goal_place)
            vehicle.arrival_s = vehicle.left[0] + away * self._cell_m / vehicle.speed_m_s
        self._rule.on_ring_changed(step.place_of)

    def join(self, member: int, cell: int) -> None:
        """Add a vehicle at a cell; its first decision is made at this cell."""
        at = (self._at_s, *self._places[cell])
        track = self.tracks.setdefault(member, [])
        joined = _Vehicle(member, self._speed_m_s, cell, at[1:], at, self._at_s, track)
        self._set_vehicles([*self._vehicles, joined])

    def leave(self, member: int) -> None:
        """Remove a vehicle."""
        self._set_vehicles([vehicle for vehicle in self._vehicles if vehicle.member != member])

    def _set_vehicles(self, vehicles: list[_Vehicle]) -> None:
        members = self._fleet.member.tolist()
        heading = dict(zip(members, self._fleet.clockwise.tolist(), strict=True))
        cells = dict(zip(members, self._fleet.cell.tolist(), strict=True))
        self._vehicles = sorted(vehicles, key=lambda vehicle: vehicle.member)
        self._fleet = ActiveFleet(
            np.array([vehicle.member for vehicle in self._vehicles], np.int64),
            np.array([cells.get(v.member, v.goal) for v in self._vehicles], np.int64),
            np.array([heading.get(vehicle.member, True) for vehicle in self._vehicles], np.bool_),
            np.array([vehicle.speed_m_s for vehicle in self._vehicles]),
        )

    def fly_until(self, end_s: float) -> None:
        """Fly all vehicles from cell to cell until ``end_s``.

        If two vehicles arrive at the same time, the member with the lower number decides first.
        """
        arrivals_s = [vehicle.arrival_s for vehicle in self._vehicles]
        while arrivals_s:
            at_s = min(arrivals_s)
            if at_s >= end_s:
                return
            which = arrivals_s.index(at_s)
            self._arrive(which, at_s)
            arrivals_s[which] = self._vehicles[which].arrival_s

    def _arrive(self, which: int, at_s: float) -> None:
        vehicle, cell = self._vehicles[which], self._vehicles[which].goal
        vehicle.left = (at_s, *vehicle.goal_place)
        vehicle.track.append(vehicle.left)
        self._fleet.cell[which] = cell
        self.ring.visited_at_s[cell] = at_s
        clockwise = self._rule.decide(self.ring, self._fleet, which, at_s)
        if bool(self._fleet.clockwise[which]) != bool(clockwise):
            at_s += self._turn_s
            vehicle.left = (at_s, *vehicle.left[1:])
        self._fleet.clockwise[which] = clockwise
        self.decisions += 1
        # Index -1 selects the last cell, and the step from the last cell to the first.
        vehicle.goal = (cell + 1) % len(self._places) if clockwise else cell - 1
        away_m = self._step_m[cell if clockwise else cell - 1]
        vehicle.goal_place = self._places[vehicle.goal]
        vehicle.arrival_s = at_s + away_m / vehicle.speed_m_s


def _underway(vehicle: _Vehicle, at_s: float) -> tuple[float, float, float]:
    """Return the time, row and column of a vehicle between two cells, or at the end of its turn."""
    left_s, row, col = vehicle.left
    at_s = max(at_s, left_s)
    share = (at_s - left_s) / max(vehicle.arrival_s - left_s, 1e-9)
    to_row, to_col = vehicle.goal_place
    return at_s, row + share * (to_row - row), col + share * (to_col - col)


def min_separation_m(tracks: dict[int, Floats], cell_m: float, layer_m: float) -> float:
    """Return the minimum 3-D distance in m between any two vehicles; tracks are polylines.

    A track (n, 3) contains time, row and column. Each member flies in its own layer, and layers are
    ``layer_m`` apart. For a single vehicle, the result is infinity.
    """
    closest_m = math.inf
    for (member, one), (other_member, other) in combinations(tracks.items(), 2):
        begin_s, end_s = max(one[0, 0], other[0, 0]), min(one[-1, 0], other[-1, 0])
        times = np.union1d(one[:, 0], other[:, 0])
        times = times[(times >= begin_s) & (times <= end_s)]
        if times.size < 2:
            continue
        apart = [
            np.interp(times, one[:, 0], one[:, axis])
            - np.interp(times, other[:, 0], other[:, axis])
            for axis in (1, 2)
        ]
        across_m = cell_m * float(_closest_to_origin(np.column_stack(apart)))
        closest_m = min(closest_m, math.hypot(across_m, layer_m * (member - other_member)))
    return closest_m


def _closest_to_origin(points: Floats) -> float:
    """Return the minimum distance from (0, 0) to a polyline through points (n, 2)."""
    start, along = points[:-1], np.diff(points, axis=0)
    squared = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(-(start * along).sum(axis=1) / squared, 0.0, 1.0)
    nearest = start + share[:, None] * along
    return float(np.sqrt((nearest**2).sum(axis=1).min()))
