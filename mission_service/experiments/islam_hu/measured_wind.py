"""Simulate wind measurements by a small vehicle: the fire's wind at flight height, with errors."""

import math

import numpy as np

from firemodel.physics.weather import WeatherStream

# Errors of wind estimates from airspeed and ground speed: standard deviations, correlation time.
SPEED_ERROR_M_S, DIRECTION_ERROR_DEG, LASTING_S = 0.8, 8.0, 120.0
# Ratio of the wind 20 ft above the vegetation to the wind at the vehicle's height.
WIND_20FT_SHARE = 0.75


class MeasuredWind:
    """A seeded series of measurements, whose times must increase."""

    def __init__(self, weather: WeatherStream, seed: int) -> None:
        self._weather = weather
        self._rng = np.random.default_rng(seed)
        self._error = self._rng.standard_normal(2)
        self._at_s: float | None = None

    def wind_at(self, at_s: float) -> tuple[float, float]:
        """Return the wind speed in m/s at the vehicle's height, and the wind direction.

        The wind blows from this direction, in degrees clockwise from north.
        """
        if self._at_s is not None:
            kept = math.exp(-(at_s - self._at_s) / LASTING_S)
            fresh = math.sqrt(1.0 - kept * kept)
            self._error = kept * self._error + fresh * self._rng.standard_normal(2)
        self._at_s = at_s
        now = self._weather.weather_at(at_s)
        speed_m_s = now.wind_speed_m_s / WIND_20FT_SHARE + SPEED_ERROR_M_S * self._error[0]
        from_deg = now.wind_from_deg + DIRECTION_ERROR_DEG * self._error[1]
        return max(float(speed_m_s), 0.0), float(from_deg) % 360.0
