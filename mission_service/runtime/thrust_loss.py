"""Detects a failed engine from VFR_HUD: a loss of height and airspeed at full throttle. Pure.

Neither PX4 1.17 nor ArduPlane 4.6 reports a failed engine: both continue their mission at full
throttle, sink, and lose airspeed. A plane that levels off or descends fast gains airspeed.
"""

import math
from collections import deque

from autopilot_bridge.vehicle.client_events import Speed
from mission_service.events import ThrustStatusChanged

FULL_THROTTLE_PERCENT, SINKING_M_S, SLOWER_M_S = 75, 1.0, 1.5
# The airspeed is compared with its mean over this period. Values measured while the vehicle sinks
# at full throttle are left out, because they would hide a slow loss.
SLOWER_THAN_US = 10_000_000
CLIMB_OVER_US = 2_000_000  # long enough to average gusts
SINKING_FOR_US = 1_000_000
RECOVERED_FOR_US = 10_000_000


class ThrustMonitor:
    """The thrust status of one vehicle."""

    def __init__(self) -> None:
        self._airspeeds: deque[tuple[int, float]] = deque()  # mission time and airspeed
        self._climbs: deque[tuple[int, float]] = deque()  # mission time and climb rate
        self._sufficient = True
        self._otherwise_since_us: int | None = None  # time since which the status differs

    def new_report(self, speed: Speed, name: str, now_us: int) -> ThrustStatusChanged | None:
        """Return the new status of a vehicle if a VFR_HUD message changes the status, or None."""
        _add(self._climbs, speed.climb_m_s, now_us, CLIMB_OVER_US)
        climb_m_s = _mean(self._climbs)
        full_throttle = speed.throttle_percent >= FULL_THROTTLE_PERCENT
        slower = self._is_slower(speed.airspeed_m_s, now_us, full_throttle and climb_m_s < 0.0)
        sinks = full_throttle and climb_m_s <= -SINKING_M_S
        if self._sufficient and not slower:
            sinks = False
        if sinks != self._sufficient:  # the last reported status is still correct
            self._otherwise_since_us = None
            return None
        if self._otherwise_since_us is None:
            self._otherwise_since_us = now_us
        min_us = SINKING_FOR_US if sinks else RECOVERED_FOR_US
        if now_us - self._otherwise_since_us < min_us:
            return None
        self._sufficient, self._otherwise_since_us = not sinks, None
        throttle_percent, climb_m_s = speed.throttle_percent, round(climb_m_s, 1)
        return ThrustStatusChanged(now_us, name, not sinks, throttle_percent, climb_m_s)

    def _is_slower(self, airspeed_m_s: float | None, now_us: int, sinks: bool) -> bool:
        """Return whether the vehicle has lost airspeed; True if no airspeed is measured."""
        if airspeed_m_s is None:
            return True
        before_m_s = _mean(self._airspeeds)
        if not sinks:
            _add(self._airspeeds, airspeed_m_s, now_us, SLOWER_THAN_US)
        return airspeed_m_s <= before_m_s - SLOWER_M_S


def _add(values: deque[tuple[int, float]], value: float, now_us: int, over_us: int) -> None:
    """Append a value and remove the values that are older than ``over_us``."""
    values.append((now_us, value))
    while values[0][0] < now_us - over_us:
        values.popleft()


def _mean(values: deque[tuple[int, float]]) -> float:
    """Return the mean value of (time, value) pairs; NaN without pairs."""
    return math.fsum(value for _, value in values) / len(values) if values else math.nan
