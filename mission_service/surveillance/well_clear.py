"""Computes when an aircraft violates a well clear volume if both continue straight on. Pure.

The volume is that of RTCA DO-365 with modified tau (WCV_TAUMOD in NASA's DAIDALUS). Source: Munoz,
Narkawicz, Chamberlain, Consiglio, Upchurch, "A Family of Well-Clear Boundary Models for the
Integration of UAS in the NAS", AIAA 2014-2412.
"""

import math
from typing import NamedTuple

STILL = 1e-9  # slower relative motion, in m/s or (m/s)^2, counts as zero

Interval = tuple[float, float]  # entry and exit, s from now


class WellClearVolume(NamedTuple):
    """The thresholds of a volume.

    The volume is violated if both conditions hold:

    - the distance is at most ``dthr_m``, or the predicted miss distance is at most ``dthr_m`` and
      modified tau is between 0 and ``tthr_s``;
    - the height difference is at most ``zthr_m``, or the time to equal heights is between 0 and
      ``tcoa_s``.
    """

    dthr_m: float
    zthr_m: float
    tthr_s: float = 0.0
    tcoa_s: float = 0.0


class Encounter(NamedTuple):
    """Position and velocity of an aircraft relative to the own vehicle."""

    east_m: float
    north_m: float
    up_m: float
    east_m_s: float
    north_m_s: float
    up_m_s: float

    @property
    def distance_m(self) -> float:
        """The horizontal distance."""
        return math.hypot(self.east_m, self.north_m)


def violation(encounter: Encounter, volume: WellClearVolume, lookahead_s: float) -> Interval | None:
    """Return when the volume is first violated and when it is left, from 0 to ``lookahead_s``.

    Returns None if there is no violation. A violation that lasts only an instant does not count.
    """
    vertical = _vertical(encounter.up_m, encounter.up_m_s, volume, lookahead_s)
    if vertical is None:
        return None
    begin_s, end_s = vertical
    horizontal = _horizontal(
        encounter.east_m + begin_s * encounter.east_m_s,
        encounter.north_m + begin_s * encounter.north_m_s,
        (encounter.east_m_s, encounter.north_m_s),
        volume,
        end_s - begin_s,
    )
    if horizontal is None or horizontal[1] - horizontal[0] <= STILL:
        return None
    return begin_s + horizontal[0], begin_s + horizontal[1]


def _vertical(up_m: float, up_m_s: float, volume: WellClearVolume, end_s: float) -> Interval | None:
    """Return the interval between 0 and ``end_s`` in which the vertical condition holds."""
    if abs(up_m_s) < STILL:
        return (0.0, end_s) if abs(up_m) <= volume.zthr_m else None
    # The condition begins to hold at the larger height difference on the near side, and ceases at
    # the threshold on the far side.
    near_m = max(volume.zthr_m, abs(up_m_s) * volume.tcoa_s)
    entry_s = (-math.copysign(near_m, up_m_s) - up_m) / up_m_s
    exit_s = (math.copysign(volume.zthr_m, up_m_s) - up_m) / up_m_s
    if exit_s < 0.0 or entry_s > end_s:
        return None
    return max(entry_s, 0.0), min(exit_s, end_s)


def _horizontal(
    east_m: float,
    north_m: float,
    velocity_m_s: tuple[float, float],
    volume: WellClearVolume,
    end_s: float,
) -> Interval | None:
    """Return the interval between 0 and ``end_s`` in which the horizontal condition holds."""
    east_m_s, north_m_s = velocity_m_s
    speed_2 = east_m_s * east_m_s + north_m_s * north_m_s
    closing = east_m * east_m_s + north_m * north_m_s  # negative while the aircraft approaches
    outside = east_m * east_m + north_m * north_m - volume.dthr_m**2
    if speed_2 < STILL:
        return (0.0, end_s) if outside <= 0.0 else None
    cross = east_m * north_m_s - north_m * east_m_s
    passes = volume.dthr_m**2 * speed_2 - cross * cross  # negative: misses the disc
    if outside > 0.0 and (closing >= 0.0 or passes < 0.0):
        return None
    exit_s = (math.sqrt(max(passes, 0.0)) - closing) / speed_2
    if outside <= 0.0:
        return 0.0, min(exit_s, end_s)
    # Modified tau, (dthr^2 - r^2) / (r . v), equals tthr at the roots of a quadratic in time.
    half = closing + volume.tthr_s * speed_2 / 2.0
    root = half * half - speed_2 * (outside + volume.tthr_s * closing)
    entry_s = (-half - math.sqrt(max(root, 0.0))) / speed_2
    if root < 0.0 or entry_s > end_s:
        return None
    return max(entry_s, 0.0), min(exit_s, end_s)
