"""A team that shares the front so that its mean cost is least (``team.balanced``).

Two questions, answered apart. How should the team share the ring for good: all lap, all lap and
pass a hot arc three times, or some sweep it (``patterns``)? And what does each vehicle do next, so
that the team gets there with even gaps and serves what has waited (``lookahead``)? Both are
answered by flying plans ahead; each decision tries a few and keeps what it has unless another is
better by a margin, so that it costs the same however long the search goes on.
"""

from typing import Literal

import numpy as np

from mission_service.config.scenario import Scenario
from mission_service.guidance.front.lookahead import (
    LEGS,
    NEVER,
    Floats,
    Integers,
    Moves,
    Nodes,
    Span,
    Start,
    improve,
    room_for,
)
from mission_service.guidance.front.patterns import LAPS, PARTS, Pattern, candidates, settled_cost
from mission_service.guidance.front.planners import turn_back_s
from mission_service.guidance.team.ring import Fleet, Ring

NODES = 256  # at most, of the ring as plans are flown ahead on it
BACKS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)  # cells to go back and come again
SHIFTS = (-8, -4, -2, -1, 1, 2, 4, 8)  # cells by which a turn is put off
# How far plans are flown ahead, in laps (periods, with an arc), and how often one lap more counts
# beside that: the more it counts, the sooner gaps are evened out, until plans promise later gains
# for ever and never bring them.
AHEAD_LAPS, LATE_TIMES = 0.5, 3.0
AHEAD_ON_ARCS, LATE_ON_ARCS = 1.0, 1.0
MARGIN = 1e-3  # of the cost: a plan is changed for no less
PATTERN_MARGIN = 0.03  # times (vehicles - 1)²: the more, the harder a growing front makes even gaps
SEARCH_S = 2.0  # a vehicle's plan is looked at again after so long

Importance = Literal["linear", "exponential"]


