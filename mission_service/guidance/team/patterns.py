"""The long-term patterns of a team on a ring, and their steady-state costs.

There are three kinds of patterns: all vehicles circle in single file; all circle and pass an arc of
fast spread three times (on, back, on); or some sweep the arc while the others circle. On an even
front circling is best: with the same number of passes, sweeping makes the mean age of a cell 4/3
times as high. A sweep reduces the cost only if the arc spreads several times as fast as the rest.
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

PARTS = 64  # number of parts of the ring, in which arcs are measured


class Pattern(NamedTuple):
    """An arc, in parts of the ring, and the number of vehicles that sweep it.

    If no vehicle sweeps the arc, all vehicles pass it three times.
    """

    first: int
    length: int  # 0: no arc, all lap
    sweeping: int


LAPS = Pattern(0, 0, 0)


def candidates(vehicles: int) -> list[Pattern]:
    """Return the patterns with an arc to try for a number of vehicles."""
    lengths = (2, 3, 4, 6, 8, 12, 16, 20, 24)
    arcs = [(first, length) for length in lengths for first in range(0, PARTS, 2)]
    sweepers = range(max(vehicles - 1, 0) + 1) if vehicles > 1 else range(1)
    return [Pattern(*arc, sweeping) for sweeping in sweepers if sweeping <= 2 for arc in arcs]


def repeated(first: int, second: int) -> Integers:
    """Return a plan (LEGS) of two legs that alternate without end."""
    return np.array([first, second] * (LEGS // 2), np.int64)


def settled_cost(
    pattern: Pattern, nodes: Nodes, speed_m_s: Floats, turn_s: float, room: Workspace
) -> float:
    """Return the mean over time of all nodes' importance, for a pattern with even spacing.

    ``nodes`` has ``PARTS`` nodes, ``speed_m_s`` (k) holds the vehicles' speeds, and ``turn_s`` is
    the duration of a turn back.
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
