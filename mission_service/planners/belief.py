"""The on-board map that goes on growing where nobody looks: a front on 360 bearings.

Each bearing holds the distance of the front, when it was last seen, and how much faster or slower
than the fire model says it has been found to move (its factor). What is not in view advances at the
model's speed, under the wind the vehicle measures, times that factor; what is in view is what is
seen. Factors are learned by a Kalman filter on 72 sectors that share what they learn with their
neighbours and, a little, with all: an advance seen between two looks is the factor times the
advance the model gives, plus the noise of a front that moves in whole cells. So two looks seconds
apart teach nothing, and a look after half an hour a great deal.

Without a landscape, or before any wind is measured, the model is an even spread and the factor
becomes the measured rate of spread itself. Nothing here reads the burning model.

Distances are in cells from the centre, times in seconds of mission time.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firemodel.front_rates import FrontRates
from firemodel.landscape import Landscape
from mission_service.fire_map import BEARINGS, BURNED, EAST, NORTH, UNBURNED
from mission_service.planners.belief_kernels import facing, learn, outwards, watch

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]

SECTORS = 72
PER_SECTOR = BEARINGS // SECTORS
LONGEST_STEP_S = 60.0
EVEN_CELLS_S = 0.01  # spread where there is no model; the factor is learned on top of it

# How far the model's speed is trusted (standard deviation of the factor), everywhere alike and
# from place to place, and over how many degrees places are alike; how fast that trust is lost.
COMMON, LOCAL = 0.25, 0.25
ALIKE_DEG = 20.0
DRIFT_PER_SQRT_H = 0.15
UNMODELLED = 4.0  # times less trusted where there is no model
FACTORS = (0.05, 6.0)
# A look is compared with the one from which on the front has come at least this far.
BASELINE_CELLS, BASELINE_S = 2.0, 1800.0
CELL_VARIANCE = 1.0 / 12.0  # of a position known to one whole cell
STEADINESS = 0.25  # share by which the spread before the first look may have been another
WIND_MEMORY_S = 90.0
BEYOND_CELLS = 2.0  # a front not in view behind burned ground is at least so far beyond it


@dataclass(frozen=True, slots=True)
class FrontModel:
    """What is known of the land: speed of fronts on it under a given wind."""

    rates: FrontRates
    landscape: Landscape


class Belief:
    """State of the believed front; arrays (360) by whole-degree bearing, (72) by sector."""

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
        self.speed_cells_s = np.zeros(BEARINGS)  # outwards, as believed
        self.seen_at_s = np.full(BEARINGS, -np.inf)
        self.burned = np.zeros(BEARINGS)  # outermost ground seen burned
        self.wind_m_s: Floats | None = None  # towards north and east
        self._wind_at_s = -np.inf
        self._anchor = front.copy()
        self._anchor_at_s = np.full(BEARINGS, at_s)
        self._modelled = np.zeros(BEARINGS)  # advance since the anchor with a factor of 1
        self._since = np.zeros(BEARINGS)  # the same since it was last seen
        self._forget()
        self._rows, self._cols = (np.zeros((3, BEARINGS), np.int64) for _ in range(2))
        self._north, self._east, self._stretch = (np.zeros((3, BEARINGS)) for _ in range(3))
        self._speed = np.zeros(BEARINGS)
        self._least, self._most = np.zeros(BEARINGS), np.zeros(BEARINGS)

    @property
    def modelled(self) -> bool:
        """Whether the fire model drives the front; otherwise only what was measured."""
        return self.model is not None and self.wind_m_s is not None

    def _forget(self) -> None:
        """Factors as they are before anything was seen."""
        scale = 1.0 if self.modelled else UNMODELLED
        apart = np.abs(np.arange(SECTORS)[:, None] - np.arange(SECTORS)) * PER_SECTOR
        apart = np.minimum(apart, BEARINGS - apart)
        self._local = np.exp(-apart / ALIKE_DEG)
        self.factor = np.ones(SECTORS)
        self._prior = scale**2 * (COMMON**2 + LOCAL**2 * self._local)
        self._covariance = self._prior.copy()

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """Take in a measured wind (at 20 ft, from grid north), smoothed over a minute or two."""
        toward = math.radians(from_deg + 180.0)
        new = speed_m_s * np.array([math.cos(toward), math.sin(toward)])
        if self.wind_m_s is None:
            self.wind_m_s = new
            self._forget()
        else:
            weight = 1.0 - math.exp(-max(at_s - self._wind_at_s, 0.0) / WIND_MEMORY_S)
            self.wind_m_s = self.wind_m_s + weight * (new - self.wind_m_s)
        self._wind_at_s = at_s

    def advance(self, to_s: float) -> None:
        """Let the front grow until a time."""
        steps = max(math.ceil((to_s - self.at_s) / LONGEST_STEP_S), 0)
        for _ in range(steps):
            step_s = min(LONGEST_STEP_S, to_s - self.at_s)
            unit = self._model_speed()
            factor = self.factors()
            self.speed_cells_s = unit * factor
            self.front += self.speed_cells_s * step_s
            self._modelled += unit * step_s
            self._since += unit * step_s
            self.at_s += step_s
            drift = DRIFT_PER_SQRT_H**2 * step_s / 3600.0
            self._covariance += drift * (0.5 + 0.5 * self._local)
        self.at_s = to_s

    def factors(self) -> Floats:
        """The sectors' factors on all bearings."""
        middles = (np.arange(SECTORS) + 0.5) * PER_SECTOR - 0.5
        found = np.interp(np.arange(BEARINGS), middles, self.factor, period=BEARINGS)
        return np.clip(found, *FACTORS)

    def slant(self) -> Floats:
        """How many cells a cell across the front is along each bearing."""
        return self._stretch[1]

    def unseen_advance(self) -> Floats:
        """Advance since each bearing was last seen, with a factor of 1."""
        return self._since

    def doubt(self) -> Floats:
        """Standard deviation of the factor on all bearings."""
        middles = (np.arange(SECTORS) + 0.5) * PER_SECTOR - 0.5
        deviation = np.sqrt(np.maximum(np.diag(self._covariance), 0.0))
        return np.interp(np.arange(BEARINGS), middles, deviation, period=BEARINGS)

    def _model_speed(self) -> Floats:
        """Radial speed in cells/s on all bearings with a factor of 1."""
        facing(
            self.front,
            self._rows,
            self._cols,
            self._north,
            self._east,
            self._stretch,
            self.centre_row,
            self.centre_col,
            self._shape,
        )
        if self.model is None or self.wind_m_s is None:
            return EVEN_CELLS_S * self._stretch[1]
        speed = math.hypot(*self.wind_m_s)
        from_deg = math.degrees(math.atan2(-self.wind_m_s[1], -self.wind_m_s[0])) % 360.0
        convergence = self.model.landscape.grid_convergence_deg
        rate = self.model.rates.under_wind(
            self._rows.ravel(),
            self._cols.ravel(),
            self._north.ravel(),
            self._east.ravel(),
            self.at_s,
            (speed, from_deg + convergence),
        ).reshape(3, BEARINGS)
        outwards(self.front, rate, self._stretch, self._speed)
        return self._speed / self.model.landscape.cell_size_m

    def see(self, row: int, col: int, window: NDArray[np.uint8], at_s: float) -> Booleans:
        """Take in one camera window; returns on which bearings the front is in view."""
        self.advance(at_s)
        least, most = self._least, self._most
        watch(window, row, col, self.centre_row, self.centre_col, NORTH, EAST, least, most)
        np.maximum(self.burned, least, out=self.burned)
        in_view = (least >= self.burned) & (most <= least + 1.5) & (least >= 0.0)
        before = self.front[in_view]
        known = np.isfinite(self.seen_at_s[in_view])
        self._correct(in_view, least, at_s)
        self.front = np.maximum(self.front, self.burned - 0.5)
        short = np.isfinite(most) & (most > self.burned)
        self.front[short] = np.minimum(self.front[short], most[short])
        if not (window == BURNED).any():
            inside = short & (most >= self.burned + BEYOND_CELLS)
            self.front[inside] = np.minimum(self.front[inside], most[inside] - BEYOND_CELLS)
        if not (window == UNBURNED).any():
            beyond = (least >= self.burned) & (least >= 0.0)
            self.front[beyond] = np.maximum(self.front[beyond], self.burned[beyond] + BEYOND_CELLS)
        if in_view.any() and not known.all():
            self._scale_unseen(np.flatnonzero(in_view)[~known], before[~known])
        self.seen_at_s[in_view] = at_s
        self._since[in_view] = 0.0
        before_all = self.factors()
        self._learn(in_view, at_s)
        # What was learned here holds for what has gone on unseen nearby as well.
        self.front += (self.factors() - before_all) * self._since
        self.front = np.maximum(self.front, self.burned - 0.5)
        return in_view

    def _correct(self, in_view: Booleans, seen: Floats, at_s: float) -> None:
        """A front seen in a cell is somewhere in it: the better of prediction and middle."""
        off = np.clip(self.front[in_view] - seen[in_view], -0.5, 0.5)
        first = ~np.isfinite(self.seen_at_s[in_view])
        self.front[in_view] = seen[in_view] + np.where(first, 0.0, 0.5 * off)

    def _scale_unseen(self, new: Integers, before: Floats) -> None:
        """What was never seen is as much larger or smaller than thought as what was seen."""
        unseen = np.flatnonzero(~np.isfinite(self.seen_at_s))
        unseen = np.setdiff1d(unseen, new)
        if not unseen.size:
            return
        ratio = np.clip(self.front[new] / np.maximum(before, 0.5), 0.3, 3.0)
        apart = np.abs(unseen[:, None] - new[None, :])
        apart = np.minimum(apart, BEARINGS - apart)
        nearest = np.argmin(apart, axis=1)
        weight = np.exp(-apart[np.arange(unseen.size), nearest] / 60.0)
        self.front[unseen] *= ratio[nearest] ** weight

    def _learn(self, in_view: Booleans, at_s: float) -> None:
        far = self._modelled * self.factors() >= BASELINE_CELLS
        due = in_view & (far | (at_s - self._anchor_at_s >= BASELINE_S))
        if not due.any():
            return
        bearings = np.flatnonzero(due)
        for sector in np.unique(bearings // PER_SECTOR):
            here = bearings[bearings // PER_SECTOR == sector]
            advance = float(np.mean(self.front[here] - self._anchor[here]))
            predicted = float(np.mean(self._modelled[here]))
            slant = float(np.mean(self._stretch[1, here]))
            variance = 2.0 * CELL_VARIANCE * slant**2
            if (self._anchor[here] <= 1.0).all():
                variance += (STEADINESS * predicted) ** 2
            learn(self.factor, self._covariance, sector, advance, predicted, variance)
        np.clip(self.factor, *FACTORS, out=self.factor)
        self._anchor[due] = self.front[due]
        self._anchor_at_s[due] = at_s
        self._modelled[due] = 0.0
