"""Discrete-event spread over cells in eight directions (DEVS-FIRE; Hu, Sun & Ntaimo 2012).

A burning cell spreads towards each neighbour with the rate of its own fuel, slope and wind. What
is left of the way is kept for each direction, so that a change of weather changes the rate and
loses no progress. The next event is always the earliest arrival anywhere.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from firemodel.errors import FireModelError
from firemodel.fuels import FUEL_MODELS, NON_BURNABLE
from firemodel.landscape import Landscape
from firemodel.rothermel import (
    eccentricity,
    fastest_spread,
    fuel_bed,
    length_to_breadth,
)
from firemodel.weather import Weather, WeatherStream, wind_adjustment_factor

Floats = NDArray[np.float64]

IGNITION = 8  # the "direction" of an ignition: the cell itself
DIRECTIONS = 9
# North, north-east, east, ... as steps of (row, col).
STEP_ROW = np.array([-1, -1, 0, 1, 1, 1, 0, -1, 0])
STEP_COL = np.array([0, 1, 1, 1, 0, -1, -1, -1, 0])
SLOWEST_M_S = 1e-9


def spread_fields(landscape: Landscape, weather: Weather) -> tuple[Floats, Floats, Floats]:
    """Of each cell (y, x): fastest spread (m/s), its direction (rad from north), eccentricity.

    Cells that do not burn have rate 0. The wind is not reduced by trees above the fuel.
    """
    rate, heading, thinness = (np.zeros(landscape.shape) for _ in range(3))
    wind_toward_deg = (weather.wind_from_deg + 180.0) % 360.0
    upslope_deg = (landscape.aspect_deg + 180.0) % 360.0
    for code in np.unique(landscape.fuel_model):
        if int(code) in NON_BURNABLE:
            continue
        fuel = FUEL_MODELS[int(code)]
        here = landscape.fuel_model == code
        found, direction_deg, effective = fastest_spread(
            fuel_bed(fuel, weather.moisture),
            weather.wind_speed_m_s * wind_adjustment_factor(fuel.depth_ft),
            wind_toward_deg,
            landscape.slope_tan[here],
            upslope_deg[here],
        )
        rate[here] = found
        heading[here] = np.deg2rad(direction_deg)
        thinness[here] = eccentricity(length_to_breadth(effective))
    return rate, heading, thinness


class CellularFire:
    """One burning fire. Time is in seconds and only goes forward.

    ``arrival_time_s`` is float64 (y, x): when each cell caught fire, infinity where it has not yet.
    It is the fire's own array, not a copy: do not write to it.
    """

    def __init__(
        self,
        landscape: Landscape,
        weather: WeatherStream,
        ignitions: Sequence[tuple[int, int, float]],
    ) -> None:
        """``ignitions`` are (row, col, time_s). Raises FireModelError where nothing can burn."""
        rows, cols = landscape.shape
        self.landscape = landscape
        self.weather = weather
        self.time_s = 0.0
        self.arrival_time_s = np.full((rows, cols), np.inf)
        burnable = ~np.isin(landscape.fuel_model, list(NON_BURNABLE))
        for row, col, time_s in ignitions:
            if not (0 <= row < rows and 0 <= col < cols):
                raise FireModelError(f"ignition at row {row}, column {col}: outside the landscape")
            if not 0.0 <= time_s < np.inf:
                raise FireModelError(
                    f"ignition at row {row}, column {col}: time {time_s} s must be 0 or later"
                )
            if not burnable[row, col]:
                raise FireModelError(
                    f"ignition at row {row}, column {col}: fuel code "
                    f"{landscape.fuel_model[row, col]} does not burn"
                )
        self._burnable = burnable.ravel()
        self._left_m = np.zeros((rows * cols, 8))
        self._rate_m_s = np.zeros((rows * cols, 8))
        self._since_s = np.zeros(rows * cols)
        slope_north = landscape.slope_tan * np.cos(np.deg2rad(landscape.aspect_deg + 180.0))
        slope_east = landscape.slope_tan * np.sin(np.deg2rad(landscape.aspect_deg + 180.0))
        self._slope = np.stack([slope_north.ravel(), slope_east.ravel()])
        self._times = np.empty(8 * rows * cols + len(ignitions))
        self._keys = np.empty(self._times.size, dtype=np.int64)
        self._size = 0
        for row, col, time_s in ignitions:
            key = (row * cols + col) * DIRECTIONS + IGNITION
            self._size = _push(self._times, self._keys, self._size, float(time_s), key)
        self._weather_index = 0
        self._fields = self._fields_of(0)
        self.advance(0.0)

    def _fields_of(self, index: int) -> Floats:
        fields = spread_fields(self.landscape, self.weather.entries[index])
        return np.stack([field.ravel() for field in fields])

    def burned(self) -> NDArray[np.bool_]:
        """Which cells burn or have burned by now (y, x)."""
        return self.arrival_time_s <= self.time_s

    def advance(self, to_time_s: float) -> None:
        """Let it burn until ``to_time_s``; costs in proportion to what newly burns."""
        if not self.time_s <= to_time_s < np.inf:
            raise FireModelError(
                f"the fire is at {self.time_s} s and cannot go to {to_time_s} s; "
                "it only goes forward"
            )
        entries = self.weather.entries
        while self._weather_index + 1 < len(entries):
            change_s = entries[self._weather_index + 1].at_s
            if change_s > to_time_s:
                break
            self._burn(change_s)
            self._weather_index += 1
            self._fields = self._fields_of(self._weather_index)
            self._size = _change_rates(
                change_s,
                self._times,
                self._keys,
                self._size,
                self.arrival_time_s.ravel(),
                self._left_m,
                self._rate_m_s,
                self._since_s,
                self._fields,
                self._slope,
                self.landscape.shape[1],
            )
        self._burn(to_time_s)
        self.time_s = float(to_time_s)

    def _burn(self, to_time_s: float) -> None:
        self._size = _burn_until(
            to_time_s,
            self._times,
            self._keys,
            self._size,
            self.arrival_time_s.ravel(),
            self._left_m,
            self._rate_m_s,
            self._since_s,
            self._burnable,
            self._fields,
            self._slope,
            self.landscape.shape[1],
            self.landscape.cell_size_m,
        )


@njit(cache=True)
def _before(times, keys, a, b):  # type: ignore[no-untyped-def]
    """Order of two heap places: by time, then by key, so that ties are always broken alike."""
    return times[a] < times[b] or (times[a] == times[b] and keys[a] < keys[b])


@njit(cache=True)
def _swap(times, keys, a, b):  # type: ignore[no-untyped-def]
    times[a], times[b] = times[b], times[a]
    keys[a], keys[b] = keys[b], keys[a]


@njit(cache=True)
def _push(times, keys, size, time, key):  # type: ignore[no-untyped-def]
    """Add to the binary heap; returns its new size."""
    times[size], keys[size] = time, key
    child = size
    while child > 0 and _before(times, keys, child, (child - 1) // 2):
        _swap(times, keys, child, (child - 1) // 2)
        child = (child - 1) // 2
    return size + 1


@njit(cache=True)
def _drop_first(times, keys, size):  # type: ignore[no-untyped-def]
    """Remove the earliest event; returns the heap's new size."""
    size -= 1
    times[0], keys[0] = times[size], keys[size]
    parent = 0
    while True:
        child = 2 * parent + 1
        if child >= size:
            return size
        if child + 1 < size and _before(times, keys, child + 1, child):
            child += 1
        if not _before(times, keys, child, parent):
            return size
        _swap(times, keys, child, parent)
        parent = child


