"""The long-term patterns of a team on a ring, and the costs of patterns with even spacing.

There are three kinds of patterns: all vehicles lap in single file; all vehicles lap, and fly back
and forth on an arc of fast spread in each lap; or some vehicles sweep the arc while the others lap.
If the spread is the same everywhere, laps are best: with the same number of passes, sweeps make the
mean age of a cell 4/3 times as high. A sweep reduces the cost only if the front spreads several
times as fast on the arc as elsewhere.
"""

from typing import NamedTuple

import numpy as np

from firemodel.compiled import kernel
from mission_service.guidance.team.lookahead import LEGS, Integers, Nodes

MAX_RETURNS = 4  # a plan of LEGS legs has room for two laps with this number of returns
ARC_SHARES = 2.0 ** np.arange(-7.5, -0.9, 0.5)  # lengths of the first arcs to try, in laps
STEPS = (8, 4, 2, 1)  # numbers of cells by which the ends of an arc are then moved


class Pattern(NamedTuple):
    """An arc of the ring, and how vehicles serve the arc; places are cells.

    The arc extends from ``first`` to ``first + length``, both inclusive. ``sweeping`` is the number
    of vehicles that sweep the arc. If no vehicle sweeps the arc, all vehicles fly back and forth on
    the arc ``returns`` times in each lap.
    """

    first: int
    length: int  # 0: no arc, all lap
    sweeping: int
    returns: int

    @property
    def kind(self) -> tuple[int, int]:
        """The numbers of sweeping vehicles and of returns."""
        return self.sweeping, self.returns


class Choice(NamedTuple):
    """A pattern, and the cost of the pattern with even spacing."""

    pattern: Pattern
    cost: float


LAPS = Pattern(0, 0, 0, 0)


@kernel
def _both(scale, power, gap_s, other_gap_s):  # type: ignore[no-untyped-def]
    """Return a node's importance, integrated over a gap between regular visits, with other visits.

    The other visits are ``other_gap_s`` apart and independent of the regular visits. The age
    exceeds t with the probability (1 - t / gap) (1 - t / other gap). The integral of this
    probability times the derivative of the importance has a closed form.
    """
    until_s = min(gap_s, other_gap_s)
    if until_s <= 0.0:
        return 0.0
    age = power - 1.0
    top = until_s if power == 2.0 else until_s**age
    inner = gap_s / age - (1.0 + gap_s / other_gap_s) * until_s / power
    inner += until_s * until_s / ((power + 1.0) * other_gap_s)
    return scale * power * age * top * inner


@kernel
def _alone(scale, power, gap_s):  # type: ignore[no-untyped-def]
    if gap_s <= 0.0:
        return 0.0
    return scale * gap_s * gap_s if power == 2.0 else scale * gap_s**power


@kernel
def _visit_s(visit, along_s, arc_s, turn_s):  # type: ignore[no-untyped-def]
    """Return the time of a visit in a lap with returns, measured from the arrival at the arc."""
    back = visit % 2
    return visit // 2 * 2.0 * (arc_s + turn_s) + (
        2.0 * arc_s + turn_s - along_s if back else along_s
    )


@kernel
def _next_gap_s(visit, returns, along_s, arc_s, turn_s, gap_s):  # type: ignore[no-untyped-def]
    """Return the time from one visit to the next by any vehicle; vehicles are ``gap_s`` apart."""
    at_s = _visit_s(visit, along_s, arc_s, turn_s)
    shortest_s = gap_s
    for other in range(2 * returns + 1):
        if other != visit:
            later_s = (_visit_s(other, along_s, arc_s, turn_s) - at_s) % gap_s
            if later_s < shortest_s and (later_s > 0.0 or other > visit):
                shortest_s = later_s
    return shortest_s


@kernel
def settled_cost(pattern, nodes, vehicles, speed_m_s, turn_s):  # type: ignore[no-untyped-def]
    """Return the mean over time of all nodes' importance, for a pattern with even spacing.

    Args:
        pattern: The pattern.
        nodes: The ring, with one node for each cell.
        vehicles: The number of vehicles.
        speed_m_s: The mean speed of the vehicles.
        turn_s: The duration of a turn back.
    """
    size = nodes.step_m.size
    arc_s = 0.0
    for place in range(pattern.first, pattern.first + pattern.length):
        arc_s += nodes.step_m[place % size] / speed_m_s
    pass_s = 2.0 * (arc_s + turn_s)  # there and back
    lap_s = nodes.step_m.sum() / speed_m_s
    if pattern.sweeping == 0:
        lap_s += pattern.returns * pass_s
    gap_s = lap_s / (vehicles - pattern.sweeping)
    total = 0.0
    for place in range(size):
        total += _alone(nodes.scale[place], nodes.power[place], gap_s) / gap_s
    if pattern.length == 0:
        return total
    along_s = 0.0
    for step in range(pattern.length + 1):
        place = (pattern.first + step) % size
        scale, power = nodes.scale[place], nodes.power[place]
        total -= _alone(scale, power, gap_s) / gap_s
        if pattern.sweeping > 0:
            turn_gap_s = pass_s / pattern.sweeping
            near_s = (turn_s + 2.0 * (arc_s - along_s)) % turn_gap_s
            there = _both(scale, power, near_s, gap_s)
            there += _both(scale, power, turn_gap_s - near_s, gap_s)
            total += there / turn_gap_s
        else:
            for visit in range(2 * pattern.returns + 1):
                next_s = _next_gap_s(visit, pattern.returns, along_s, arc_s, turn_s, gap_s)
                total += _alone(scale, power, next_s) / gap_s
        along_s += nodes.step_m[place] / speed_m_s
    return total


