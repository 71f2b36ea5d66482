"""Which way round: sweeps and circles of one vehicle flown ahead on a coarse ring, in compiled code.

A plan is a row of legs, each so many nodes long, with a turn between them; the last has no end.
The cost is the integral over time, and the sum over the ring, of the expected error to the power
three, which is near to its maximum and still tells plans with the same maximum apart. The error of
a node grows steadily while nobody looks, so only visits have to be followed: a roll-out costs nodes
plus steps.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import compiled

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

NODES = 72
NEVER = 1 << 40


class Ring(NamedTuple):
    """The front as nodes of the same length, clockwise; arrays (n)."""

    ahead_s: Floats  # to fly from each node to the next one
    back_s: Floats  # to fly from each node to the one before
    error: Floats  # expected now, in cells
    growth: Floats  # of it, in cells/s while the node is not in view
    seen: Floats  # what is left of the error when it is, in cells


def _plans() -> Integers:
    """Legs (m, 3): out and on round, out and back, out and back and round again."""
    legs = [(NEVER, 0, 0)]
    for out in (2, 5, 9, 14, 20, 28, 38, 50, 62):
        legs += [(out, back, NEVER) for back in (4, 8, 14, 22, 32, 44, 58)]
        legs.append((out, NEVER, 0))
    return np.array(legs, dtype=np.int64)


PLANS = _plans()


@compiled
def costs_of(plans, ring, node, clockwise, delay_s, turn_s, horizon_s, found):  # type: ignore[no-untyped-def]
    """Cost of each plan (m, legs) into ``found`` (m), from a node, the first turn after the delay.

    ``delay_s`` is the time until the vehicle sets out, which it loses if it has to turn first.
    """
    ahead_s, back_s, error, growth, seen = ring
    n = error.size
    since, start = np.empty(n), np.empty(n)
    for plan in range(plans.shape[0]):
        for i in range(n):
            since[i], start[i] = 0.0, error[i]
        total, now, place = 0.0, delay_s, node
        step, leg = (1 if clockwise else -1), 0
        left = plans[plan, 0]
        while now < horizon_s:
            # Leaving a node now: what it cost until now, and anew from what is left.
            reached = start[place] + growth[place] * (now - since[place])
            total += (reached**4 - start[place] ** 4) / (4.0 * growth[place])
            start[place], since[place] = seen[place], now
            if left == 0:
                step, leg = -step, leg + 1
                left = plans[plan, leg]
                now += turn_s
            left -= 1
            if step > 0:
                now += ahead_s[place]
                place = place + 1 if place + 1 < n else 0
            else:
                now += back_s[place]
                place = place - 1 if place > 0 else n - 1
        for i in range(n):
            reached = start[i] + growth[i] * (horizon_s - since[i])
            if horizon_s > since[i]:
                total += (reached**4 - start[i] ** 4) / (4.0 * growth[i])
        found[plan] = total
