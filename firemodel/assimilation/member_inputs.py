"""Draw and update the uncertain inputs of an ensemble's members: wind and spread rates.

A member's inputs are a vector in m/s that is added to the reported wind, and the logarithm of a
factor of the spread rate in each fuel. A wind vector (true east, true north) points in the
direction from which the wind blows. The ensemble Kalman filter (Evensen 1994; with perturbed
observations, Burgers et al. 1998) updates these inputs from observations.
"""

import math
from typing import NamedTuple

import numpy as np

from firemodel.arrays import Floats
from firemodel.ensemble.draws import Draw
from firemodel.physics.weather import Weather

MIN_WIND_M_S = 0.1  # lower limit of the reported wind, by which members' winds are divided
MAX_LOG_RATE = 2.0  # limit of ln of a spread-rate factor (7.4)
MAX_WIND_OFFSET_M_S = 15.0
# Standard deviations of the random changes of the inputs in one hour. These changes represent a
# changing wind and keep the members different.
WIND_WALK_M_S = 0.4
RATE_WALK_LOG = 0.08


class Members(NamedTuple):
    """The uncertain inputs of an ensemble."""

    wind_m_s: Floats  # (members, 2) the vector (east, north) added to the reported wind
    log_rate: Floats  # (members, fuels) logarithm of the factors of the spread rate

    @property
    def size(self) -> int:
        """The number of members."""
        return len(self.wind_m_s)

    def wind_change(self, number: int, reported: Weather) -> tuple[float, float]:
        """Return the factor and the clockwise turn in degrees of a member's wind."""
        speed = speed_m_s(reported)
        east, north = wind_vector(speed, reported.wind_from_deg) + self.wind_m_s[number]
        turn_deg = math.degrees(math.atan2(east, north)) - reported.wind_from_deg
        return math.hypot(east, north) / speed, turn_deg % 360.0


def speed_m_s(reported: Weather) -> float:
    """Return the reported wind speed, at least ``MIN_WIND_M_S``."""
    return max(reported.wind_speed_m_s, MIN_WIND_M_S)


def wind_vector(wind_m_s: float, from_deg: float) -> Floats:
    """Return the vector (east, north) in m/s that points in the direction the wind comes from."""
    from_rad = math.radians(from_deg)
    return wind_m_s * np.array([math.sin(from_rad), math.cos(from_rad)])


def members_of(draws: list[Draw], reported: Weather) -> Members:
    """Return the members for the drawn errors, in the reported weather.

    The moisture factor becomes a spread-rate factor: if the moisture of dead fuel rises by a small
    fraction, rates fall by about the same fraction (Rothermel 1972, for moistures of 5 to 10 %).
    """
    wind, rates = [], []
    for draw in draws:
        from_deg = reported.wind_from_deg + draw.turn_deg
        wind.append(wind_vector(speed_m_s(reported) * draw.wind_factor, from_deg))
        common = math.log(draw.spread_factor) - math.log(draw.moisture_factor)
        rates.append(common + np.log(draw.fuel_factors))
    given = wind_vector(speed_m_s(reported), reported.wind_from_deg)
    return Members(np.array(wind) - given, np.array(rates))


def updated(
    members: Members, excess_m: Floats, error_sd_m: Floats, rng: np.random.Generator
) -> Members:
    """Return the members after an update from observed distances.

    Args:
        members: The members before the update.
        excess_m: (members, observations) the distance in m of each member's front ahead of the
            observed front.
        error_sd_m: (observations) the standard deviations of the errors in these distances.
        rng: The random generator.
    """
    inputs = np.hstack([members.wind_m_s, members.log_rate])
    deviation = inputs - inputs.mean(axis=0)
    spread_m = excess_m - excess_m.mean(axis=0)
    freedom = max(members.size - 1, 1)
    covariance = spread_m.T @ spread_m / freedom + np.diag(error_sd_m**2)
    gain = np.linalg.solve(covariance, spread_m.T @ deviation / freedom)
    noise = rng.standard_normal(excess_m.shape) * error_sd_m
    inputs = inputs - (excess_m + noise - noise.mean(axis=0)) @ gain
    return bounded(Members(inputs[:, :2], inputs[:, 2:]))


def walked(members: Members, for_s: float, rng: np.random.Generator) -> Members:
    """Return the members after random changes of their inputs during ``for_s`` seconds."""
    share = math.sqrt(max(for_s, 0.0) / 3600.0)
    wind = rng.standard_normal(members.wind_m_s.shape) * WIND_WALK_M_S * share
    rate = rng.standard_normal(members.log_rate.shape) * RATE_WALK_LOG * share
    return bounded(Members(members.wind_m_s + wind, members.log_rate + rate))


def bounded(members: Members) -> Members:
    """Return the members with their inputs limited to the bounds."""
    return Members(
        np.clip(members.wind_m_s, -MAX_WIND_OFFSET_M_S, MAX_WIND_OFFSET_M_S),
        np.clip(members.log_rate, -MAX_LOG_RATE, MAX_LOG_RATE),
    )