def best_pattern(nodes: Nodes, vehicles: int, speed_m_s: float, turn_s: float) -> Choice:
    """Return the pattern with an arc that has the lowest cost with even spacing.

    The search begins with the fastest arc of each length in ``ARC_SHARES``, for each kind of
    pattern, and then moves both ends of the best arc of each kind.
    """
    size = nodes.step_m.size
    rate = np.concatenate([[0.0], np.cumsum(np.tile(nodes.scale * nodes.power, 2))])
    arcs = []
    for length in sorted({max(1, round(size * share)) for share in ARC_SHARES.tolist()}):
        inside = rate[length + 1 : length + 1 + size] - rate[:size]
        arcs.append((int(np.argmax(inside)), length))
    kinds = [(sweeping, 0) for sweeping in range(1, vehicles)]
    kinds += [(0, returns) for returns in range(1, MAX_RETURNS + 1)]

    def choice(pattern: Pattern) -> Choice:
        return Choice(pattern, settled_cost(pattern, nodes, vehicles, speed_m_s, turn_s))

    found = []
    for kind in kinds:
        best = min((choice(Pattern(*arc, *kind)) for arc in arcs), key=lambda one: one.cost)
        for step in STEPS:
            best = _with_ends_moved(best, step, size, choice)
        found.append(best)
    return min(found, key=lambda one: one.cost)


def _with_ends_moved(best: Choice, step: int, size: int, choice):  # type: ignore[no-untyped-def]
    """Move the ends of an arc by ``step`` cells as long as the cost falls."""
    while True:
        first, length, *kind = best.pattern
        moved = [
            choice(Pattern((first + at) % size, length + longer, *kind))
            for at, longer in ((-step, step), (step, -step), (0, step), (0, -step))
            if 1 <= length + longer <= size // 2
        ]
        better = min(moved, key=lambda one: one.cost, default=best)
        if not better.cost < best.cost:  # also if a cost is NaN
            return best
        best = better


class PlanState(NamedTuple):
    """The next cell, heading and returns in this lap, for a vehicle that serves an arc."""

    cell: int
    heading: int  # 1: clockwise, -1: anticlockwise
    returned: int


def after_turn(pattern: Pattern, state: PlanState) -> PlanState:
    """Return the state after a turn back in ``state.cell``."""
    cell, heading, returned = state
    if heading < 0:
        return PlanState(cell, 1, returned + 1)
    return PlanState(cell, -1, 0 if returned >= pattern.returns else returned)


def plan_on_arc(pattern: Pattern, state: PlanState, size: int) -> Integers:
    """Return the legs (LEGS), in cells, of a vehicle that serves the arc of a pattern."""
    legs = np.empty(LEGS, np.int64)
    for leg in range(LEGS):
        cell, heading, returned = state
        if heading < 0:
            back = (cell - pattern.first) % size
            legs[leg] = back if back <= 2 * pattern.length else 0
        else:
            legs[leg] = (pattern.first + pattern.length - cell) % size
            if pattern.sweeping == 0 and returned >= pattern.returns:
                legs[leg] += size
        cell = (cell + heading * int(legs[leg])) % size
        state = after_turn(pattern, PlanState(cell, heading, returned))
    return legs


def even_delays(ends: Integers, period: int) -> Integers:
    """Return the delays that space vehicles evenly in the period of a pattern, all in cells.

    ``ends`` (k) is the number of cells that each vehicle flies before the turn at the end of the
    arc. The vehicles keep their order, and one vehicle is not delayed.
    """
    place = ends % period
    rank = np.argsort(np.argsort(place, kind="stable"), kind="stable")
    even = rank * period // ends.size
    delays: Integers = even - place - (even - place).min()
    return delays


def on_new_ring(pattern: Pattern, onward: Integers, size: int) -> Pattern:
    """Return the pattern after its cells have moved to a new ring of ``size`` cells.

    ``onward`` (n) holds the new place of each old cell, in ascending order around the ring.
    """
    first, length, *kind = pattern
    if not length:
        return pattern
    laps, last = divmod(first + length, onward.size)
    moved = int(onward[last]) + laps * size - int(onward[first])
    return Pattern(int(onward[first]) % size, max(moved, 1), *kind)
