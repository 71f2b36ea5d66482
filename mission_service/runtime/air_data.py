"""Averages the airspeed from VFR_HUD, and estimates the wind and a plane's true airspeed. Pure.

A plane that changes its heading measures both: on every heading, the magnitude of its velocity
relative to the air is the true airspeed. The factor from measured to true airspeed depends on the
air density and the sensor error, which neither the standard atmosphere nor the autopilot's wind
estimate takes into account. The wind to the north, the wind to the east and this factor are fitted
to the ground velocities and airspeeds of the last minutes by robust least squares (Gauss-Newton
steps with Huber's weights), in which older samples have less weight. The fit begins at several
winds, because two headings alone agree with two winds.
"""

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.stacks.return_flight import true_airspeed_factor
from autopilot_bridge.vehicle.client_events import Position, Speed
from mission_service.events import AirDataMeasured, AirspeedMeasured

Floats = NDArray[np.float64]

AVERAGED_OVER_US = 10_000_000  # long enough to average gusts and turns
CHANGED_M_S = 0.5

SAMPLE_EVERY_US, REPORT_EVERY_US = 1_000_000, 10_000_000
SAMPLES = 450
OLD_US = 1_000_000  # a velocity older than the airspeed by more than this is not used
GAP_US = 60_000_000  # after a longer gap the estimate is restarted
MIN_AIRSPEED_M_S = 8.0  # slower planes and hovering VTOLs measure no useful airspeed
WIND_SD_M_S, FACTOR_SD = 12.0, 0.05  # before the first sample
AIRSPEED_SD_M_S = 1.0  # of one sample: gusts and delays in turns
FORGOTTEN_S = 150.0  # the weight of a sample of this age is 1/e
OUTLIER_SDS = 2.0  # larger differences count linearly, not squared
KNOWN_WIND_SD_M_S, KNOWN_FACTOR_SD = 0.6, 0.01  # the estimate is reported once it is this accurate
STEPS, STEPS_AGAIN = 12, 4  # of the fit
SQUARED_STEPS = 4  # the first steps, in which all samples have their full weight
STARTS_M_S = ((0.0, 0.0), (12.0, 0.0), (-12.0, 0.0), (0.0, 12.0), (0.0, -12.0))  # north, east
CONVERGED, SAME_WIND_M_S = 0.05, 1.0
AMBIGUOUS_COST = 9.0  # another wind whose cost is this close to the least may be the true one


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
        # Time in s, ground velocity to the north and east, and airspeed in m/s.
        self._samples: deque[tuple[float, float, float, float]] = deque(maxlen=SAMPLES)
        self._sampled_us = self._fitted_us = 0
        self._found: Floats | None = None  # the last fit, from which the next one begins

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
        if not 0 <= since_us <= GAP_US:
            self._samples.clear()
            self._found = None
        self._sampled_us = now_us
        ground_m_s = (position.velocity_north_m_s, position.velocity_east_m_s)
        self._samples.append((now_us / 1e6, *ground_m_s, math.sqrt(level)))
        if 0 <= now_us - self._fitted_us < REPORT_EVERY_US:
            return None
        self._fitted_us = now_us
        standard_factor = true_airspeed_factor(position.altitude_amsl_m)
        self._found = fitted_air(np.array(self._samples), standard_factor, self._found)
        if self._found is None:
            return None
        north_m_s, east_m_s, factor = map(float, self._found)
        from_deg = math.degrees(math.atan2(-east_m_s, -north_m_s)) % 360.0
        speed_m_s = round(math.hypot(north_m_s, east_m_s), 2)
        return AirDataMeasured(now_us, name, round(factor, 4), speed_m_s, round(from_deg, 1))


def fitted_air(
    samples: Floats, standard_factor: float, before: Floats | None = None
) -> Floats | None:
    """Return the wind to the north and east, and the factor from measured to true airspeed.

    Args:
        samples: (n, 4) time in s, ground velocity to the north and east, and airspeed in m/s; the
            last sample is the newest.
        standard_factor: The factor in the standard atmosphere.
        before: An earlier result, from which the fit begins; otherwise several winds are tried.

    Returns:
        The three values; None if they are not accurate yet, or if several winds are possible.
    """
    north_m_s, east_m_s, airspeed_m_s = samples[:, 1], samples[:, 2], samples[:, 3]
    weights = np.exp((samples[:, 0] - samples[-1, 0]) / FORGOTTEN_S) / AIRSPEED_SD_M_S**2
    expected = np.array([0.0, 0.0, standard_factor])
    certainty = np.diag(np.array([WIND_SD_M_S, WIND_SD_M_S, FACTOR_SD]) ** -2)
    starts = [[*start, standard_factor] for start in STARTS_M_S] if before is None else [before]
    found = np.array(starts)  # (starts, 3)
    for number in range(STEPS if before is None else STEPS_AGAIN):
        north = north_m_s - found[:, :1]  # velocity through the air, (starts, samples)
        east = east_m_s - found[:, 1:2]
        speed_m_s = np.maximum(np.hypot(north, east), 1.0)
        off_m_s = speed_m_s - found[:, 2:] * airspeed_m_s
        robust = np.ones_like(off_m_s)
        if before is not None or number >= SQUARED_STEPS:
            limit_m_s = OUTLIER_SDS * AIRSPEED_SD_M_S
            robust = limit_m_s / np.maximum(np.abs(off_m_s), limit_m_s)
        weighted = weights * robust
        slopes = np.stack(
            [-north / speed_m_s, -east / speed_m_s, -np.broadcast_to(airspeed_m_s, north.shape)], 2
        )
        pulls = (slopes * weighted[:, :, None]).swapaxes(1, 2)
        information = pulls @ slopes + certainty
        push = (pulls @ off_m_s[:, :, None])[:, :, 0] + (found - expected) @ certainty
        step = np.linalg.solve(information, push[:, :, None])[:, :, 0]
        found = found - step
    capped_m_s = np.minimum(np.abs(off_m_s), OUTLIER_SDS * AIRSPEED_SD_M_S)
    costs = (weights * capped_m_s * (2.0 * np.abs(off_m_s) - capped_m_s)).sum(axis=1)
    costs += np.einsum("si,ij,sj->s", found - expected, certainty, found - expected)
    best = int(np.argmin(costs))
    elsewhere = np.hypot(*(found - found[best])[:, :2].T) > SAME_WIND_M_S
    ambiguous = bool((elsewhere & (costs < costs[best] + AMBIGUOUS_COST)).any())
    sds = np.sqrt(np.diag(np.linalg.inv(information[best])))
    known = bool(sds[2] <= KNOWN_FACTOR_SD and sds[:2].max() <= KNOWN_WIND_SD_M_S)
    if ambiguous or not known or np.abs(step[best]).max() > CONVERGED:
        return None
    return np.asarray(found[best])
