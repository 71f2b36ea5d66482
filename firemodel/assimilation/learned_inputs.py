"""Learn the errors of wind and spread rates from the places at which a front is observed. Pure.

An extended Kalman filter estimates the logarithms of a rate factor of all fuels, of a factor of the
wind speed and of a rate factor of each fuel, and the angle by which the wind is turned. When a part
of the front comes into view after it has advanced by A out of view, its distance from the estimated
front is A times the relative error of its speed. The sensitivity of that speed to the inputs comes
from the spread model at this part of the front. The error is therefore attributed to the inputs on
which the speed depends there, and changes the speed of all other parts accordingly.

Reference: A. H. Jazwinski, Stochastic Processes and Filtering Theory, 1970 (extended Kalman
filter).
"""

import copy
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import WeatherStream
from firemodel.spread.front_rates import FrontRates
from firemodel.spread.local_spread import burnable_codes

Integers = NDArray[np.int64]

# Standard deviations of the inputs before the first observation, and of their random walk in an
# hour: rate of all fuels, wind speed (logarithms), wind direction (rad), rate of one fuel.
PRIOR = (0.3, 0.3, 0.35, 0.3)
DRIFT_HOUR = (0.1, 0.2, 0.25, 0.0)
POSITION_SD_CELLS = 0.6  # of an observed front, and of the estimate within a cell
MODEL_ERROR = 0.3  # error of an advance for other reasons, as a share of the advance
MIN_ADVANCE_CELLS = 0.3  # after a shorter advance nothing is learned
MAX_STEP_SD = 3.0  # larger differences count as this many standard deviations
MIN_RATE, MAX_RATE = 0.1, 10.0
LARGER, TURNED_RAD = 1.1, math.radians(10.0)  # changes of the wind for the sensitivities
RATE, SPEED, TURN, FIRST_FUEL = 0, 1, 2, 3  # places in the state; the other fuels follow


class FrontParts(NamedTuple):
    """Parts of the estimated front (n): cells, normals to the unburned side on the grid."""

    rows: Integers
    cols: Integers
    north: Floats
    east: Floats


