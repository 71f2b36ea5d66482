"""How many vehicles a front needs, and how many of them should lap and how many sweep.

Ring of length L, vehicles of speed v: n that lap, evenly spaced, see every point each L/(n v); k
that sweep an arc of length l come back to its ends after 2 l/(k v). With the rate of spread at a
point, that is how far the front gets there unseen (facts/patrolling.md).
"""

import math
from typing import NamedTuple

import numpy as np

from mission_service.guidance.team.ring import Floats

PARTS = 64  # of the ring: where arcs may begin and end


class Split(NamedTuple):
    """How many vehicles lap and how many sweep an arc of ``arc_m`` metres of the ring."""

    lapping: int
    sweeping: int
    arc_m: float
    worst_advance_m: float  # that the front makes unseen anywhere


def vehicles_for_age(length_m: float, speed_m_s: float, worst_age_s: float) -> int:
    """How many must lap so that nothing stays unseen for longer: n >= L / (v T)."""
    return _at_least(length_m / (speed_m_s * worst_age_s))


def vehicles_for_advance(
    spread_rate_m_s: float, length_m: float, speed_m_s: float, advance_m: float
) -> int:
    """How many must lap so that the front gets no further unseen: n >= ROS_max L / (v D)."""
    return _at_least(spread_rate_m_s * length_m / (speed_m_s * advance_m))


def _at_least(number: float) -> int:
    return max(1, math.ceil(number - 1e-9))


def best_split(step_m: Floats, spread_rate_m_s: Floats, vehicles: int, speed_m_s: float) -> Split:
    """The split and the arc that keep the worst advance least, from the measured spread.

    Arrays (n) of a ring. All lap unless sweeping is better; of equal ones the fewest sweep.
    """
    length_m = float(step_m.sum())
    lapping_m = float(spread_rate_m_s.max()) * length_m / speed_m_s / vehicles
    best = Split(vehicles, 0, 0.0, lapping_m)
    along_m = np.concatenate([[0.0], np.cumsum(step_m)])
    parts = min(PARTS, step_m.size)
    edges = np.arange(parts + 1) * step_m.size // parts
    fastest = np.maximum.reduceat(spread_rate_m_s, edges[:-1])
    part_m = np.diff(along_m[edges])
    for first in range(parts):
        order = (first + np.arange(parts)) % parts
        inside = np.maximum.accumulate(fastest[order])[:-1]
        outside = np.maximum.accumulate(fastest[order][::-1])[::-1][1:]
        arc_m = np.cumsum(part_m[order])[:-1]
        for sweeping in range(1, vehicles):
            swept = 2.0 * inside * arc_m / sweeping
            lapped = outside * length_m / (vehicles - sweeping)
            worst = np.maximum(swept, lapped) / speed_m_s
            at = int(np.argmin(worst))
            if worst[at] < best.worst_advance_m - 1e-9:
                best = Split(
                    vehicles - sweeping,
                    sweeping,
                    float(arc_m[at]),
                    float(worst[at]),
                )
    return best


def vehicles_needed(
    step_m: Floats, spread_rate_m_s: Floats, speed_m_s: float, advance_m: float
) -> Split:
    """The smallest team that keeps the unseen advance under a limit, and how it splits."""
    most = vehicles_for_advance(
        float(spread_rate_m_s.max()), float(step_m.sum()), speed_m_s, advance_m
    )
    for vehicles in range(1, most):
        split = best_split(step_m, spread_rate_m_s, vehicles, speed_m_s)
        if split.worst_advance_m <= advance_m:
            return split
    return best_split(step_m, spread_rate_m_s, most, speed_m_s)
