"""Learn the errors in wind and spread rates from the observed positions of a front.

An extended Kalman filter estimates the error in the wind direction, the logarithm of a factor of
the wind speed, and the logarithms of factors of the spread rate: one for all fuels, one for each
fuel, and one for each block of cells. A block represents a local error in the fuel map or the
terrain. When a part of the front comes into view after advancing by A out of view, the distance
between the observed and the estimated front is A times the relative error in the estimated speed.
The sensitivity of that speed to the inputs comes from the spread model at this part of the front.
The error is therefore attributed to the inputs on which the speed depends there, and changes the
speed of all other parts accordingly.

Reference: A. H. Jazwinski, Stochastic Processes and Filtering Theory, 1970 (extended Kalman
filter).
"""

import copy
import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import WeatherStream
from firemodel.spread.front_rates import FrontRates
from firemodel.spread.rate_options import SURFACE_ONLY, RateOptions

Integers = NDArray[np.int64]

# Standard deviations of the inputs before the first observation, and of their random walk over one
# hour: rate of all fuels, wind speed (logarithms), wind direction (rad), rate of one fuel, rate in
# a block.
PRIOR = (0.3, 0.3, 0.35, 0.3, 0.5)
DRIFT_HOUR = (0.1, 0.2, 0.25, 0.0, 0.2)
BLOCK_CELLS, MAX_BLOCKS = 8, 20  # smallest side of a block; largest number of blocks along the grid
ALIKE_CELLS = 8.0  # correlation length of the blocks' errors
# Error in a distance between an estimated and an observed front: the positions of both fronts, and
# the position at which the front was last observed, are known to within about a cell. With a
# smaller value, the filter would learn from this noise.
POSITION_SD_CELLS = 1.4
MODEL_ERROR = 0.2  # error of an advance for other reasons, as a fraction of the advance
MIN_ADVANCE_CELLS = 0.3  # nothing is learned from a shorter advance
MAX_STEP_SD = 3.0  # larger differences count as this many standard deviations
MIN_RATE, MAX_RATE = 0.1, 10.0
LARGER, TURNED_RAD = 1.1, math.radians(10.0)  # changes of the wind to compute sensitivities
RATE, SPEED, TURN, FIRST_FUEL = 0, 1, 2, 3  # indices in the state; fuels and blocks follow


class FrontParts(NamedTuple):
    """Parts of the estimated front (n): cells, and normals (on the grid) to the unburned side."""

    rows: Integers
    cols: Integers
    north: Floats
    east: Floats


