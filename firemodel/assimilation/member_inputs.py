"""Draw and update the uncertain inputs of an ensemble's members: wind and spread rates.

A member's inputs are an error of the wind, and the logarithm of a factor of the spread rate in each
fuel. The wind error is a vector (true east, true north) in units of the reported speed, so that it
applies to each weather entry: as long as the reported direction stays the same, it is the same
factor and turn of the reported wind. In light winds the error does not vanish with the speed. The
vector does not turn with the reported wind, because it also represents errors of the fuel map and
held ground, which have fixed directions: a vector that turned gave larger errors of forecasts
(``benchmarks.estimate_twins``). A wind vector points in the direction from which the wind blows.
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

    # (members, 2) the vector (east, north) added to the reported wind, divided by its speed
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
        from_deg = np.array([entry.wind_from_deg for entry in reported])
        offset_m_s = np.outer(self.wind_error[number], np.maximum(speed_m_s, LIGHT_WIND_M_S))
        offset_m_s = np.clip(offset_m_s, -MAX_WIND_OFFSET_M_S, MAX_WIND_OFFSET_M_S)
        east, north = speed_m_s * unit_vector(from_deg) + offset_m_s
        turn_deg = np.degrees(np.arctan2(east, north)) - from_deg
        return np.hypot(east, north) / speed_m_s, turn_deg % 360.0


def with_some_wind(weather: WeatherStream) -> WeatherStream:
    """Return a stream with wind speeds of at least ``MIN_WIND_M_S``, to which factors apply."""
    entries = (
        replace(entry, wind_speed_m_s=max(entry.wind_speed_m_s, MIN_WIND_M_S))
        for entry in weather.entries
    )
    return WeatherStream(tuple(entries), weather.source)


def unit_vector(from_deg: float | Floats) -> Floats:
    """Return the unit vector (east, north) in the direction from which the wind blows."""
    from_rad = np.radians(from_deg)
    return np.stack([np.sin(from_rad), np.cos(from_rad)])


def members_of(draws: list[Draw], from_deg: float) -> Members:
    """Return the members for the drawn errors, with the reported wind direction.

    The moisture factor becomes a spread-rate factor: if the moisture of dead fuel rises by a small
    fraction, rates fall by about the same fraction (Rothermel 1972, for moistures of 5 to 10 %).
    """
    wind, rates = [], []
    for draw in draws:
        wind.append(draw.wind_factor * unit_vector(from_deg + draw.turn_deg))
        common = math.log(draw.spread_factor) - math.log(draw.moisture_factor)
        rates.append(common + np.log(draw.fuel_factors))
    return Members(np.array(wind) - unit_vector(from_deg), np.array(rates))


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
