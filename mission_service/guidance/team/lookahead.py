"""Computes the cost of all vehicles' plans by roll-outs (simulations) on a ring, in compiled code.

A plan is a sequence of legs. Each leg is the number of cells that the vehicle flies before it
turns, and the last two legs are repeated indefinitely. A lap is one infinite leg, a sweep is two
equal legs, and a lap that passes an arc three times is a long leg and a short leg. Each visit
changes only one node. Therefore the computing time of a roll-out is proportional to the number of
nodes plus the number of steps of the vehicles.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import kernel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

LEGS = 18  # number of legs in a plan; the last two are repeated
NEVER = 1 << 40  # number of cells in an infinite leg


class Nodes(NamedTuple):
    """The ring of a roll-out; each array has a value per node (n), clockwise."""

    step_m: Floats  # distance from each node to the next one, and from the last to the first
    scale: Floats  # the integral of a node's importance up to an age is scale * age ** power
    power: Floats
    linear: bool  # all powers are 2
    visited_s: Floats  # time of the last view of each node; now is 0
    cells: int  # number of cells in a node; legs are in cells


class StartState(NamedTuple):
    """The vehicles at the beginning of a roll-out; each array has a value per vehicle (k)."""

    node: Integers  # next node of each vehicle
    arrival_s: Floats  # time of arrival at this node
    heading: Integers  # 1: clockwise, -1: anticlockwise
    speed_m_s: Floats
    turn_s: float  # duration of a turn back


class Workspace(NamedTuple):
    """The work arrays of a roll-out."""

    visited_s: Floats  # (n)
    node: Integers  # (k)
    arrival_s: Floats  # (k)
    heading: Integers  # (k)
    leg: Integers  # (k), the index of the current leg
    left: Integers  # (k), the number of nodes left in this leg


class Horizon(NamedTuple):
    """The length of a roll-out, and the additional weight ``late_times`` of the last part.

    The last part begins at ``late_from_s`` and represents all later times.
    """

    end_s: float
    late_from_s: float
    late_times: float


class Moves(NamedTuple):
    """The changes to a plan (in cells) that ``improve`` tries, and work arrays for ``improve``."""

    onward: Integers  # lengths of a flight onward before a turn back
    backs: Integers  # lengths of a flight back
    shifts: Integers  # delays of a turn
    kept: Integers  # (LEGS)
    best: Integers  # (LEGS)


def moves_of(onward: Sequence[int], backs: Sequence[int], shifts: Sequence[int]) -> Moves:
    """Return the moves with these lengths in cells, and work arrays."""
    return Moves(
        np.array(onward, np.int64),
        np.array(backs, np.int64),
        np.array(shifts, np.int64),
        np.zeros(LEGS, np.int64),
        np.zeros(LEGS, np.int64),
    )


def workspace_for(nodes: int, vehicles: int) -> Workspace:
    """Return work arrays for roll-outs of this size.

    The arrays are filled with zeros, because recorded states contain these arrays.
    """
    return Workspace(
        np.zeros(nodes),
        np.zeros(vehicles, np.int64),
        np.zeros(vehicles),
        np.zeros(vehicles, np.int64),
        np.zeros(vehicles, np.int64),
        np.zeros(vehicles, np.int64),
    )


@kernel
def _up_to(nodes, place, age_s):  # type: ignore[no-untyped-def]
    """Return a node's importance, integrated from age 0 to ``age_s``."""
    if nodes.linear:
        return nodes.scale[place] * age_s * age_s
    if age_s <= 0.0:
        return 0.0
    return nodes.scale[place] * np.exp(nodes.power[place] * np.log(age_s))


@kernel
def _standing(nodes, visited_s, at_s):  # type: ignore[no-untyped-def]
    total = 0.0
    for place in range(visited_s.size):
        total += _up_to(nodes, place, at_s - visited_s[place])
    return total


@kernel
def _fly(nodes, start, legs, room, until_s):  # type: ignore[no-untyped-def]
    """Simulate all vehicles until ``until_s``; return the importance of the visited nodes.

    For each visit the importance is integrated over the time since the node's previous visit.
    """
    ended = 0.0
    count = room.node.size
    size = nodes.step_m.size
    while True:
        vehicle = 0
        at_s = room.arrival_s[0]
        for other in range(1, count):
            if room.arrival_s[other] < at_s:
                vehicle, at_s = other, room.arrival_s[other]
        if at_s >= until_s:
            return ended
        place = room.node[vehicle]
        ended += _up_to(nodes, place, at_s - room.visited_s[place])
        room.visited_s[place] = at_s
        heading = room.heading[vehicle]
        while room.left[vehicle] == 0:
            room.heading[vehicle] = -room.heading[vehicle]
            room.leg[vehicle] = room.leg[vehicle] + 1 if room.leg[vehicle] + 1 < LEGS else LEGS - 2
            room.left[vehicle] = (
                legs[vehicle, room.leg[vehicle]] + nodes.cells // 2
            ) // nodes.cells
        room.left[vehicle] -= 1
        if room.heading[vehicle] > 0:
            step_m = nodes.step_m[place]
            room.node[vehicle] = place + 1 if place + 1 < size else 0
        else:
            room.node[vehicle] = place - 1 if place > 0 else size - 1
            step_m = nodes.step_m[room.node[vehicle]]
        room.arrival_s[vehicle] = at_s + step_m / start.speed_m_s[vehicle]
        if room.heading[vehicle] != heading:
            room.arrival_s[vehicle] += start.turn_s


