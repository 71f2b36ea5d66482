"""Rolls out (simulates) a vehicle's sweeps and laps on a coarse ring, to decide the direction.

A plan is a sequence of legs with turns between them. Legs are measured in nodes of the ring, and
the last leg has no end. The cost of a plan is the cube of the expected error, integrated over time
and summed over the ring. The cost approximates the largest error, but also distinguishes between
plans with the same largest error. The error of a node out of view grows linearly, so a roll-out
computes errors only at visits. The computing time of a roll-out is proportional to the number of
nodes plus the number of steps.

Lengths are in cells, times in seconds, and speeds in cells per second.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import compiled

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

NODES = 72
NEVER = 1 << 40  # number of nodes in an unlimited leg
MIN_GROWTH_CELLS_S = 1e-6
SLOWEST = 0.2  # minimum ground speed, as a fraction of the airspeed


class CoarseRing(NamedTuple):
    """The front, divided clockwise into nodes of equal length; each array has n elements."""

    ahead_s: Floats  # flight time from each node to the next one
    back_s: Floats  # flight time from each node to the previous one
    error: Floats  # expected error now, in cells
    growth: Floats  # growth of the error while the node is not in view, in cells/s
    left: Floats  # error of a node in view, in cells


def _plans() -> Integers:
    """Return the legs (m, 3) of all plans.

    The plans are: fly on; fly out, turn back, turn again and fly on; fly out, turn back and fly on.
    """
    legs = [(NEVER, 0, 0)]
    for out in (2, 5, 9, 14, 20, 28, 38, 50, 62):
        legs += [(out, back, NEVER) for back in (4, 8, 14, 22, 32, 44, 58)]
        legs.append((out, NEVER, 0))
    return np.array(legs, dtype=np.int64)


PLANS = _plans()


@compiled
def flight_times(north, east, length, speed, wind):  # type: ignore[no-untyped-def]
    """Return the flight times along a straight step, forwards and in the opposite direction.

    ``north`` and ``east`` are the components of the step and ``length`` is its length; each is a
    number or an array of any shape. ``speed`` is the airspeed, and ``wind`` holds the speeds
    towards north and east at which the wind carries the vehicle.
    """
    tail = (wind[0] * north + wind[1] * east) / length
    cross = (wind[0] * east - wind[1] * north) / length
    own = np.sqrt(np.maximum(speed * speed - cross * cross, 0.0))
    least = SLOWEST * speed
    return length / np.maximum(own + tail, least), length / np.maximum(own - tail, least)


@compiled
def fill_ring(front, error, growth, left, speed, wind, node_of, ring):  # type: ignore[no-untyped-def]
    """Divide a front (cells on 360 bearings) into the nodes of a ring, and fill in the ring.

    ``error``, ``growth`` and ``left`` have a value per bearing; each node gets the maximum over its
    bearings. ``wind`` holds the speeds towards north and east at which the wind carries the
    vehicle, and ``speed`` is the vehicle's airspeed. ``node_of`` (360) is filled with the node of
    each bearing. Returns the length of the front.
    """
    count, nodes = front.size, ring.error.size
    length = 0.0
    for turn in range(2):
        along = 0.0
        if turn == 1:
            ring.error[:], ring.growth[:], ring.left[:] = 0.0, MIN_GROWTH_CELLS_S, 0.0
            ring.ahead_s[:], ring.back_s[:] = 0.0, 0.0
        for i in range(count):
            k = (i + 1) % count
            bearing_rad, next_rad = math.radians(i), math.radians(k)
            north = front[k] * math.cos(next_rad) - front[i] * math.cos(bearing_rad)
            east = front[k] * math.sin(next_rad) - front[i] * math.sin(bearing_rad)
            step = math.sqrt(north * north + east * east)
            if turn == 1:
                node = min(int(along / length * nodes), nodes - 1)
                node_of[i] = node
                ring.error[node] = max(ring.error[node], error[i])
                ring.growth[node] = max(ring.growth[node], growth[i])
                ring.left[node] = max(ring.left[node], left[i])
                if step > 0.0:
                    # The flight time along a step of the front is divided among the step's nodes.
                    ahead, back = flight_times(north, east, step, speed, wind)
                    last = min(int((along + step) / length * nodes), nodes - 1)
                    for place in range(node, last + 1):
                        ring.ahead_s[place] += ahead / (last + 1 - node)
                        ring.back_s[place] += back / (last + 1 - node)
            along += step
        length = max(along, 1e-9)
    return length


@compiled
def costs_of(plans, ring, node, clockwise, delay_s, turn_s, horizon_s, found):  # type: ignore[no-untyped-def]
    """Compute the cost of flying each of ``plans`` (m, legs) from a node, into ``found`` (m).

    The vehicle starts after ``delay_s``, for example the time of a turn. Each turn between two legs
    takes ``turn_s``.
    """
    ahead_s, back_s, error, growth, left = ring
    n = error.size
    since, start = np.empty(n), np.empty(n)
    for plan in range(plans.shape[0]):
        for i in range(n):
            since[i], start[i] = 0.0, error[i]
        total, now, place = 0.0, delay_s, node
        step, leg = (1 if clockwise else -1), 0
        steps = plans[plan, 0]
        while now < horizon_s:
            before = start[place]
            reached = before + growth[place] * (now - since[place])
            total += (reached**4 - before**4) / (4.0 * growth[place])
            start[place], since[place] = min(left[place], reached), now
            if steps == 0:
                step, leg = -step, leg + 1
                steps = plans[plan, leg]
                now += turn_s
            steps -= 1
            if step > 0:
                now += ahead_s[place]
                place = place + 1 if place + 1 < n else 0
            else:
                place = place - 1 if place > 0 else n - 1
                now += back_s[place]
        for i in range(n):
            if horizon_s > since[i]:
                reached = start[i] + growth[i] * (horizon_s - since[i])
                total += (reached**4 - start[i] ** 4) / (4.0 * growth[i])
        found[plan] = total