class Balanced:
    """A ``TeamRule``: any number of vehicles, which may come and go."""

    def __init__(self, importance: Importance = "linear", turn_s: float = 0.0) -> None:
        """``turn_s`` is what turning back costs a vehicle."""
        self._turn_s = turn_s
        self._linear = importance == "linear"
        self._moves = Moves(
            np.array(BACKS), np.array(SHIFTS), np.empty(LEGS, np.int64), np.empty(LEGS, np.int64)
        )
        self._ring: Ring | None = None
        self._pattern = LAPS
        self._pattern_cost = np.inf
        self._untried: list[Pattern] = []
        self._next_pattern_s = -np.inf
        self.flown_ahead = 0
        self.turns = 0
        # The vehicles (k): who; cells to go before each turn; the next cell, when due, which way.
        self._seats: list[int] = []
        self._legs = np.empty((0, LEGS), np.int64)
        self._goal = np.empty(0, np.int64)
        self._due_s = np.empty(0)
        self._heading = np.empty(0, np.int64)
        self._searched_s = np.empty(0)
        self._sweeps = np.empty(0, np.bool_)

    def decide(self, ring: Ring, fleet: Fleet, which: int, at_s: float) -> bool:
        """Clockwise from here? A few plans are tried for this vehicle, the others' given."""
        if ring is not self._ring:
            self._look(ring, fleet)
        seats: list[int] = fleet.seat.tolist()
        if seats != self._seats:
            self._team_is(seats, fleet, at_s)
        if at_s >= self._next_pattern_s:
            self._next_pattern_s = at_s + SEARCH_S
            self._try_patterns(fleet)
        self._goal[which], self._due_s[which] = fleet.cell[which], at_s
        if at_s >= self._searched_s[which] + SEARCH_S:
            self._searched_s[which] = at_s
            self._improve(fleet, which, at_s)
        return self._advance(which, ring, fleet, at_s)

    def regrown(self, place_of: Integers) -> None:
        """The cells where turns are planned have moved along with the front."""
        size, old = int(place_of.max()) + 1, place_of.size
        self._ring = None
        onward = np.concatenate([[0], np.cumsum(np.diff(place_of) % size)]) + place_of[0]
        for who, heading in enumerate(self._heading.tolist()):
            place = int(self._goal[who])
            before = int(onward[place])
            self._goal[who] = before % size
            for leg, length in enumerate(self._legs[who].tolist()):
                if length >= NEVER:
                    break
                place += heading * length
                after = int(onward[place % old]) + size * (place // old)
                self._legs[who, leg] = abs(after - before)
                before, heading = after, -heading

    @property
    def nodes(self) -> int:
        """How many the ring has on which plans are flown ahead."""
        return int(self._step_m.size)

    def expected(self, seat: int) -> int:
        """The cell to which a vehicle is thought to come next."""
        return int(self._goal[self._seats.index(seat)])

    def _look(self, ring: Ring, fleet: Fleet) -> None:
        """Everything about a ring that does not change from decision to decision."""
        self._ring = ring
        size = ring.step_m.size
        self._stride = -(-size // NODES)
        self._edges = np.arange(0, size, self._stride)
        self._counts = np.diff(np.append(self._edges, size))
        self._step_m = np.add.reduceat(ring.step_m, self._edges)
        rates = np.add.reduceat(ring.spread_rate_m_s, self._edges)
        self._scale, self._power = self._integral(rates, self._counts)
        self._room = room_for(self._step_m.size, fleet.seat.size)
        self._lap_s = float(ring.step_m.sum() / fleet.speed_m_s.mean())
        parts_m, rates = _in_parts(ring.step_m), _in_parts(ring.spread_rate_m_s)
        scale, power = self._integral(rates, np.full(PARTS, size / PARTS))
        self._parts = Nodes(parts_m, scale, power, self._linear, np.zeros(PARTS), 1)
        self._pattern_cost = self._settled(self._pattern, fleet)

    def _integral(self, rate_sum: Floats, cells: Floats | Integers) -> tuple[Floats, Floats]:
        """Scale and power of the integrals of importance of nodes of several cells."""
        if self._linear:
            return rate_sum / 2.0, np.full(rate_sum.size, 2.0)
        power = 2.0 + rate_sum / cells
        return cells / power, power

    def _settled(self, pattern: Pattern, fleet: Fleet) -> float:
        self.flown_ahead += 1
        return settled_cost(
            pattern, self._parts, fleet.speed_m_s, self._turn_s, room_for(PARTS, fleet.seat.size)
        )

    def _try_patterns(self, fleet: Fleet) -> None:
        """Try one more pattern; all vehicles are planned anew if it is better."""
        if not self._untried:
            self._untried = [LAPS, *candidates(fleet.seat.size)][::-1]
        pattern = self._untried.pop()
        cost = self._settled(pattern, fleet)
        margin = PATTERN_MARGIN * (fleet.seat.size - 1) ** 2
        if cost < (1.0 - margin) * self._pattern_cost:
            self._pattern, self._pattern_cost = pattern, cost
            self._plan_all()
        elif self._pattern.length:
            # The arc follows the front: vehicles take it over as they turn.
            first, length, sweeping = self._pattern
            for move, grow in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                pattern = Pattern((first + move) % PARTS, max(length + grow, 1), sweeping)
                cost = self._settled(pattern, fleet)
                if cost < self._pattern_cost:
                    self._pattern, self._pattern_cost = pattern, cost
            lapping = self._settled(LAPS, fleet)
            if lapping < self._pattern_cost:
                self._pattern, self._pattern_cost = LAPS, lapping
                self._plan_all()

    def _plan_all(self) -> None:
        """Every vehicle flies the pattern from its next cell on."""
        size = self._size()
        middle = (2 * self._pattern.first + self._pattern.length) * size // (2 * PARTS)
        away = (self._goal - middle) % size
        nearest = np.argsort(np.minimum(away, size - away), kind="stable")
        self._sweeps = np.zeros(len(self._seats), np.bool_)
        self._sweeps[nearest[: self._pattern.sweeping]] = True
        for who in range(len(self._seats)):
            self._plan(who)

    def _size(self) -> int:
        assert self._ring is not None
        return self._ring.step_m.size

    def _plan(self, who: int, came_back: bool = False) -> None:
        """This one flies the pattern from its next cell on; ``came_back``: its third pass."""
        size = self._size()
        first = self._pattern.first * size // PARTS
        length = self._pattern.length * size // PARTS
        sweeps = bool(self._sweeps[who])
        serves = length > 0 and sweeps == (self._pattern.sweeping > 0)
        legs = []
        place = int(self._goal[who])
        if self._heading[who] < 0:
            back = (place - first) % size
            turn = back if serves and back <= 2 * length else 0
            legs.append(turn)
            place -= turn
        pair = (NEVER, NEVER)
        if serves:
            onward = (first + length - place) % size
            legs.append(onward + size if came_back and not sweeps else onward)
            pair = (length, length if sweeps else size + length)
        while len(legs) < LEGS:
            legs.append(pair[0])
            pair = pair[::-1]
        self._legs[who] = legs

    def _team_is(self, seats: list[int], fleet: Fleet, at_s: float) -> None:
        """Somebody has come or gone: all lap until a better pattern is found."""
        before = {seat: place for place, seat in enumerate(self._seats)}
        old = (self._legs, self._goal, self._due_s, self._heading)
        self._seats = seats
        self._legs = np.full((len(seats), LEGS), NEVER)
        self._goal = fleet.cell.copy()
        self._due_s = np.full(len(seats), at_s)
        self._heading = np.where(fleet.clockwise, 1, -1)
        self._searched_s = np.full(len(seats), -np.inf)
        for place, seat in enumerate(seats):
            if seat in before:
                for now, then in zip(
                    (self._legs, self._goal, self._due_s, self._heading), old, strict=True
                ):
                    now[place] = then[before[seat]]
        self._room = room_for(self._step_m.size, len(seats))
        self._pattern, self._untried = LAPS, []
        self._pattern_cost = self._settled(LAPS, fleet)
        self._plan_all()

    def _improve(self, fleet: Fleet, which: int, at_s: float) -> None:
        """Try other plans for one vehicle."""
        assert self._ring is not None
        silent = self._due_s < at_s - SEARCH_S
        if silent.any():  # they are where the fleet reckons them
            self._goal[silent] = fleet.cell[silent]
            self._due_s[silent] = at_s
            self._heading[silent] = np.where(fleet.clockwise[silent], 1, -1)
        visited_s = self._ring.visited_at_s - at_s
        if self._stride > 1:
            visited_s = np.add.reduceat(visited_s, self._edges) / self._counts
        nodes = Nodes(self._step_m, self._scale, self._power, self._linear, visited_s, self._stride)
        start = Start(
            self._goal // self._stride,
            np.maximum(self._due_s - at_s, 0.0),
            self._heading,
            fleet.speed_m_s,
            self._turn_s,
        )
        period_s, ahead, late_times = self._lap_s, AHEAD_LAPS, LATE_TIMES
        if self._pattern.length:
            ahead, late_times = AHEAD_ON_ARCS, LATE_ON_ARCS
        if self._pattern.sweeping == 0:
            period_s *= 1.0 + 2.0 * self._pattern.length / PARTS
        span = Span((1.0 + ahead) * period_s, ahead * period_s, late_times)
        moves = self._moves
        if self._pattern.length:
            moves = moves._replace(backs=moves.backs[:0])
        self.flown_ahead += improve(
            nodes, start, self._legs, span, self._room, which, moves, MARGIN
        )

    def _advance(self, which: int, ring: Ring, fleet: Fleet, at_s: float) -> bool:
        """Turn if it is time to, and go on by one cell."""
        legs, heading = self._legs[which], self._heading[which]
        while legs[0] == 0:
            self._heading[which] *= -1
            legs[:-1] = legs[1:].copy()
            legs[-1] = legs[-3]
            self.turns += 1
            if self._pattern.length:
                self._plan(which, came_back=self._heading[which] > 0)
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


def _in_parts(of_cells: Floats) -> Floats:
    """Sums over PARTS equal parts of a ring (n)."""
    upto = np.concatenate([[0.0], np.cumsum(of_cells)])
    at = np.linspace(0.0, of_cells.size, PARTS + 1)
    parts: Floats = np.diff(np.interp(at, np.arange(upto.size), upto))
    return parts


def balanced(scenario: Scenario) -> Balanced:
    """The rule for the vehicles of a scenario."""
    turns_s = [turn_back_s(section) for section in scenario.vehicles]
    return Balanced(scenario.planner.importance, sum(turns_s) / len(turns_s))
