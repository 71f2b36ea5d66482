"""The team rule ``team.balanced``, which searches for plans with the lowest mean cost.

The cost of a plan is the importance of all cells, averaged over time. The rule performs two
searches. The first search computes the costs of the long-term patterns of ``patterns`` from the
rates of spread: all vehicles lap, all lap and return on a fast arc, or some sweep the arc. The
second search (``lookahead``) simulates the next turns of each vehicle, so that the team reaches the
cheapest pattern with even gaps and visits the cells that have not been seen for a long time.

Each decision tries only a few plans, and keeps the current pattern and plan unless another pattern
or plan is better by a margin. On a ring that grows fast, all vehicles lap, and only the second
search remains, with a shorter simulation (because the fire soon changes) and more plans.
"""

from typing import Literal

import numpy as np

from mission_service.config.scenario import Scenario
from mission_service.guidance.front.planners import turn_back_s
from mission_service.guidance.team.front_ring import ActiveFleet, FrontRing
from mission_service.guidance.team.lookahead import (
    LEGS,
    NEVER,
    Floats,
    Horizon,
    Integers,
    Nodes,
    StartState,
    improve,
    moves_of,
    workspace_for,
)
from mission_service.guidance.team.patterns import (
    LAPS,
    Choice,
    PlanState,
    after_turn,
    best_pattern,
    even_delays,
    on_new_ring,
    plan_on_arc,
    settled_cost,
)

NODES = 256  # maximum number of nodes of the ring for roll-outs
BACKS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)  # cells to fly back before the next turn
SHIFTS = (-8, -4, -2, -1, 1, 2, 4, 8)  # cells by which a turn is delayed
# The same for a fast-growing ring, and the cells to fly onward before a turn back.
FAR_ONWARD = (0, 1, 2, 4, 6, 8, 12, 16, 24, 32, 48, 64)
FAR_BACKS = (*BACKS, 48, 64, 96, NEVER)
FAR_SHIFTS = (-32, -16, *SHIFTS, 16, 32)
# Length of the first part of a roll-out (in laps, or in periods of a pattern with an arc), and the
# additional weight of the lap or period that follows. A larger weight equalises gaps sooner, but
# too large a weight defers every gain.
AHEAD_LAPS, LATE_TIMES = 0.5, 3.0
AHEAD_ON_ARCS, LATE_ON_ARCS = 1.0, 1.0
# If the ring grows by more than the fraction ``MAX_GROWTH`` during one lap, even gaps would not
# last. All vehicles then lap, a roll-out has a single part as long as a few gaps between two
# vehicles, and every decision tries more plans. This ends when the growth is below ``MIN_GROWTH``.
MAX_GROWTH, MIN_GROWTH, GAPS_AHEAD = 0.15, 0.1, 3.0
# Fraction of the cost that another plan must save, in laps and on an arc.
MARGIN, MARGIN_ON_ARCS = 4e-3, 1e-3
# Fraction of the cost with even spacing that another pattern must save.
PATTERN_MARGIN = 0.03
# Number of searches in one lap, and the minimum time between two searches.
PATTERN_SEARCHES, PLAN_SEARCHES = 8, 60  # for a better pattern, for a better plan of a vehicle
SEARCH_S = 2.0

Importance = Literal["linear", "exponential"]


