"""Long-term patterns of a team on a ring, and their steady-state costs.

In a pattern all vehicles lap one behind the other; or all lap and pass a hot arc three times (on,
back, on); or some sweep the arc while the others lap. On an even front laps are best: the mean age
of a sweep is 4/3 of that of a lap with as many passes, so that an arc must spread several times
faster for a sweep to reduce the cost.
"""

from typing import NamedTuple

import numpy as np

from mission_service.guidance.team.lookahead import (
    LEGS,
    NEVER,
    Floats,
    Horizon,
    Integers,
    Nodes,
    StartState,
    Workspace,
    late_mean,
)

PARTS = 64  # of the ring: the unit of arcs


class Pattern(NamedTuple):
    """An arc in parts of the ring, and the number of vehicles that sweep it.

    If it is 0, all vehicles pass the arc three times.
    """

    first: int
    length: int  # 0: no arc, all lap
    sweeping: int


LAPS = Pattern(0, 0, 0)


def candidates(vehicles: int) -> list[Pattern]:
    """Return the patterns to try for a number of vehicles."""
    lengths = (2, 3, 4, 6, 8, 12, 16, 20, 24)
    arcs = [(first, length) for length in lengths for first in range(0, PARTS, 2)]
    sweepers = range(max(vehicles - 1, 0) + 1) if vehicles > 1 else range(1)
    return [Pattern(*arc, sweeping) for sweeping in sweepers if sweeping <= 2 for arc in arcs]


def repeated(first: int, second: int) -> Integers:
    """Return legs (LEGS) that alternate without end."""
    return np.array([first, second] * (LEGS // 2), np.int64)


def settled_cost(
    pattern: Pattern, nodes: Nodes, speed_m_s: Floats, turn_s: float, room: Workspace
) -> float:
    """Return the mean importance of all nodes over time for a pattern with even spacing.

    ``nodes`` has PARTS nodes; ``speed_m_s`` (k) are the vehicles' speeds, ``turn_s`` the duration
    of a turn back.
    """
    count = speed_m_s.size
    step_m = nodes.step_m
    mean_m_s = float(speed_m_s.mean())
    lap_s = float(step_m.sum()) / mean_m_s
    first, length, sweeping = pattern
    arc = np.arange(first, first + length) % PARTS
    arc_s = float(step_m[arc].sum()) / mean_m_s
    legs = np.empty((count, LEGS), np.int64)
    node = np.full(count, first % PARTS)
    arrival_s = np.empty(count)
    lapping = count - sweeping
    arc_s += turn_s if length else 0.0
    period_s = lap_s + (2.0 * arc_s if sweeping == 0 else 0.0)
    for vehicle in range(count):
        if vehicle < lapping:
            twice = length > 0 and sweeping == 0
            legs[vehicle] = repeated(PARTS + length, length) if twice else NEVER
            arrival_s[vehicle] = period_s * vehicle / lapping
        else:
            legs[vehicle] = repeated(length, length)
            arrival_s[vehicle] = 2.0 * arc_s * (vehicle - lapping) / sweeping
    start = StartState(node, arrival_s, np.ones(count, np.int64), speed_m_s, turn_s)
    span = Horizon((3.0 if sweeping == 0 else 4.0) * period_s, 1.5 * period_s, 0.0)
    if sweeping == 0:
        span = Horizon(2.0 * period_s + lap_s, period_s + lap_s, 0.0)
    return float(late_mean(nodes, start, legs, span, room))