class LearnedInputs:
    """The estimated errors of the inputs of a fire.

    ``state`` has 3 + fuels elements, ``covariance`` is (3 + fuels, 3 + fuels).
    """

    def __init__(self, landscape: Landscape, at_s: float) -> None:
        """Begin with the reported inputs."""
        self._landscape = landscape
        self._codes = np.array(burnable_codes(landscape))
        self.state = np.zeros(3 + self._codes.size)
        self.covariance = np.diag(self._spread(PRIOR) ** 2)
        self._at_s = at_s
        # Rates in the weather of the last call.
        self._rates: tuple[WeatherStream, FrontRates] | None = None

    def _spread(self, values: tuple[float, float, float, float]) -> Floats:
        return np.array([*values[:3], *[values[3]] * self._codes.size])

    def copy(self) -> "LearnedInputs":
        """Return an independent copy."""
        found = copy.copy(self)
        found.state, found.covariance = self.state.copy(), self.covariance.copy()
        return found

    def __getstate__(self) -> dict[str, object]:
        """Return the attributes for a snapshot."""
        return {**vars(self), "_rates": None}

    def forget_wind(self) -> None:
        """Discard the errors of the wind, after a new report of the wind."""
        for place, sd in ((SPEED, PRIOR[1]), (TURN, PRIOR[2])):
            self.state[place] = 0.0
            self.covariance[place], self.covariance[:, place] = 0.0, 0.0
            self.covariance[place, place] = sd * sd

    def speeds_m_s(self, parts: FrontParts, weather: WeatherStream, at_s: float) -> Floats:
        """Return the speeds (n) of parts of a front with the learned inputs."""
        return self._speeds(parts, weather, at_s, self.state)

    def speed_sds_m_s(
        self, parts: FrontParts, speeds_m_s: Floats, weather: WeatherStream, at_s: float
    ) -> Floats:
        """Return the standard deviations (n) of the speeds (n) of parts of a front."""
        change = self.sensitivities(parts, weather, at_s)
        variance = np.einsum("ni,ij,nj->n", change, self.covariance, change)
        return np.asarray(speeds_m_s * np.sqrt(np.maximum(variance, 0.0) + MODEL_ERROR**2))

    def sensitivities(self, parts: FrontParts, weather: WeatherStream, at_s: float) -> Floats:
        """Return the change (n, state) of the logarithm of the speed with each element."""
        found = np.zeros((parts.rows.size, self.state.size))
        speed = np.maximum(self._speeds(parts, weather, at_s, self.state), 1e-9)
        for place, step in ((SPEED, math.log(LARGER)), (TURN, TURNED_RAD)):
            changed = self.state.copy()
            changed[place] += step
            other = np.maximum(self._speeds(parts, weather, at_s, changed), 1e-9)
            found[:, place] = np.log(other / speed) / step
        found[:, RATE] = 1.0
        found[:, 3:] = self._fuels(parts)[:, None] == np.arange(self._codes.size)
        return found

    def _fuels(self, parts: FrontParts) -> Integers:
        """Return the place (n) of each part's fuel among the burnable ones; -1 for others."""
        fuel = self._landscape.fuel_model[parts.rows, parts.cols]
        place = np.searchsorted(self._codes, fuel)
        place[place == self._codes.size] = 0
        return np.where(self._codes[place] == fuel, place, -1)

    def _speeds(
        self, parts: FrontParts, weather: WeatherStream, at_s: float, state: Floats
    ) -> Floats:
        if self._rates is None or self._rates[0] is not weather:
            self._rates = weather, FrontRates(self._landscape, weather)
        reported = weather.weather_at(at_s)
        wind = (
            reported.wind_speed_m_s * math.exp(state[SPEED]),
            reported.wind_from_deg + math.degrees(state[TURN]),
        )
        rate = np.exp(state[RATE] + np.append(state[3:], 0.0)[self._fuels(parts)])
        return np.asarray(rate * self._rates[1].under_wind(*parts, at_s, wind))

    def learn(
        self,
        parts: FrontParts,
        advance_cells: Floats,
        ahead_cells: Floats,
        groups: Integers,
        weather: WeatherStream,
        at_s: float,
    ) -> None:
        """Update the inputs from parts of the front that came into view.

        Args:
            parts: The parts of the estimated front.
            advance_cells: (n) their estimated advance since they were last in view.
            ahead_cells: (n) the distance of the observed front ahead of the estimated one.
            groups: (n) parts with the same number are one measurement.
            weather: The reported weather.
            at_s: The time of the observation.
        """
        elapsed_s, self._at_s = max(at_s - self._at_s, 0.0), max(at_s, self._at_s)
        drift = self._spread(DRIFT_HOUR)
        self.covariance = self.covariance + np.diag(drift * drift * elapsed_s / 3600.0)
        if not parts.rows.size:
            return
        change = advance_cells[:, None] * self.sensitivities(parts, weather, at_s)
        before = self.state.copy()
        for group in np.unique(groups).tolist():
            own = groups == group
            advance = float(advance_cells[own].mean())
            if advance >= MIN_ADVANCE_CELLS:
                self._update(
                    float(ahead_cells[own].mean()), advance, change[own].mean(axis=0), before
                )
        low, high = math.log(MIN_RATE), math.log(MAX_RATE)
        self.state = np.clip(self.state, low, high)

    def _update(self, ahead: float, advance: float, change: Floats, before: Floats) -> None:
        """Update the state by one measurement; ``change`` (state) is its sensitivity in cells."""
        gain = self.covariance @ change
        noise = POSITION_SD_CELLS**2 + (MODEL_ERROR * advance) ** 2
        variance = float(change @ gain) + noise
        off = ahead - float(change @ (self.state - before))
        limit = MAX_STEP_SD * math.sqrt(variance)
        self.state = self.state + gain * (min(max(off, -limit), limit) / variance)
        self.covariance = self.covariance - np.outer(gain, gain) / variance