class LearnedInputs:
    """The estimated errors of the inputs of a fire.

    ``state`` (n) has 3 + fuels + blocks elements; ``covariance`` is (n, n).
    """

    def __init__(
        self, landscape: Landscape, at_s: float, options: RateOptions = SURFACE_ONLY
    ) -> None:
        """Begin with the reported inputs."""
        self._landscape = landscape
        self._options = options
        self._codes = np.array(landscape.burnable_codes)
        rows, cols = landscape.shape
        self._side = max(BLOCK_CELLS, -(-max(rows, cols) // MAX_BLOCKS))
        self._blocks = (-(-rows // self._side), -(-cols // self._side))
        self.state = np.zeros(FIRST_FUEL + self._codes.size + math.prod(self._blocks))
        self.covariance = self._covariance(PRIOR)
        self._at_s = at_s
        # Spread rates in the weather of the last call.
        self._rates: tuple[WeatherStream, FrontRates] | None = None

    def _covariance(self, sds: tuple[float, ...]) -> Floats:
        """Return the covariance for these ``sds``; errors of nearby blocks are correlated."""
        fuels, blocks = self._codes.size, math.prod(self._blocks)
        found = np.zeros((FIRST_FUEL + fuels + blocks,) * 2)
        np.fill_diagonal(
            found, np.array([*sds[:FIRST_FUEL], *[sds[3]] * fuels, *[0.0] * blocks]) ** 2
        )
        found[-blocks:, -blocks:] = sds[4] ** 2 * _block_correlation(self._blocks, self._side)
        return found

    def copy(self) -> "LearnedInputs":
        """Return an independent copy."""
        found = copy.copy(self)
        found.state, found.covariance = self.state.copy(), self.covariance.copy()
        return found

    def __getstate__(self) -> dict[str, object]:
        """Return the attributes for a snapshot, without the stored spread rates."""
        return {**vars(self), "_rates": None}

    def forget_wind(self) -> None:
        """Discard the wind errors after a new wind report."""
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
        """Return the standard deviations (n) of the speeds (n) at which parts of a front move."""
        places, change = self.sensitivities(parts, weather, at_s)
        covariance = self.covariance[places[:, :, None], places[:, None, :]]
        variance = np.einsum("ni,nij,nj->n", change, covariance, change)
        return np.asarray(speeds_m_s * np.sqrt(np.maximum(variance, 0.0) + MODEL_ERROR**2))

    def sensitivities(
        self, parts: FrontParts, weather: WeatherStream, at_s: float
    ) -> tuple[Integers, Floats]:
        """Return the derivatives of the speed's logarithm with respect to the inputs.

        Returns:
            The indices (n, 5) in the state of the five inputs on which the speed depends, and the
            derivatives (n, 5). On ground that does not burn, the derivative with respect to the
            rate of a fuel is 0.
        """
        speed = np.maximum(self._speeds(parts, weather, at_s, self.state), 1e-9)
        fuel = self._fuels(parts)
        places = np.zeros((parts.rows.size, 5), dtype=np.int64)
        found = np.ones((parts.rows.size, 5))
        places[:, 1], places[:, 2] = SPEED, TURN
        places[:, 3], places[:, 4] = FIRST_FUEL + np.maximum(fuel, 0), self._block_places(parts)
        found[:, 3] = fuel >= 0
        for column, place, step in ((1, SPEED, math.log(LARGER)), (2, TURN, TURNED_RAD)):
            changed = self.state.copy()
            changed[place] += step
            other = np.maximum(self._speeds(parts, weather, at_s, changed), 1e-9)
            found[:, column] = np.log(other / speed) / step
        return places, found

    def _block_places(self, parts: FrontParts) -> Integers:
        """Return the index (n) in the state of each part's block."""
        block = parts.rows // self._side * self._blocks[1] + parts.cols // self._side
        return np.asarray(FIRST_FUEL + self._codes.size + block)

    def fuel_log_rates(self, state: Floats) -> Floats:
        """Return the logarithm of the rate factor (fuels) of each burnable fuel in a state."""
        return np.asarray(state[RATE] + state[FIRST_FUEL : FIRST_FUEL + self._codes.size])

    def cell_rates(self) -> Floats:
        """Return, for each cell, the rate factor (y, x) of its block."""
        blocks = np.exp(self.state[FIRST_FUEL + self._codes.size :]).reshape(self._blocks)
        rows, cols = self._landscape.shape
        cells = np.kron(blocks, np.ones((self._side, self._side)))[:rows, :cols]
        return np.asarray(cells, dtype=np.float64)

    def _fuels(self, parts: FrontParts) -> Integers:
        """Return the index (n) of each part's fuel among the burnable fuels; -1 for other fuels."""
        fuel = self._landscape.fuel_model[parts.rows, parts.cols]
        place = np.searchsorted(self._codes, fuel)
        place[place == self._codes.size] = 0
        return np.where(self._codes[place] == fuel, place, -1)

    def _speeds(
        self, parts: FrontParts, weather: WeatherStream, at_s: float, state: Floats
    ) -> Floats:
        if self._rates is None or self._rates[0] is not weather:
            self._rates = weather, FrontRates(self._landscape, weather, self._options)
        reported = weather.weather_at(at_s)
        wind = (
            reported.wind_speed_m_s * math.exp(state[SPEED]),
            reported.wind_from_deg + math.degrees(state[TURN]),
        )
        log_rate = np.append(self.fuel_log_rates(state), 0.0)[self._fuels(parts)]
        rate = np.exp(log_rate + state[self._block_places(parts)])
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
        """Update the inputs from parts of the front that have come into view.

        Args:
            parts: The parts of the estimated front.
            advance_cells: (n) the estimated advance of the parts since they were last in view.
            ahead_cells: (n) the distance of the observed front ahead of the estimated front.
            groups: (n) parts with the same number form one measurement.
            weather: The reported weather.
            at_s: The time of the observation.
        """
        elapsed_s, self._at_s = max(at_s - self._at_s, 0.0), max(at_s, self._at_s)
        self.covariance = self.covariance + elapsed_s / 3600.0 * self._covariance(DRIFT_HOUR)
        if not parts.rows.size:
            return
        places, change = self.sensitivities(parts, weather, at_s)
        change = advance_cells[:, None] * change
        before = self.state.copy()
        for group in np.unique(groups).tolist():
            own = groups == group
            advance = float(advance_cells[own].mean())
            if advance >= MIN_ADVANCE_CELLS:
                changes = np.zeros(self.state.size)
                np.add.at(changes, places[own], change[own] / np.count_nonzero(own))
                self._update(float(ahead_cells[own].mean()), advance, changes, before)
        low, high = math.log(MIN_RATE), math.log(MAX_RATE)
        self.state = np.clip(self.state, low, high)

    def _update(self, ahead: float, advance: float, change: Floats, before: Floats) -> None:
        """Update the state with one measurement; ``change`` (state) is the sensitivity in cells."""
        gain = self.covariance @ change
        noise = POSITION_SD_CELLS**2 + (MODEL_ERROR * advance) ** 2
        variance = float(change @ gain) + noise
        off = ahead - float(change @ (self.state - before))
        limit = MAX_STEP_SD * math.sqrt(variance)
        self.state = self.state + gain * (min(max(off, -limit), limit) / variance)
        self.covariance = self.covariance - np.outer(gain, gain) / variance


@lru_cache(maxsize=4)
def _block_correlation(blocks: tuple[int, int], side: int) -> Floats:
    """Return the error correlation (n, n) between blocks (rows, columns) of ``side`` cells."""
    row, col = (side * each.ravel() for each in np.indices(blocks))
    away = np.hypot(row[:, None] - row, col[:, None] - col)
    return np.asarray(np.exp(-away / ALIKE_CELLS))