@kernel
def _begin(nodes, start, legs, room):  # type: ignore[no-untyped-def]
    for place in range(nodes.visited_s.size):
        room.visited_s[place] = nodes.visited_s[place]
    for vehicle in range(start.node.size):
        room.node[vehicle] = start.node[vehicle]
        room.arrival_s[vehicle] = start.arrival_s[vehicle]
        room.heading[vehicle] = start.heading[vehicle]
        room.leg[vehicle] = 0
        room.left[vehicle] = (legs[vehicle, 0] + nodes.cells // 2) // nodes.cells


@kernel
def roll_out(nodes, start, legs, span, room):  # type: ignore[no-untyped-def]
    """Return the importance of all nodes, integrated over time, when the plans are flown.

    ``legs`` (k, LEGS) holds the plans, which begin at ``start.node``. A leg of 0 cells means that
    the vehicle turns at once. The result includes a constant, the cost of the initial ages.
    """
    _begin(nodes, start, legs, room)
    cost = _fly(nodes, start, legs, room, span.late_from_s)
    cost -= span.late_times * _standing(nodes, room.visited_s, span.late_from_s)
    late = _fly(nodes, start, legs, room, span.end_s)
    late += _standing(nodes, room.visited_s, span.end_s)
    return cost + (1.0 + span.late_times) * late


@kernel
def _tried(nodes, start, legs, span, room, vehicle, best, best_cost):  # type: ignore[no-untyped-def]
    """Roll out the plans; copy this vehicle's plan to ``best`` if the cost is below ``best_cost``.

    Returns the lower of the two costs.
    """
    cost = roll_out(nodes, start, legs, span, room)
    if cost < best_cost:
        for leg in range(LEGS):
            best[leg] = legs[vehicle, leg]
        return cost
    return best_cost


@kernel
def _turn_back(plan, kept, onward, back):  # type: ignore[no-untyped-def]
    """Insert two turns after ``onward`` cells, with a leg of ``back`` cells between them.

    With a leg of ``NEVER`` cells there is no second turn. Returns False if the plan turns earlier.
    """
    if onward > 0 and onward >= kept[0]:
        return False
    plan[0], plan[1] = onward, back
    plan[2] = NEVER if kept[0] >= NEVER else min(kept[0] - onward + back, NEVER)
    for leg in range(3, LEGS):  # the last two legs are repeated
        plan[leg] = kept[leg - 2]
    if back >= NEVER:
        for leg in range(2, LEGS):
            plan[leg] = NEVER
    return True


@kernel
def _shift_turn(plan, kept, turn, shift):  # type: ignore[no-untyped-def]
    """Delay one turn by ``shift`` cells; return False if a leg would become negative."""
    if kept[turn] + shift < 0 or kept[turn + 1] + shift < 0:
        return False
    for leg in range(LEGS):
        plan[leg] = kept[leg]
    plan[turn] += shift
    plan[turn + 1] = NEVER if kept[turn + 1] >= NEVER else min(kept[turn + 1] + shift, NEVER)
    return True


@kernel
def _leave_out_turns(plan, kept):  # type: ignore[no-untyped-def]
    """Remove the next two turns; return whether this is possible.

    The removal is not possible if the plan has fewer than two turns, or if the vehicle would end up
    behind its start.
    """
    if kept[0] >= NEVER or kept[1] >= NEVER or (kept[2] < NEVER and kept[0] + kept[2] < kept[1]):
        return False
    plan[0] = NEVER if kept[2] >= NEVER else kept[0] - kept[1] + kept[2]
    for leg in range(1, LEGS):
        plan[leg] = kept[leg + 2] if leg + 2 < LEGS else kept[leg]
    return True


@kernel
def improve(nodes, start, legs, span, room, vehicle, moves, margin):  # type: ignore[no-untyped-def]
    """Replace the plan of one vehicle if another plan is cheaper by the fraction ``margin``.

    The other plans fly onward for a number of cells in ``moves.onward`` and then back for a number
    of cells in ``moves.backs``, delay one of the next three turns by a number of cells in
    ``moves.shifts``, or omit the next two turns. ``legs`` (k, LEGS) holds the plans; only the row
    of ``vehicle`` is modified. Returns the number of roll-outs.
    """
    kept, best, plan = moves.kept, moves.best, legs[vehicle]
    for leg in range(LEGS):
        kept[leg] = best[leg] = plan[leg]
    first = roll_out(nodes, start, legs, span, room)
    best_cost = first
    count = 1
    for onward in moves.onward:
        for back in moves.backs:
            if _turn_back(plan, kept, onward, back):
                best_cost = _tried(nodes, start, legs, span, room, vehicle, best, best_cost)
                count += 1
    for turn in range(3):
        if kept[turn] >= NEVER:
            break
        for shift in moves.shifts:
            if _shift_turn(plan, kept, turn, shift):
                best_cost = _tried(nodes, start, legs, span, room, vehicle, best, best_cost)
                count += 1
    if moves.backs.size > 0 and _leave_out_turns(plan, kept):
        best_cost = _tried(nodes, start, legs, span, room, vehicle, best, best_cost)
        count += 1
    chosen = best if best_cost < (1.0 - margin) * first else kept
    for leg in range(LEGS):
        plan[leg] = chosen[leg]
    return count
