"""Finds the direction in which a vehicle flew around a fire, and its reversals. Pure."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# A reversal is a flight back through at least FIRE_DEG around a fire, or TRACK_DEG around a track's
# centre. TRACK_DEG is larger, because a track may contain loiters at any position.
FIRE_DEG, TRACK_DEG = 30.0, 60.0
LEAP_DEG = 90.0  # a larger angle between two points means a flight across the centre


class Turn(NamedTuple):
    """A change of direction at the track point with this index."""

    point: int
    clockwise: bool


def turns(east_m: Floats, north_m: Floats, min_deg: float, near_m: float) -> list[Turn]:
    """Return the directions of travel around a centre; positions (n,) are in m from the centre.

    A reversal is found when the vehicle has flown back by ``min_deg``, and is dated to the point
    farthest along the previous direction. Points closer to the centre than ``near_m`` are ignored,
    because their bearing is uncertain. Movements of less than ``min_deg`` are not found.
    """
    used = np.flatnonzero(np.hypot(east_m, north_m) >= near_m)
    angle_deg = np.rad2deg(np.unwrap(np.arctan2(east_m[used], north_m[used])))
    found: list[Turn] = []
    low = high = 0  # the points with the smallest and the largest angle so far
    for place, angle in enumerate(angle_deg):
        if place and abs(angle - angle_deg[place - 1]) > LEAP_DEG:
            low = high = place
        low = place if angle < angle_deg[low] else low
        high = place if angle > angle_deg[high] else high
        if (not found or not found[-1].clockwise) and angle - angle_deg[low] >= min_deg:
            found.append(Turn(int(used[low]), True))
            high = place
        elif (not found or found[-1].clockwise) and angle_deg[high] - angle >= min_deg:
            found.append(Turn(int(used[high]), False))
            low = place
    return found


class Span(NamedTuple):
    """A time span during which a condition holds."""

    from_us: int
    to_us: int


def differing(
    flown: Sequence[tuple[int, bool]],
    decided: Sequence[tuple[int, bool | None]],
    end_us: int,
) -> list[Span]:
    """Return the spans in which two directions differ; an unknown direction (None) never differs.

    Each direction (time, clockwise) is valid until the time of the next direction.
    """
    times = sorted({at_us for at_us, _ in (*flown, *decided)} | {end_us})
    spans: list[Span] = []
    for from_us, to_us in pairwise(times):
        one, other = _at(flown, from_us), _at(decided, from_us)
        if one is None or other is None or one == other:
            continue
        if spans and spans[-1].to_us == from_us:
            spans[-1] = Span(spans[-1].from_us, to_us)
        else:
            spans.append(Span(from_us, to_us))
    return spans


def _at(directions: Sequence[tuple[int, bool | None]], at_us: int) -> bool | None:
    found = [clockwise for since_us, clockwise in directions if since_us <= at_us]
    return found[-1] if found else None
