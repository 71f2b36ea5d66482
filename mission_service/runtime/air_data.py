"""Averages the airspeed from VFR_HUD, and estimates the wind and a plane's true airspeed. Pure.

A plane that changes its heading measures both: on every heading, the magnitude of its velocity
relative to the air is the true airspeed. The factor from measured to true airspeed depends on the
air density and the sensor error, which neither the standard atmosphere nor the autopilot's wind
estimate takes into account. An extended Kalman filter estimates three states from ground velocities
and airspeeds: the wind to the north, the wind to the east and this factor.
"""

import math

import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.stacks.return_flight import true_airspeed_factor
from autopilot_bridge.vehicle.client_events import Position, Speed
from mission_service.events import AirDataMeasured, AirspeedMeasured

Floats = NDArray[np.float64]

AVERAGED_OVER_US = 10_000_000  # long enough to average gusts and turns
CHANGED_M_S = 0.5

SAMPLE_EVERY_US, REPORT_EVERY_US = 1_000_000, 10_000_000
OLD_US = 1_000_000  # a velocity older than the airspeed by more than this is not used
GAP_US = 60_000_000  # after a longer gap the estimate is restarted
MIN_AIRSPEED_M_S = 8.0  # slower planes and hovering VTOLs measure no useful airspeed
WIND_SD_M_S, FACTOR_SD = 12.0, 0.05  # before the first sample
AIRSPEED_SD_M_S = 1.0  # of one sample: gusts and delays in turns
WIND_CHANGES_M_S, FACTOR_CHANGES = 0.03, 1e-4  # standard deviations of the changes in 1 s
OUTLIER_SDS = 4.0
KNOWN_WIND_SD_M_S, KNOWN_FACTOR_SD = 0.6, 0.01  # the estimate is reported once it is this accurate


class MeanAirspeed:
    """The mean airspeed of one vehicle."""

    def __init__(self) -> None:
        self._airspeeds_m_s: list[float] = []  # measured since the last mean
        self._from_us = 0
        self._reported_m_s = math.nan

    def new_report(self, speed: Speed, name: str, now_us: int) -> AirspeedMeasured | None:
        """Return a new mean every ``AVERAGED_OVER_US`` if it has changed; otherwise None."""
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


class AirData:
    """The estimate of wind and true airspeed for one vehicle."""

    def __init__(self) -> None:
        self._position: Position | None = None
        self._state: Floats | None = None
        self._covariance: Floats = np.zeros((3, 3))
        self._sampled_us = self._reported_us = 0

    def over_ground(self, position: Position) -> None:
        """Store the ground velocity that belongs to the next airspeed."""
        self._position = position

    def new_report(self, speed: Speed, name: str, now_us: int) -> AirDataMeasured | None:
        """Use the airspeed from a VFR_HUD message; return the estimate if it is due and known."""
        position = self._position
        if position is None or speed.airspeed_m_s is None:
            return None
        level = speed.airspeed_m_s**2 - speed.climb_m_s**2
        if speed.at_us - position.at_us > OLD_US or level < MIN_AIRSPEED_M_S**2:
            return None
        since_us = now_us - self._sampled_us
        if 0 <= since_us < SAMPLE_EVERY_US:
            return None
        if self._state is None or not 0 <= since_us <= GAP_US:
            self._begin(position)
        else:
            changes = (WIND_CHANGES_M_S, WIND_CHANGES_M_S, FACTOR_CHANGES)
            self._covariance += np.diag(np.square(changes)) * since_us / 1e6
        self._sampled_us = now_us
        self._update(position, math.sqrt(level))
        return self._due(name, now_us)

    def _begin(self, position: Position) -> None:
        factor = true_airspeed_factor(position.altitude_amsl_m)
        self._state = np.array([0.0, 0.0, factor])
        self._covariance = np.diag(np.square([WIND_SD_M_S, WIND_SD_M_S, FACTOR_SD]))

    def _update(self, position: Position, airspeed_m_s: float) -> None:
        """Update the filter with a measured airspeed and the ground velocity."""
        assert self._state is not None
        ground_m_s = np.array([position.velocity_north_m_s, position.velocity_east_m_s])
        through_air = ground_m_s - self._state[:2]
        speed_m_s = math.hypot(*through_air)
        if speed_m_s < 1.0:
            return
        slope = np.append(-through_air / speed_m_s, -airspeed_m_s)
        difference_m_s = speed_m_s - self._state[2] * airspeed_m_s
        spread = self._covariance @ slope
        variance = float(slope @ spread) + AIRSPEED_SD_M_S**2
        if difference_m_s**2 > OUTLIER_SDS**2 * variance:
            return
        self._state = self._state - spread * (difference_m_s / variance)
        self._covariance = self._covariance - np.outer(spread, spread) / variance

    def _due(self, name: str, now_us: int) -> AirDataMeasured | None:
        assert self._state is not None
        north_sd_m_s, east_sd_m_s, factor_sd = np.sqrt(np.diag(self._covariance))
        is_known = factor_sd <= KNOWN_FACTOR_SD
        is_known &= max(north_sd_m_s, east_sd_m_s) <= KNOWN_WIND_SD_M_S
        if not is_known or 0 <= now_us - self._reported_us < REPORT_EVERY_US:
            return None
        self._reported_us = now_us
        north_m_s, east_m_s, factor = map(float, self._state)
        from_deg = math.degrees(math.atan2(-east_m_s, -north_m_s)) % 360.0
        speed_m_s = round(math.hypot(north_m_s, east_m_s), 2)
        return AirDataMeasured(now_us, name, round(factor, 4), speed_m_s, round(from_deg, 1))
