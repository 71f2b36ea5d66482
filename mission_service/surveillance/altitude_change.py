"""Computes whether an altitude change violates a volume around another aircraft. Pure.

The method is that of the altitude bands of NASA's DAIDALUS (reference manual, chapter on kinematic
bands; NASA/TM-2016-219067 describes the algorithms): the vehicle accelerates vertically to its
vertical rate, keeps it, and levels out at the new altitude. Its horizontal velocity stays the same.
"""

import math
from typing import NamedTuple

from mission_service.surveillance.well_clear import Encounter, WellClearVolume, violation

CHECK_S = 1.0  # interval of checks while the vertical speed changes
INSTANT_S = 1e-3  # length of the interval in which a violation at a single time is sought


class VerticalLimits(NamedTuple):
    """A vehicle's vertical rate and acceleration; if either is 0, the altitude changes at once."""

    rate_m_s: float
    acceleration_m_s2: float


class AltitudeChange:
    """The vertical motion to a new altitude.

    It overshoots only if the current climb rate is too high to level out in time.
    """

    def __init__(self, change_m: float, climb_m_s: float, limits: VerticalLimits) -> None:
        """Compute the motion from the altitude change and the current climb rate."""
        self._change_m, self._climb_m_s = change_m, climb_m_s
        rate_m_s, self._acceleration_m_s2 = limits
        if rate_m_s <= 0.0 or self._acceleration_m_s2 <= 0.0:
            self.instant, self.times_s = True, (0.0, 0.0, 0.0)
            return
        self.instant = False
        braked_m = climb_m_s * abs(climb_m_s) / (2.0 * self._acceleration_m_s2)
        self._up = math.copysign(1.0, change_m - braked_m)
        first_m_s, rise_m = self._up * climb_m_s, self._up * change_m
        peak_2 = self._acceleration_m_s2 * rise_m + first_m_s * first_m_s / 2.0
        self._peak_m_s = min(rate_m_s, math.sqrt(max(peak_2, 0.0)))
        begin_s = abs(self._peak_m_s - first_m_s) / self._acceleration_m_s2
        self._begun_m = begin_s * (first_m_s + self._peak_m_s) / 2.0
        level_s = self._peak_m_s / self._acceleration_m_s2
        steady_m = rise_m - self._begun_m - level_s * self._peak_m_s / 2.0
        steady_s = max(steady_m, 0.0) / self._peak_m_s if self._peak_m_s > 0.0 else 0.0
        # The ends of the initial acceleration, of the constant rate and of levelling out.
        self.times_s = (begin_s, begin_s + steady_s, begin_s + steady_s + level_s)

    def motion_after(self, later_s: float) -> tuple[float, float]:
        """Return the height above the initial altitude in m and the climb rate in m/s."""
        begin_s, steady_s, end_s = self.times_s
        if self.instant or later_s >= end_s:
            return self._change_m, 0.0
        if later_s <= begin_s:
            faster = math.copysign(
                self._acceleration_m_s2, self._peak_m_s - self._up * self._climb_m_s
            )
            climb_m_s = self._up * self._climb_m_s + faster * later_s
            mean_m_s = (self._up * self._climb_m_s + climb_m_s) / 2.0
            return self._up * later_s * mean_m_s, self._up * climb_m_s
        if later_s <= steady_s:
            rise_m = self._begun_m + (later_s - begin_s) * self._peak_m_s
            return self._up * rise_m, self._up * self._peak_m_s
        left_s = end_s - later_s
        left_m_s = left_s * self._acceleration_m_s2
        return self._change_m - self._up * left_s * left_m_s / 2.0, self._up * left_m_s


def violates(
    encounter: Encounter,
    change: AltitudeChange,
    climb_m_s: float,
    volume: WellClearVolume,
    horizon_s: float,
    lookahead_s: float,
) -> bool:
    """Return whether an altitude change violates a volume around an aircraft.

    Args:
        encounter: The current positions and velocities.
        change: The vertical motion of the own vehicle.
        climb_m_s: The current climb rate of the own vehicle.
        volume: The volume around the aircraft.
        horizon_s: Time after the change during which a violation counts. It also limits the time at
            the constant vertical rate.
        lookahead_s: Time from now after which no violation counts.
    """

    def moved(later_s: float) -> Encounter:
        up_m, own_m_s = change.motion_after(later_s)
        other_m_s = encounter.up_m_s + climb_m_s
        return Encounter(
            encounter.east_m + later_s * encounter.east_m_s,
            encounter.north_m + later_s * encounter.north_m_s,
            encounter.up_m + later_s * other_m_s - up_m,
            encounter.east_m_s,
            encounter.north_m_s,
            other_m_s - own_m_s,
        )

    def within(begin_s: float, end_s: float) -> bool:
        end_s = min(end_s, lookahead_s)
        if begin_s > end_s:
            return False
        return violation(moved(begin_s), volume, end_s - begin_s) is not None

    def at_steps(begin_s: float, end_s: float) -> bool:
        steps = range(math.ceil(begin_s / CHECK_S), math.floor(end_s / CHECK_S) + 1)
        times_s = (step * CHECK_S for step in steps if step * CHECK_S < lookahead_s)
        found = (violation(moved(at_s), volume, INSTANT_S) for at_s in times_s)
        return any(each is not None and each[0] == 0.0 for each in found)

    if change.instant:
        return within(0.0, horizon_s)
    begin_s, steady_s, end_s = change.times_s
    end_s += CHECK_S
    return (
        at_steps(0.0, begin_s)
        or within(begin_s, min(horizon_s + begin_s, steady_s))
        or at_steps(steady_s, end_s)
        or within(end_s, horizon_s + end_s)
    )
