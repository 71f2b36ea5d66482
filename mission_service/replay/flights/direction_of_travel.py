"""Which way round a vehicle has flown, and where it turned back. Pure."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Gone back so far around the middle, it has turned back: around a fire, and around no more than the
# middle of a track, where loiters lie anywhere.
FIRE_DEG, TRACK_DEG = 30.0, 60.0
LEAP_DEG = 90.0  # between two points: it went across the middle, not round it


class Turn(NamedTuple):
    """From the point of this number in a track on, it flies this way round."""

    point: int
    clockwise: bool


def turns(east_m: Floats, north_m: Floats, min_deg: float, near_m: float) -> list[Turn]:
    """Ways round a middle, the first one first, of places (n,) in metres from that middle.

    A turn back is dated to the point farthest along the old way, which is known when the vehicle
    has come back by ``min_deg``. Points nearer to the middle than ``near_m`` are passed over, for
    their bearing says nothing. Nothing is found in less than ``min_deg``.
    """
    counts = np.flatnonzero(np.hypot(east_m, north_m) >= near_m)
    angle_deg = np.rad2deg(np.unwrap(np.arctan2(east_m[counts], north_m[counts])))
    found: list[Turn] = []
    least = most = 0  # the outermost points on the way so far
    for place, angle in enumerate(angle_deg):
        if place and abs(angle - angle_deg[place - 1]) > LEAP_DEG:
            least = most = place
        least = place if angle < angle_deg[least] else least
        most = place if angle > angle_deg[most] else most
        if (not found or not found[-1].clockwise) and angle - angle_deg[least] >= min_deg:
            found.append(Turn(int(counts[least]), True))
            most = place
        elif (not found or found[-1].clockwise) and angle_deg[most] - angle >= min_deg:
            found.append(Turn(int(counts[most]), False))
            least = place
    return found


class Span(NamedTuple):
    """A time during which something holds."""

    from_us: int
    to_us: int


def differing(
    flown: Sequence[tuple[int, bool]],
    decided: Sequence[tuple[int, bool | None]],
    end_us: int,
) -> list[Span]:
    """When two ways round differ; each is said from its time on. None differs from nothing."""
    times = sorted({at_us for at_us, _ in (*flown, *decided)} | {end_us})
    spans: list[Span] = []
    for from_us, to_us in pairwise(times):
        ours, theirs = _at(flown, from_us), _at(decided, from_us)
        if ours is None or theirs is None or ours == theirs:
            continue
        if spans and spans[-1].to_us == from_us:
            spans[-1] = Span(spans[-1].from_us, to_us)
        else:
            spans.append(Span(from_us, to_us))
    return spans


def _at(ways: Sequence[tuple[int, bool | None]], at_us: int) -> bool | None:
    told = [way for since_us, way in ways if since_us <= at_us]
    return told[-1] if told else None
