"""The direction in which a vehicle flew around a fire, and where it turned back. Pure."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# A vehicle that has flown back through this angle has turned back: around a fire, and around the
# middle of a track (larger, because loiters may lie anywhere).
FIRE_DEG, TRACK_DEG = 30.0, 60.0
LEAP_DEG = 90.0  # between two points: it flew across the middle, not around it


class Turn(NamedTuple):
    """From the track point of this index on, the vehicle flies in this direction."""

    point: int
    clockwise: bool


def turns(east_m: Floats, north_m: Floats, min_deg: float, near_m: float) -> list[Turn]:
    """Directions of travel around a middle, in order, from positions (n,) in metres from it.

    A turn back is dated to the point farthest along the old direction, which is determined when
    the vehicle has flown back by ``min_deg``. Points nearer to the middle than ``near_m`` are
    ignored: their bearing is too uncertain. Movements of less than ``min_deg`` are not found.
    """
    counts = np.flatnonzero(np.hypot(east_m, north_m) >= near_m)
    angle_deg = np.rad2deg(np.unwrap(np.arctan2(east_m[counts], north_m[counts])))
    found: list[Turn] = []
    least = most = 0  # the points with the least and the greatest angle so far
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
    """A time span during which a condition holds."""

    from_us: int
    to_us: int


def differing(
    flown: Sequence[tuple[int, bool]],
    decided: Sequence[tuple[int, bool | None]],
    end_us: int,
) -> list[Span]:
    """Return the spans in which two directions differ; each is valid from its time. None never differs."""
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