@njit(cache=True)
def _rate_towards(cell, direction, fields, slope):  # type: ignore[no-untyped-def]
    """Horizontal spread rate from a cell in one of eight directions (m/s).

    ``rothermel.rate_towards``, here in the loop, along the slope and then projected.
    """
    bearing = direction * np.pi / 4.0
    e = fields[2, cell]
    along = fields[0, cell] * (1.0 - e) / (1.0 - e * np.cos(bearing - fields[1, cell]))
    rise = slope[0, cell] * np.cos(bearing) + slope[1, cell] * np.sin(bearing)
    return along / np.sqrt(1.0 + rise * rise)


@njit(cache=True)
def _burn_until(  # type: ignore[no-untyped-def]
    to_time, times, keys, size, arrival, left, rate, since, burnable, fields, slope, cols, cell_m
):
    rows = arrival.size // cols
    while size > 0 and times[0] <= to_time:
        time, key = times[0], keys[0]
        size = _drop_first(times, keys, size)
        source, direction = key // DIRECTIONS, key % DIRECTIONS
        cell = source + STEP_ROW[direction] * cols + STEP_COL[direction]
        if direction != IGNITION:
            left[source, direction] = 0.0
        if arrival[cell] < np.inf:
            continue
        arrival[cell] = time
        since[cell] = time
        row, col = cell // cols, cell % cols
        for towards in range(8):
            to_row, to_col = row + STEP_ROW[towards], col + STEP_COL[towards]
            if not (0 <= to_row < rows and 0 <= to_col < cols):
                continue
            target = to_row * cols + to_col
            if not burnable[target] or arrival[target] < np.inf:
                continue
            left[cell, towards] = cell_m * (np.sqrt(2.0) if towards % 2 else 1.0)
            rate[cell, towards] = _rate_towards(cell, towards, fields, slope)
            if rate[cell, towards] > SLOWEST_M_S:
                arrives = time + left[cell, towards] / rate[cell, towards]
                size = _push(times, keys, size, arrives, cell * DIRECTIONS + towards)
    return size


@njit(cache=True)
def _change_rates(  # type: ignore[no-untyped-def]
    now, times, keys, size, arrival, left, rate, since, fields, slope, cols
):
    """New rates for all that burns; what was covered stays covered. Rebuilds the heap."""
    waiting = 0
    for place in range(size):
        if keys[place] % DIRECTIONS == IGNITION:
            times[waiting], keys[waiting] = times[place], keys[place]
            waiting += 1
    size = 0
    for place in range(waiting):
        size = _push(times, keys, size, times[place], keys[place])
    for cell in range(arrival.size):
        if arrival[cell] == np.inf:
            continue
        passed = now - since[cell]
        for towards in range(8):
            if left[cell, towards] <= 0.0:
                continue
            left[cell, towards] -= rate[cell, towards] * passed
            target = cell + STEP_ROW[towards] * cols + STEP_COL[towards]
            if arrival[target] < np.inf:
                left[cell, towards] = 0.0
                continue
            left[cell, towards] = max(left[cell, towards], 1e-9)
            rate[cell, towards] = _rate_towards(cell, towards, fields, slope)
            if rate[cell, towards] > SLOWEST_M_S:
                arrives = now + left[cell, towards] / rate[cell, towards]
                size = _push(times, keys, size, arrives, cell * DIRECTIONS + towards)
        since[cell] = now
    return size
