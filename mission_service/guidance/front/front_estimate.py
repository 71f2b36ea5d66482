"""Estimates the fire front on 360 bearings, and advances the estimate where the front is unseen.

For each bearing, the estimate consists of the distance to the front, the time of the last view, and
a factor: the measured rate of spread divided by the fire model's rate under the wind that the
vehicle measures. Where the front is in view, the estimate is set to the observation. Out of view,
the estimate advances at the model's rate times the factor.

A Kalman filter estimates the factors of 72 sectors. Each sector's factor is correlated with the
factors of the neighbouring sectors and, less strongly, with the factors of all other sectors. The
filter assumes that the advance between two views is the factor times the modelled advance, plus
noise, because an observed front moves in whole cells. Therefore a view changes the factors little
if the previous view was a few seconds ago, and much if the previous view was half an hour ago.

Without a landscape, or before a wind is measured, the modelled rate of spread is the same
everywhere, and the factors represent the measured rate of spread. The simulated fire is not an
input.

Distances are in cells from the centre, and times in seconds of mission time.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from firemodel.physics.fuels import NON_BURNABLE
from firemodel.physics.weather import WeatherStream
from firemodel.spread.front_rates import FrontRates, SteadyRates
from mission_service.guidance.fire_map import BEARINGS, EAST, NORTH, taken_back
from mission_service.guidance.front.front_estimate_kernels import (
    BASELINE_CELLS,
    BASELINE_S,
    PER_SECTOR,
    PLACES,
    advance_front,
    bearings_in_view,
    bound_front,
    bounds_in_window,
    front_normals,
    interpolate_sectors,
    speed_along_bearings,
    update_factors,
    values_at_front,
)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]

SECTORS = BEARINGS // PER_SECTOR
LONGEST_STEP_S = 60.0
EVEN_CELLS_S = 0.01  # rate of spread without a model, before multiplication by the factor

# The wind is averaged over the longer time, or over the shorter time if the two means differ by
# more than the noise. The noise is a constant (in m/s) plus a fraction of the wind speed.
SHORT_WIND_S, LONG_WIND_S = 90.0, 900.0
WIND_NOISE_M_S, WIND_NOISE = 0.8, 0.08
UNSEEN_ALIKE_DEG = 60.0


class FactorPrior(NamedTuple):
    """The distribution of the factors before the first view, and their drift.

    ``common`` and ``local`` are the standard deviations of the part of the factor shared by all
    sectors, and of each sector's own part. ``drift`` is the standard deviation of a factor's change
    over one hour; both parts follow a random walk.
    """

    common: float
    local: float
    alike_deg: float  # correlation length of the sectors' own parts
    drift: float
    unlike: float  # relative error of an advance due to causes other than the factor
    min_factor: float
    max_factor: float


MODELLED = FactorPrior(0.25, 0.25, 20.0, 0.15, 0.15, 0.3, 2.5)
UNMODELLED = FactorPrior(1.0, 1.0, 20.0, 0.15, 0.15, 0.05, 10.0)  # the rate of spread is unknown
# The prior for a model that may be wrong. It was tuned on fires 200 to 229 of
# ``benchmarks.random_fires --wrong``; a smaller ``unlike`` or ``alike_deg`` gives larger errors.
CAUTIOUS = FactorPrior(0.8, 0.4, 40.0, 0.5, 0.4, 0.05, 10.0)


@dataclass(frozen=True, slots=True)
class FrontModel:
    """The on-board fire model, which gives rates of spread on a landscape under a given wind.

    If ``averaged`` is True, the estimate uses the geometric mean of the modelled rate and of
    ``EVEN_CELLS_S``. This mean halves the differences between the logarithms of modelled rates.
    """

    rates: FrontRates
    landscape: Landscape
    weather: WeatherStream
    prior: FactorPrior = MODELLED
    averaged: bool = False


class View(NamedTuple):
    """A camera window with the bounds of the front in it, as computed by ``bounds_in_window``."""

    window: NDArray[np.uint8]
    burned_to: Floats
    unburned_from: Floats


def cautious(model: FrontModel) -> FrontModel:
    """Return a model that depends less on wind and slope, and not on the fuel map.

    In this model, all burnable ground has the most common fuel in the landscape.
    """
    fuel = model.landscape.fuel_model
    burnable = ~np.isin(fuel, list(NON_BURNABLE))
    most = np.bincount(fuel[burnable]).argmax() if burnable.any() else 0
    ground = replace(model.landscape, fuel_model=np.where(burnable, most, fuel).astype(fuel.dtype))
    rates = FrontRates(ground, model.weather)
    return FrontModel(rates, ground, model.weather, CAUTIOUS, averaged=True)


def distance_to_edge(shape: tuple[int, int], centre: tuple[float, float]) -> Floats:
    """Return the distance in cells from ``centre`` to the edge of the grid on each bearing."""
    with np.errstate(divide="ignore"):
        rows = np.where(NORTH > 0, centre[0], shape[0] - 1 - centre[0]) / np.abs(NORTH)
        cols = np.where(EAST > 0, shape[1] - 1 - centre[1], centre[1]) / np.abs(EAST)
    return np.maximum(np.minimum(rows, cols), 0.5)


class FrontEstimate:
    """The estimated front.

    An array has either 360 elements, one per whole-degree bearing, or 72 elements, one per sector.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        centre: tuple[float, float],
        model: FrontModel | None,
        front: Floats,
        at_s: float,
    ) -> None:
        self.model = model
        self.centre_row, self.centre_col = centre
        self._shape = shape
        self.at_s = at_s
        self.front = front.copy()
        self.speed_cells_s = np.zeros(BEARINGS)  # estimated outward speed
        self.seen_at_s = np.full(BEARINGS, -np.inf)
        self.burned = np.zeros(BEARINGS)  # distance to the outermost ground seen burned
        self.wind_m_s: Floats | None = None  # components towards north and east
        self._short_wind = self._long_wind = np.zeros(2)
        self._wind_at_s = -np.inf
        self._reset_factors()
        room = PLACES * BEARINGS
        self._bearing, self._rows, self._cols = (np.zeros(room, np.int64) for _ in range(3))
        self._north, self._east, self._stretch, self._limit = (np.ones(room) for _ in range(4))
        self._unit = np.zeros(BEARINGS)
        self._weather = (0, 0.0, 0.0)  # for ``_rates``: weather entry, wind speed and direction
        self._rates: SteadyRates | None = None
        self._edge = distance_to_edge(shape, centre)
        self._predicted_fuel = self._anchor_fuel

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes for a snapshot, without the rates, which are recomputed."""
        return {**vars(self), "_rates": None}

    @property
    def modelled(self) -> bool:
        """Whether the fire model advances the front, instead of measured rates alone."""
        return self.model is not None and self.wind_m_s is not None

    @property
    def _prior(self) -> FactorPrior:
        return self.model.prior if self.model is not None and self.modelled else UNMODELLED

    def _reset_factors(self) -> None:
        """Set the factors and their covariance to their values before the first view."""
        # The anchor is the front in the view with which later views are compared.
        self._anchor = self.front.copy()
        self._anchor_at_s = np.full(BEARINGS, self.at_s)
        self._anchor_fuel = self._fuel_at(self.front)
        self._modelled = np.zeros(BEARINGS)  # advance since the anchor with a factor of 1
        self._unseen = np.zeros(BEARINGS)  # advance since the last view with a factor of 1
        prior = self._prior
        apart = np.abs(np.arange(SECTORS)[:, None] - np.arange(SECTORS)) * PER_SECTOR
        alike = np.exp(-np.minimum(apart, BEARINGS - apart) / prior.alike_deg)
        self.factor = np.ones(SECTORS)
        self._covariance = prior.common**2 + prior.local**2 * alike
        self._drift = prior.drift**2 * (0.5 + 0.5 * alike)  # increase of the covariance per hour

    def _fuel_at(self, front: Floats) -> NDArray[np.int16]:
        """Return the fuel model at a front on each bearing; 0 without a landscape."""
        found = np.zeros(BEARINGS, np.int16)
        if self.model is not None:
            centre, fuel = (self.centre_row, self.centre_col), self.model.landscape.fuel_model
            values_at_front(fuel, front, *centre, NORTH, EAST, found)
        return found

    def reset_around(
        self, centre: tuple[float, float], front: Floats, at_s: float
    ) -> "FrontEstimate":
        """Return an estimate around another centre, with the same model and wind but no views."""
        renewed = FrontEstimate(self._shape, centre, self.model, front, at_s)
        renewed.wind_m_s = self.wind_m_s
        renewed._short_wind, renewed._long_wind = self._short_wind, self._long_wind
        renewed._wind_at_s = self._wind_at_s
        renewed._reset_factors()
        return renewed

    def add_wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """Add a wind measurement to the mean over a quarter of an hour.

        The wind speed is at 20 ft above the vegetation. ``from_deg`` is the direction from which
        the wind blows, clockwise from true north. If the wind shifts by more than gusts and errors
        can explain, the mean follows within one or two minutes.
        """
        toward = math.radians(from_deg + 180.0)
        new = speed_m_s * np.array([math.cos(toward), math.sin(toward)])
        if self.wind_m_s is None:
            self.wind_m_s = self._short_wind = self._long_wind = new
            self._reset_factors()
        else:
            elapsed_s = max(at_s - self._wind_at_s, 0.0)
            short = 1.0 - math.exp(-elapsed_s / SHORT_WIND_S)
            self._short_wind = self._short_wind + short * (new - self._short_wind)
            long = 1.0 - math.exp(-elapsed_s / LONG_WIND_S)
            self._long_wind = self._long_wind + long * (new - self._long_wind)
            off = self._short_wind - self._long_wind
            noise_m_s = WIND_NOISE_M_S + WIND_NOISE * math.hypot(*self._long_wind)
            share = math.hypot(*off) / noise_m_s - 1.0
            if share >= 1.0:
                self._long_wind = self._short_wind
            self.wind_m_s = self._long_wind + min(max(share, 0.0), 1.0) * off
        self._wind_at_s = at_s

    def advance(self, to_s: float) -> None:
        """Advance the front to the time ``to_s``."""
        while self.at_s < to_s:
            step_s = min(LONGEST_STEP_S, to_s - self.at_s)
            unit, moved = self._model_speed(), (self.front, self._modelled, self._unseen)
            factors = self.factors()
            advance_front(unit, factors, step_s, self._edge, self.speed_cells_s, *moved)
            self.at_s = to_s if step_s < LONGEST_STEP_S else self.at_s + step_s
            self._covariance += step_s / 3600.0 * self._drift

    def factors(self) -> Floats:
        """Return the factor on each bearing: the rate of spread divided by the modelled rate."""
        found = np.empty(BEARINGS)
        interpolate_sectors(self.factor, found)
        return found

    def factor_sd(self) -> Floats:
        """Return the standard deviation of the factor on each bearing."""
        found = np.empty(BEARINGS)
        interpolate_sectors(np.sqrt(np.maximum(np.diag(self._covariance), 0.0)), found)
        return found

    def slant(self) -> Floats:
        """Return the speed along each bearing (360) divided by the speed normal to the front."""
        return self._stretch[:BEARINGS]

    def unseen_advance(self) -> Floats:
        """Return the modelled advance in cells since the last view of each bearing, uncorrected."""
        return self._unseen

    def _model_speed(self) -> Floats:
        """Return the modelled outward speed in cells/s on each bearing, without correction."""
        ground = (self._bearing, self._rows, self._cols)
        facing = (self._north, self._east, self._stretch, self._limit)
        centre = (self.centre_row, self.centre_col)
        count = front_normals(self.front, *centre, self._shape, *ground, *facing)
        if self.model is None or self.wind_m_s is None:
            return EVEN_CELLS_S * self._stretch[:BEARINGS]
        north, east = self.wind_m_s
        blows_from = math.hypot(north, east), math.degrees(math.atan2(-east, -north)) % 360.0
        bearing, rows, cols = (each[:count] for each in ground)
        north_of, east_of, stretch, limit = (each[:count] for each in facing)
        weather = self.model.weather.index_at(self.at_s), *blows_from
        if self._rates is None or weather != self._weather:
            self._weather = weather
            self._rates = self.model.rates.in_wind(self.at_s, blows_from, self._rows.size)
        rate = self._rates.speeds_m_s(rows, cols, north_of, east_of)
        rate /= self.model.landscape.cell_size_m
        if self.model.averaged:
            rate = np.sqrt(rate * EVEN_CELLS_S)
        speed_along_bearings(bearing, rate, stretch, limit, LONGEST_STEP_S, self._unit)
        return self._unit

    def add_window(self, row: int, col: int, window: NDArray[np.uint8], at_s: float) -> Booleans:
        """Update the front from one camera window; return which bearings (360) show the front.

        ``window`` (y, x) holds the codes of ``fire_map``; ``row`` and ``col`` are the grid cell of
        the window's first element.
        """
        self.advance(at_s)
        return self.add_bounded_view(self.bounded_view(row, col, window))

    def add_bounded_view(self, view: View) -> Booleans:
        """Update the front from a view at ``self.at_s``; return which bearings (360) show it."""
        at_s, burned_to = self.at_s, view.burned_to
        in_view = self._front_in(view)
        before = self.front.copy()
        self._predicted_fuel = self._fuel_at(before)
        new = in_view & np.isinf(self.seen_at_s)
        # The front may be anywhere within a cell, so the estimate is half-way between the cell's
        # centre and the prediction.
        off = np.clip(self.front - burned_to, -0.5, 0.5)
        self.front[in_view] = (burned_to + np.where(new, 0.0, 0.5 * off))[in_view]
        self._bound(view, in_view)
        if new.any():
            self._scale_unseen(np.flatnonzero(new), before)
        self.seen_at_s[in_view] = at_s
        self._unseen[in_view] = 0.0
        self._update_factors(in_view, at_s)
        return in_view

    def correct_window(self, row: int, col: int, window: NDArray[np.uint8], at_s: float) -> None:
        """Apply a window corrected by an operator to the front; leave the factors unchanged."""
        self.advance(at_s)
        centre = (self.centre_row, self.centre_col)
        not_burned, still_burned = taken_back(row, col, window, centre, self.burned)
        self.burned[not_burned] = still_burned[not_burned]
        self.front[not_burned] = np.minimum(self.front[not_burned], still_burned[not_burned] + 0.5)
        view = self.bounded_view(row, col, window)
        in_view = self._front_in(view)
        self.front[in_view] = view.burned_to[in_view]
        self._bound(view, in_view)
        self.seen_at_s[in_view] = at_s
        moved = in_view | not_burned
        self._unseen[moved] = self._modelled[moved] = 0.0
        self._anchor[moved] = self.front[moved]
        self._anchor_at_s[moved] = at_s
        self._anchor_fuel[moved] = self._fuel_at(self.front)[moved]

    def bounded_view(self, row: int, col: int, window: NDArray[np.uint8]) -> View:
        """Return the bounds of the front in a window, as distances from the estimate's centre."""
        view = View(window, np.empty(BEARINGS), np.empty(BEARINGS))
        centre = (self.centre_row, self.centre_col)
        bounds_in_window(window, row, col, *centre, NORTH, EAST, view.burned_to, view.unburned_from)
        return view

    def _front_in(self, view: View) -> Booleans:
        """Update ``burned`` from a view; return which bearings show the front."""
        in_view = np.empty(BEARINGS, np.bool_)
        bearings_in_view(view.burned_to, view.unburned_from, self.burned, in_view)
        return in_view

    def _bound(self, view: View, in_view: Booleans) -> None:
        """Move the front to enclose the burned ground in view and exclude the unburned ground."""
        bounds = (view.burned_to, view.unburned_from)
        bound_front(view.window, in_view, *bounds, self.burned, self.front)

    def _scale_unseen(self, new: Integers, before: Floats) -> None:
        """Scale the unseen parts of the front after other parts have been seen for the first time.

        ``new`` holds the bearings seen for the first time, and ``before`` the front before this
        view. The distance on an unseen bearing is scaled like that on the nearest new bearing, but
        less so as the angle between the two bearings increases.
        """
        unseen = np.isinf(self.seen_at_s)
        unseen[new] = False
        places = np.flatnonzero(unseen)
        if not places.size:
            return
        ratio = np.clip(self.front[new] / np.maximum(before[new], 0.5), 0.3, 3.0)
        apart = np.abs(places[:, None] - new)
        apart = np.minimum(apart, BEARINGS - apart)
        nearest = np.argmin(apart, axis=1)
        weight = np.exp(-apart.min(axis=1) / UNSEEN_ALIKE_DEG)
        self.front[places] *= ratio[nearest] ** weight

    def _update_factors(self, in_view: Booleans, at_s: float) -> None:
        factors = self.factors()
        due = in_view & (
            (self._modelled * factors >= BASELINE_CELLS) | (at_s - self._anchor_at_s >= BASELINE_S)
        )
        if not due.any():
            return
        fuel = self._fuel_at(self.front)
        prior = self._prior
        # An advance through two fuels does not give the rate of either.
        alike = (fuel == self._anchor_fuel) & (fuel == self._predicted_fuel)
        update_factors(
            due & alike,
            self.front,
            self._anchor,
            self._modelled,
            self._stretch,
            prior.unlike,
            prior.min_factor,
            prior.max_factor,
            self.factor,
            self._covariance,
        )
        self._anchor[due] = self.front[due]
        self._anchor_fuel[due] = fuel[due]
        self._anchor_at_s[due] = at_s
        self._modelled[due] = 0.0
        # The new factors also apply to the advance since the last view.
        self.front += (self.factors() - factors) * self._unseen
        np.maximum(self.front, self.burned - 0.5, out=self.front)
