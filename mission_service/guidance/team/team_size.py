"""Computes how many vehicles a front needs, and how many of these lap or sweep; gives advice.

On a ring of length L, n vehicles with speed v that lap with even spacing see every point at
intervals of L/(n v). If k vehicles sweep an arc of length l, they see each end of the arc at
intervals of 2 l/(k v). The age of a point is the time since the last view; the largest age is the
interval between views. The unseen advance of the front at a point is the interval times the rate of
spread.
"""

import math
from bisect import bisect_left
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mission_service.guidance.team.front_ring import Floats, FrontRing

ADVISE_EVERY_S = 300.0
MAX_VEHICLES = 100  # if more are needed, their number is not computed
PARTS = 64  # number of parts of the ring; an arc begins and ends at part borders


class Split(NamedTuple):
    """The numbers of vehicles that lap and that sweep, and the length of the swept arc."""

    lapping: int
    sweeping: int
    arc_m: float
    worst_advance_m: float  # largest unseen advance of the front


def vehicles_for_age(length_m: float, speed_m_s: float, max_revisit_s: float) -> int:
    """Return how many vehicles must lap to keep the age within T: n >= L / (v T)."""
    return _at_least(length_m / (speed_m_s * max_revisit_s))


def vehicles_for_advance(
    spread_rate_m_s: float, length_m: float, speed_m_s: float, advance_m: float
) -> int:
    """Return how many vehicles must lap to keep the unseen advance within ``advance_m``.

    The number is n >= R L / (v D), with the advance D and the largest rate of spread R.
    """
    return _at_least(spread_rate_m_s * length_m / (speed_m_s * advance_m))


def _at_least(number: float) -> int:
    return max(1, math.ceil(number - 1e-9))


def best_split(step_m: Floats, spread_rate_m_s: Floats, vehicles: int, speed_m_s: float) -> Split:
    """Return the split and the arc that minimise the worst unseen advance.

    ``step_m`` and ``spread_rate_m_s`` (n) have a value per cell of the ring. All vehicles lap
    unless sweeping is better. Among splits with the same worst advance, the split with the fewest
    sweeping vehicles is returned.
    """
    length_m = float(step_m.sum())
    lapping_m = float(spread_rate_m_s.max()) * length_m / speed_m_s / vehicles
    best = Split(vehicles, 0, 0.0, lapping_m)
    along_m = np.concatenate([[0.0], np.cumsum(step_m)])
    parts = min(PARTS, step_m.size)
    edges = np.arange(parts + 1) * step_m.size // parts
    fastest = np.maximum.reduceat(spread_rate_m_s, edges[:-1])
    part_m = np.diff(along_m[edges])
    sweepers = np.arange(1, vehicles)
    for first in range(parts):
        order = (first + np.arange(parts)) % parts
        inside = np.maximum.accumulate(fastest[order])[:-1]
        outside = np.maximum.accumulate(fastest[order][::-1])[::-1][1:]
        arc_m = np.cumsum(part_m[order])[:-1]
        if not arc_m.size:
            continue
        swept = 2.0 * inside * arc_m / sweepers[:, None]
        lapped = outside * length_m / (vehicles - sweepers[:, None])
        worst = np.maximum(swept, lapped) / speed_m_s  # for each number of sweepers and each arc
        for row, at in enumerate(np.argmin(worst, axis=1).tolist()):
            if worst[row, at] < best.worst_advance_m - 1e-9:
                found = float(arc_m[at]), float(worst[row, at])
                best = Split(vehicles - row - 1, row + 1, *found)
    return best


