"""Averages the airspeed of VFR_HUD messages, which arrive twice a second. Pure."""

import math

from autopilot_bridge.vehicle.client_events import Speed
from mission_service.events import AirspeedMeasured

AVERAGED_OVER_US = 10_000_000  # long enough to average gusts and turns
CHANGED_M_S = 0.5


class MeanAirspeed:
    """The mean airspeed of one vehicle."""

    def __init__(self) -> None:
        self._airspeeds_m_s: list[float] = []  # measured since the last mean
        self._from_us = 0
        self._reported_m_s = math.nan

    def new_report(self, speed: Speed, name: str, now_us: int) -> AirspeedMeasured | None:
        """Return the mean over the last ``AVERAGED_OVER_US`` if complete and changed, or None."""
        if speed.airspeed_m_s is None:
            return None
        if not self._airspeeds_m_s:
            self._from_us = now_us
        self._airspeeds_m_s.append(speed.airspeed_m_s)
        if now_us - self._from_us < AVERAGED_OVER_US:
            return None
        mean_m_s = round(math.fsum(self._airspeeds_m_s) / len(self._airspeeds_m_s), 1)
        self._airspeeds_m_s.clear()
        if abs(mean_m_s - self._reported_m_s) < CHANGED_M_S:
            return None
        self._reported_m_s = mean_m_s
        return AirspeedMeasured(now_us, name, mean_m_s)
