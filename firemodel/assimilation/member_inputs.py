"""Draw and update the uncertain inputs of an ensemble's members: wind and spread rates.

A member's inputs are an error of the wind, and the logarithm of a factor of the spread rate in each
fuel. The wind error is a vector along and across the reported wind, in units of its speed.
Therefore one error applies to all weather entries: in each entry it is the same factor and turn of
the reported wind, except in light winds, where an error in proportion to the speed would vanish.
The ensemble Kalman filter (Evensen 1994; with perturbed observations, Burgers et al. 1998) updates
these inputs from observations.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from firemodel.arrays import Floats
from firemodel.ensemble.draws import Draw
from firemodel.physics.weather import Weather, WeatherStream

MIN_WIND_M_S = 0.1  # lower limit of the reported wind, by which members' winds are divided
LIGHT_WIND_M_S = 2.0  # below this reported speed, errors are as large as at this speed
MAX_LOG_RATE = 2.0  # limit of ln of a spread-rate factor (7.4)
MAX_WIND_ERROR = 3.0  # limit of the components of a wind error, in units of the reported speed
MAX_WIND_OFFSET_M_S = 15.0
# Standard deviations of the random changes of the inputs in one hour. These changes represent a
# changing wind and keep the members different.
WIND_WALK_M_S = 0.4
RATE_WALK_LOG = 0.08


class Members(NamedTuple):
    """The uncertain inputs of an ensemble."""

    # (members, 2) the vector (along the reported wind, across it to the right) added to the
    # reported wind, divided by its speed
    wind_error: Floats
    log_rate: Floats  # (members, fuels) logarithm of the factors of the spread rate

    @property
    def size(self) -> int:
        """The number of members."""
        return len(self.wind_error)

    def wind_changes(self, number: int, reported: Sequence[Weather]) -> tuple[Floats, Floats]:
        """Return the factors and clockwise turns in degrees of a member's wind in each entry.

        ``reported`` are entries of a stream returned by ``with_some_wind``.
        """
        speed_m_s = np.array([entry.wind_speed_m_s for entry in reported])
        offset_m_s = np.outer(self.wind_error[number], np.maximum(speed_m_s, LIGHT_WIND_M_S))
        along, across = np.clip(offset_m_s, -MAX_WIND_OFFSET_M_S, MAX_WIND_OFFSET_M_S)
        along += speed_m_s
        return np.hypot(along, across) / speed_m_s, np.degrees(np.arctan2(across, along))


def with_some_wind(weather: WeatherStream) -> WeatherStream:
    """Return a stream with wind speeds of at least ``MIN_WIND_M_S``, to which factors apply."""
    entries = (
        replace(entry, wind_speed_m_s=max(entry.wind_speed_m_s, MIN_WIND_M_S))
        for entry in weather.entries
    )
    return WeatherStream(tuple(entries), weather.source)


def members_of(draws: list[Draw]) -> Members:
    """Return the members for the drawn errors.

    The moisture factor becomes a spread-rate factor: if the moisture of dead fuel rises by a small
    fraction, rates fall by about the same fraction (Rothermel 1972, for moistures of 5 to 10 %).
    """
    wind, rates = [], []
    for draw in draws:
        turn_rad = math.radians(draw.turn_deg)
        along, across = math.cos(turn_rad), math.sin(turn_rad)
        wind.append([draw.wind_factor * along - 1.0, draw.wind_factor * across])
        common = math.log(draw.spread_factor) - math.log(draw.moisture_factor)
        rates.append(common + np.log(draw.fuel_factors))
    return Members(np.array(wind), np.array(rates))


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
    inputs = np.hstack([members.wind_error, members.log_rate])
    deviation = inputs - inputs.mean(axis=0)
    spread_m = excess_m - excess_m.mean(axis=0)
    freedom = max(members.size - 1, 1)
    covariance = spread_m.T @ spread_m / freedom + np.diag(error_sd_m**2)
    gain = np.linalg.solve(covariance, spread_m.T @ deviation / freedom)
    noise = rng.standard_normal(excess_m.shape) * error_sd_m
    inputs = inputs - (excess_m + noise - noise.mean(axis=0)) @ gain
    return bounded(Members(inputs[:, :2], inputs[:, 2:]))


def walked(members: Members, for_s: float, reported: Weather, rng: np.random.Generator) -> Members:
    """Return the members after random changes of their inputs during ``for_s`` seconds."""
    share = math.sqrt(max(for_s, 0.0) / 3600.0)
    walk = WIND_WALK_M_S / max(reported.wind_speed_m_s, LIGHT_WIND_M_S)
    wind = rng.standard_normal(members.wind_error.shape) * walk * share
    rate = rng.standard_normal(members.log_rate.shape) * RATE_WALK_LOG * share
    return bounded(Members(members.wind_error + wind, members.log_rate + rate))


def bounded(members: Members) -> Members:
    """Return the members with their inputs limited to the bounds."""
    return Members(
        np.clip(members.wind_error, -MAX_WIND_ERROR, MAX_WIND_ERROR),
        np.clip(members.log_rate, -MAX_LOG_RATE, MAX_LOG_RATE),
    )