def vehicles_needed(
    step_m: Floats, spread_rate_m_s: Floats, speed_m_s: float, advance_m: float
) -> Split | None:
    """Return the split of the smallest team that keeps the unseen advance within ``advance_m``.

    The result is None if this requires more than ``MAX_VEHICLES``. The number is bisected, because
    the worst unseen advance never grows with the number of vehicles.
    """

    def split(vehicles: int) -> Split:
        return best_split(step_m, spread_rate_m_s, vehicles, speed_m_s)

    max_vehicles = vehicles_for_advance(
        float(spread_rate_m_s.max()), float(step_m.sum()), speed_m_s, advance_m
    )
    if max_vehicles > MAX_VEHICLES:
        if split(MAX_VEHICLES).worst_advance_m > advance_m:
            return None
        max_vehicles = MAX_VEHICLES
    fewer = range(1, max_vehicles)
    place = bisect_left(fewer, True, key=lambda n: split(n).worst_advance_m <= advance_m)
    return split(1 + place)


@dataclass(frozen=True, slots=True)
class CoverageTargets:
    """The limits on the age and the unseen advance of any part of the front."""

    max_revisit_s: float | None = None
    max_unseen_advance_m: float | None = None


def team_size_advice(
    ring: FrontRing, speed_m_s: Floats, targets: CoverageTargets
) -> tuple[bool, str]:
    """Return whether a team is too small for the targets, and advice as text.

    The advice is for the mean of the vehicles' speeds ``speed_m_s`` (k). Without targets the
    text describes only the team's current performance.
    """
    vehicles, mean_m_s = speed_m_s.size, float(np.mean(speed_m_s))
    length_m, fastest_m_s = float(ring.step_m.sum()), float(ring.spread_rate_m_s.max())
    split = best_split(ring.step_m, ring.spread_rate_m_s, vehicles, mean_m_s)
    lapping = "" if not split.sweeping else f", {split.sweeping} of them sweeping the fastest part"
    text = (
        f"front of {length_m / 1e3:.1f} km, spread up to {60.0 * fastest_m_s:.1f} m/min: "
        f"{_vehicles(vehicles)} can see each part every {length_m / mean_m_s / vehicles:.0f} s; "
        f"the maximum unseen advance is {split.worst_advance_m:.0f} m{lapping}"
    )
    max_needed = 0
    if targets.max_revisit_s is not None:
        needed = vehicles_for_age(length_m, mean_m_s, targets.max_revisit_s)
        max_needed = max(max_needed, needed)
        text += f"; every {targets.max_revisit_s:g} s requires {_vehicles(needed)}"
    if targets.max_unseen_advance_m is not None:
        enough = vehicles_needed(
            ring.step_m, ring.spread_rate_m_s, mean_m_s, targets.max_unseen_advance_m
        )
        more = "" if enough is not None else "more than "
        needed = MAX_VEHICLES if enough is None else enough.lapping + enough.sweeping
        max_needed = max(max_needed, needed + (enough is None))
        text += f"; at most {targets.max_unseen_advance_m:g} m requires {more}{_vehicles(needed)}"
    return max_needed > vehicles, text


def _vehicles(count: int) -> str:
    return f"{count} vehicle" if count == 1 else f"{count} vehicles"


class TeamSizeAdviser:
    """An adviser that reports when the team changes, becomes too small, or becomes large enough.

    The team is checked every five minutes.
    """

    def __init__(self, targets: CoverageTargets) -> None:
        self._targets = targets
        self._last_advice: tuple[int, bool] | None = None
        self._next_s = -np.inf

    def is_due(self, vehicles: int, at_s: float) -> bool:
        """Return whether to check again, after five minutes or when the team has changed."""
        return at_s >= self._next_s or (
            self._last_advice is not None and self._last_advice[0] != vehicles
        )

    def advise(self, ring: FrontRing, speed_m_s: Floats, at_s: float) -> tuple[bool, str] | None:
        """Return whether there are too few vehicles, and advice as text, or None if unchanged."""
        self._next_s = at_s + ADVISE_EVERY_S
        too_few, text = team_size_advice(ring, speed_m_s, self._targets)
        last, self._last_advice = self._last_advice, (speed_m_s.size, too_few)
        return None if last == self._last_advice else (too_few, text)