class Balanced:
    """The balanced ``TeamRule``, for any number of vehicles; vehicles may join and leave."""

    def __init__(self, importance: Importance = "linear", turn_s: float = 0.0) -> None:
        """Set the importance function and ``turn_s``, the duration of a turn back."""
        self._turn_s = turn_s
        self._linear = importance == "linear"
        self._moves = moves_of((0,), BACKS, SHIFTS)
        self._far_moves = moves_of(FAR_ONWARD, FAR_BACKS, FAR_SHIFTS)
        self._ring: FrontRing | None = None
        self._pattern = LAPS
        self._next_pattern_s = -np.inf
        self._grows_fast = False
        self._first: tuple[float, float] | None = None  # first length of the ring in m, and time
        self.rollouts = 0
        self.turns = 0
        # For each vehicle (k): the member number, the cells to fly before each turn, the next cell,
        # the time of arrival there, the direction, the time of the last search, whether the vehicle
        # sweeps, and the number of returns on the arc in this lap.
        self._members: list[int] = []
        self._legs = np.empty((0, LEGS), np.int64)
        self._goal = np.empty(0, np.int64)
        self._due_s = np.empty(0)
        self._heading = np.empty(0, np.int64)
        self._searched_s = np.empty(0)
        self._sweeps = np.empty(0, np.bool_)
        self._returned = np.empty(0, np.int64)

    def decide(self, ring: FrontRing, fleet: ActiveFleet, which: int, at_s: float) -> bool:
        """Search this vehicle's plans; return whether the vehicle flies clockwise next."""
        if ring is not self._ring:
            self._update_ring(ring, fleet)
        members: list[int] = fleet.member.tolist()
        if members != self._members:
            self._set_team(members, fleet, at_s)
        if at_s >= self._next_pattern_s:
            self._next_pattern_s = at_s + max(SEARCH_S, self._lap_s / PATTERN_SEARCHES)
            if self._lap_s > 0.0:
                self._choose_pattern(fleet, at_s)
            else:
                self._lap()
        self._goal[which], self._due_s[which] = fleet.cell[which], at_s
        every_s = 0.0 if self._grows_fast else self._lap_s / PLAN_SEARCHES
        if at_s >= self._searched_s[which] + max(SEARCH_S, every_s):
            self._searched_s[which] = at_s
            self._improve(fleet, which, at_s)
        return self._advance(which, ring, fleet, at_s)

    def on_ring_changed(self, place_of: Integers) -> None:
        """Move the cells of planned turns to the new ring."""
        size, old = int(place_of.max()) + 1, place_of.size
        self._ring = None
        onward = np.concatenate([[0], np.cumsum(np.diff(place_of) % size)]) + place_of[0]
        self._pattern = on_new_ring(self._pattern, onward, size)
        for vehicle, heading in enumerate(self._heading.tolist()):
            place = int(self._goal[vehicle])
            before = int(onward[place])
            self._goal[vehicle] = before % size
            for leg, length in enumerate(self._legs[vehicle].tolist()):
                if length >= NEVER:
                    break
                place += heading * length
                after = int(onward[place % old]) + size * (place // old)
                self._legs[vehicle, leg] = abs(after - before)
                before, heading = after, -heading

    @property
    def nodes(self) -> int:
        """The number of nodes of the ring in roll-outs."""
        return int(self._step_m.size)

    def _update_ring(self, ring: FrontRing, fleet: ActiveFleet) -> None:
        """Compute the values that stay the same for all decisions on one ring."""
        self._ring = ring
        size = ring.step_m.size
        self._stride = -(-size // NODES)
        self._edges = np.arange(0, size, self._stride)
        self._counts = np.diff(np.append(self._edges, size))
        self._step_m = np.add.reduceat(ring.step_m, self._edges)
        rates = np.add.reduceat(ring.spread_rate_m_s, self._edges)
        self._room = workspace_for(self._step_m.size, fleet.member.size)
        self._lap_s = float(ring.step_m.sum() / fleet.speed_m_s.mean())
        scale, power = self._integral(rates, self._counts)
        unseen = np.zeros(self._step_m.size)
        self._nodes = Nodes(self._step_m, scale, power, self._linear, unseen, self._stride)
        # A pattern on nodes of several cells would begin and end up to one node away from the arc.
        scale, power = self._integral(ring.spread_rate_m_s, np.ones(size))
        self._cells = Nodes(np.array(ring.step_m), scale, power, self._linear, np.zeros(size), 1)

    def _integral(self, rate_sum: Floats, cells: Floats | Integers) -> tuple[Floats, Floats]:
        """Return the scale and the power of each node's integral of importance.

        A node contains ``cells`` cells, and ``rate_sum`` is the sum of their spread rates.
        """
        if self._linear:
            return rate_sum / 2.0, np.full(rate_sum.size, 2.0)
        power = 2.0 + rate_sum / cells
        return cells / power, power

    def _growth(self, at_s: float) -> float:
        """Return the fraction by which the ring grows per lap, at the mean rate since the start."""
        length_m = float(self._step_m.sum())
        if self._first is None or self._first[0] <= 0.0:  # a front of a single cell has no length
            self._first = length_m, at_s
        first_m, first_s = self._first
        if at_s <= first_s or length_m <= 0.0:
            return 0.0
        return float(np.log(length_m / first_m)) * self._lap_s / (at_s - first_s)

    def _choose_pattern(self, fleet: ActiveFleet, at_s: float) -> None:
        """Replace the pattern and all plans if another pattern is better by a margin."""
        team = fleet.member.size, float(fleet.speed_m_s.mean()), self._turn_s
        cost = settled_cost(self._pattern, self._cells, *team)
        best = best_pattern(self._cells, *team)
        lapping = settled_cost(LAPS, self._cells, *team)
        growth = self._growth(at_s)
        self._grows_fast = growth > (MIN_GROWTH if self._grows_fast else MAX_GROWTH)
        if self._grows_fast or best.cost > (1.0 - PATTERN_MARGIN) * lapping:
            best = Choice(LAPS, lapping)
        wanted = best.pattern
        if wanted.length and wanted.kind == self._pattern.kind:
            # The arc follows the front: a vehicle uses the new arc from its next turn onwards.
            self._pattern = wanted
        elif wanted != self._pattern and (
            self._grows_fast or best.cost < (1.0 - PATTERN_MARGIN) * cost
        ):
            self._pattern = wanted
            self._plan_all()

    def _lap(self) -> None:
        """Let all vehicles lap: on a front within one cell, costs are not defined."""
        self._grows_fast = False
        if self._pattern != LAPS:
            self._pattern = LAPS
            self._plan_all()

    def _plan_all(self) -> None:
        """Set the plan of each vehicle to the pattern, starting at the vehicle's next cell."""
        size = self._size()
        middle = self._pattern.first + self._pattern.length // 2
        away = (self._goal - middle) % size
        nearest = np.argsort(np.minimum(away, size - away), kind="stable")
        self._sweeps = np.zeros(len(self._members), np.bool_)
        self._sweeps[nearest[: self._pattern.sweeping]] = True
        self._returned[:] = 0
        for vehicle in range(len(self._members)):
            self._plan(vehicle)
        if self._pattern.length:
            self._space_on_arc()

    def _space_on_arc(self) -> None:
        """Delay the vehicles that serve the arc on their first visit, so that gaps become even.

        A delay consists of whole returns on the arc, and of one flight beyond the end of the arc
        and back.
        """
        length, returns = self._pattern.length, self._pattern.returns
        serving = np.flatnonzero([self._serves(v) for v in range(len(self._members))])
        turns = np.where(self._heading[serving] > 0, 0, 1)
        ends = self._legs[serving, 0] + turns * self._legs[serving, 1]
        period = 2 * length * max(returns, 1) + (self._size() if returns else 0)
        whole, part = np.divmod(even_delays(ends, period), 2 * length)
        for place, vehicle in enumerate(serving.tolist()):
            self._returned[vehicle] -= whole[place]
            self._plan(vehicle)
            turn = turns[place]
            self._legs[vehicle, turn : turn + 2] += part[place] // 2

    def _size(self) -> int:
        assert self._ring is not None
        return self._ring.step_m.size

    def _serves(self, vehicle: int) -> bool:
        """Return whether a vehicle flies back and forth on the arc of the pattern."""
        pattern = self._pattern
        return pattern.length > 0 and bool(self._sweeps[vehicle]) == (pattern.sweeping > 0)

    def _plan(self, vehicle: int) -> None:
        """Set the plan of one vehicle to the pattern, starting at the vehicle's next cell."""
        if not self._serves(vehicle):
            self._legs[vehicle] = NEVER
            if self._heading[vehicle] < 0:
                self._legs[vehicle, 0] = 0
            return
        state = PlanState(
            int(self._goal[vehicle]), int(self._heading[vehicle]), int(self._returned[vehicle])
        )
        self._legs[vehicle] = plan_on_arc(self._pattern, state, self._size())

    def _set_team(self, members: list[int], fleet: ActiveFleet, at_s: float) -> None:
        """Set the members after a vehicle has joined or left.

        All vehicles lap until a better pattern is found.
        """
        before = {member: place for place, member in enumerate(self._members)}
        old = (self._legs, self._goal, self._due_s, self._heading)
        self._returned = np.zeros(len(members), np.int64)
        self._members = members
        self._legs = np.full((len(members), LEGS), NEVER)
        self._goal = fleet.cell.copy()
        self._due_s = np.full(len(members), at_s)
        self._heading = np.where(fleet.clockwise, 1, -1)
        self._searched_s = np.full(len(members), -np.inf)
        for place, member in enumerate(members):
            if member in before:
                for now, then in zip(
                    (self._legs, self._goal, self._due_s, self._heading), old, strict=True
                ):
                    now[place] = then[before[member]]
        self._room = workspace_for(self._step_m.size, len(members))
        self._pattern, self._next_pattern_s = LAPS, -np.inf
        self._plan_all()

    def _improve(self, fleet: ActiveFleet, which: int, at_s: float) -> None:
        """Try other plans for one vehicle; keep the best plan."""
        assert self._ring is not None
        unreported = self._due_s < at_s - SEARCH_S
        if unreported.any():  # the positions of these vehicles are dead-reckoned
            self._goal[unreported] = fleet.cell[unreported]
            self._due_s[unreported] = at_s
            self._heading[unreported] = np.where(fleet.clockwise[unreported], 1, -1)
        visited_s = self._ring.visited_at_s - at_s
        if self._stride > 1:
            visited_s = np.add.reduceat(visited_s, self._edges) / self._counts
        nodes = self._nodes._replace(visited_s=visited_s)
        start = StartState(
            self._goal // self._stride,
            np.maximum(self._due_s - at_s, 0.0),
            self._heading,
            fleet.speed_m_s,
            self._turn_s,
        )
        span = self._horizon()
        moves, margin = self._far_moves if self._grows_fast else self._moves, MARGIN
        if self._serves(which):
            moves, margin = moves._replace(backs=moves.backs[:0]), MARGIN_ON_ARCS
        self.rollouts += improve(nodes, start, self._legs, span, self._room, which, moves, margin)

    def _horizon(self) -> Horizon:
        """Return the length of roll-outs for the current pattern and growth."""
        if self._grows_fast:
            end_s = GAPS_AHEAD * self._lap_s / len(self._members)
            return Horizon(end_s, end_s, 0.0)
        period_s, ahead, late_times = self._lap_s, AHEAD_LAPS, LATE_TIMES
        if self._pattern.length:
            ahead, late_times = AHEAD_ON_ARCS, LATE_ON_ARCS
        if self._pattern.sweeping == 0:
            share = self._pattern.length / self._size()
            period_s += 2.0 * self._pattern.returns * (share * self._lap_s + self._turn_s)
        return Horizon((1.0 + ahead) * period_s, ahead * period_s, late_times)

    def _advance(self, which: int, ring: FrontRing, fleet: ActiveFleet, at_s: float) -> bool:
        """Advance the plan by one cell, with a turn if one is due; return the direction."""
        legs, heading = self._legs[which], self._heading[which]
        while legs[0] == 0:
            self._heading[which] *= -1
            legs[:-1] = legs[1:].copy()
            legs[-1] = legs[-3]
            self.turns += 1
            if self._serves(which):
                turned = PlanState(0, -int(self._heading[which]), int(self._returned[which]))
                self._returned[which] = after_turn(self._pattern, turned).returned
                self._plan(which)
        if legs[0] < NEVER:
            legs[0] -= 1
        clockwise = bool(self._heading[which] > 0)
        cell, size = int(self._goal[which]), ring.step_m.size
        self._goal[which] = (cell + (1 if clockwise else -1)) % size
        step_m = ring.step_m[cell if clockwise else cell - 1]
        self._due_s[which] = at_s + step_m / fleet.speed_m_s[which]
        if self._heading[which] != heading:
            self._due_s[which] += self._turn_s
        return clockwise


def balanced(scenario: Scenario) -> Balanced:
    """Return the balanced rule for a scenario's vehicles."""
    turns_s = [turn_back_s(section) for section in scenario.vehicles]
    return Balanced(scenario.planner.importance, sum(turns_s) / len(turns_s))
