"""Tests whether fire endangers the legs of a flight, using ignition times on a raster.

A point x is in danger at time t if a point y within reach of x ignites between t - residence_s and
t + time_margin_s. The reach is ``distance_margin_m``. If x is downwind of y, the reach is longer by
the distance that the wind travels towards x in ``wind_margin_s``.

The raster must not miss any simulated fire. Therefore each cell holds bounds on the
ignition times inside the cell, and distances to a cell are measured to the cell's nearest point.
Each sample of a leg covers the part of the leg around the sample, in space and time.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.ellipses.point_observations import Simulation
from mission_service.config.sections import BurnSection
from mission_service.errors import MissionServiceError
from mission_service.guidance.burn.lines.hazard_kernels import (
    bound_times,
    is_surely_in_danger,
    mark_lit,
    min_margin_s,
)

Floats = NDArray[np.float64]
Box = tuple[float, float, float, float]  # west, south, east, north

FINE_CELL_M, FINE_NODES = 0.6, 500_000  # limits for the finer raster
# The raster of a 20-acre unit has cells of about 2.3 m.
MIN_CELL_M, MAX_CELL_M, NODES = 1.5, 3.0, 20_000
LONG_AGO_S = -1e9  # lower bound of ignition times
BLOCK = 32  # times are computed in blocks of BLOCK x BLOCK cells
SPARE_CELLS = 3  # border beyond the reach, because bounds on times use neighbouring cells


@dataclass(frozen=True)
class Margins:
    """The required margins to fire in space and time."""

    time_s: float
    distance_m: float
    wind_m: float  # additional distance directly downwind
    toward_rad: float  # direction towards which the wind blows, anticlockwise from east
    residence_s: float

    @property
    def reach_m(self) -> float:
        """Return the largest distance at which fire is a danger."""
        return self.distance_m + self.wind_m


def margins_of(settings: BurnSection, wind_m_s: float, toward_rad: float) -> Margins:
    """Return the margins that the settings require for a given wind."""
    return Margins(
        settings.time_margin_s,
        settings.distance_margin_m,
        settings.wind_margin_s * wind_m_s,
        toward_rad,
        settings.residence_s,
    )


class Hazard:
    """The danger from a fire, as bounds on the ignition times in the cells (y, x) of a raster.

    Row 0 is in the north. The time of a cell that never ignites is infinite. A block of cells is
    evaluated when a leg first comes near the block. Points outside the raster count as in danger.
    """

    def __init__(
        self,
        fire: Simulation,
        sources: Floats,
        box: Box,
        margins: Margins,
        cell_m: float,
        begins_s: float = LONG_AGO_S,
    ) -> None:
        self.box, self.margins, self.cell_m = box, margins, cell_m
        border_m = margins.reach_m + SPARE_CELLS * cell_m
        self.west_m, self.north_m = box[0] - border_m, box[3] + border_m
        cols = math.ceil((box[2] + border_m - self.west_m) / cell_m)
        rows = math.ceil((self.north_m - box[1] + border_m) / cell_m)
        self.at_s = np.full((rows + 1, cols + 1), np.nan)  # ignition times at the corners of cells
        self.first_s, self.last_s = np.full((rows, cols), -np.inf), np.full((rows, cols), np.inf)
        self._evaluated = np.zeros((-(-rows // BLOCK), -(-cols // BLOCK)), np.bool_)
        self._fire, self._sources, self._begins_s = fire, sources, begins_s

    def _evaluate(self, x0_m: float, y0_m: float, x1_m: float, y1_m: float, more_m: float) -> None:
        """Evaluate the simulation in those blocks near a leg that have not yet been evaluated."""
        around_m = self.margins.reach_m + self.cell_m + more_m
        size_m = BLOCK * self.cell_m
        low_x, high_x = min(x0_m, x1_m) - around_m, max(x0_m, x1_m) + around_m
        low_y, high_y = min(y0_m, y1_m) - around_m, max(y0_m, y1_m) + around_m
        left = max(math.floor((low_x - self.west_m) / size_m), 0)
        right = max(math.floor((high_x - self.west_m) / size_m) + 1, 0)
        top = max(math.floor((self.north_m - high_y) / size_m), 0)
        bottom = max(math.floor((self.north_m - low_y) / size_m) + 1, 0)
        evaluated = self._evaluated[top:bottom, left:right]
        if evaluated.all():
            return
        rows, cols = np.nonzero(~evaluated)
        row0, row1 = int(rows.min()), int(rows.max()) + 1
        col0, col1 = int(cols.min()), int(cols.max()) + 1
        corners = (top + row0, top + row1, left + col0, left + col1)
        self._fill(*(BLOCK * corner for corner in corners))
        evaluated[row0:row1, col0:col1] = True

    def _fill(self, top: int, bottom: int, left: int, right: int) -> None:
        """Fill the cells of whole blocks; also evaluate one ring of corners around them."""
        rows = np.arange(max(top - 1, 0), min(bottom + 2, self.at_s.shape[0]))
        cols = np.arange(max(left - 1, 0), min(right + 2, self.at_s.shape[1]))
        nodes = np.empty((rows.size, cols.size, 2))
        nodes[..., 0] = self.west_m + self.cell_m * cols
        nodes[..., 1] = (self.north_m - self.cell_m * rows)[:, None]
        at_s = np.asarray(self._fire.ignition_time_s(nodes.reshape(-1, 2)), np.float64)
        if np.isnan(at_s).any():
            x_m, y_m = nodes.reshape(-1, 2)[np.argmax(np.isnan(at_s))]
            raise MissionServiceError(
                f"fire simulation: the ignition time at x {x_m:.1f}, y {y_m:.1f} is not a number, "
                "which prevents planning; erase the last correction"
            )
        at_s = np.maximum(at_s, LONG_AGO_S).reshape(rows.size, cols.size)
        self.at_s[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1] = at_s
        first, last = self.first_s[top:bottom, left:right], self.last_s[top:bottom, left:right]
        bound_times(self.at_s, self.cell_m, self._begins_s, top, left, first, last)
        west_m, north_m = self.west_m + left * self.cell_m, self.north_m - top * self.cell_m
        mark_lit(self._sources, west_m, north_m, self.cell_m, first)

    @cached_property
    def fine(self) -> "Hazard":
        """Return the hazard of this fire on a finer raster of the box."""
        cell_m = max(FINE_CELL_M, math.sqrt(_reached_m2(self.box, self.margins) / FINE_NODES))
        return self.over(self.box, min(cell_m, self.cell_m))

    def over(self, box: Box, cell_m: float) -> "Hazard":
        """Return the hazard of this fire on a raster with the given box and cell size."""
        return Hazard(self._fire, self._sources, box, self.margins, cell_m, self._begins_s)

    def _raster(self, more_m: float = 0.0) -> tuple[Any, ...]:
        margins = self.margins
        return (
            *(self.first_s, self.last_s, self.west_m, self.north_m, self.cell_m),
            *(margins.distance_m + more_m, margins.wind_m * math.cos(margins.toward_rad)),
            *(margins.wind_m * math.sin(margins.toward_rad), margins.residence_s),
        )

    def leg_margin_s(
        self,
        x0_m: float,
        y0_m: float,
        t0_s: float,
        x1_m: float,
        y1_m: float,
        t1_s: float,
        more_m: float = 0.0,
    ) -> float:
        """Return the time margin of a straight leg: the shortest time until fire is within reach.

        The result is infinite if no fire comes within reach, and negative if fire is already within
        reach. A result below ``margins.time_s`` means danger. ``more_m`` is added to the distance
        margin.
        """
        self._evaluate(x0_m, y0_m, x1_m, y1_m, more_m)
        return float(min_margin_s(*self._raster(more_m), x0_m, y0_m, t0_s, x1_m, y1_m, t1_s))

    def surely_in_danger(
        self, x0_m: float, y0_m: float, t0_s: float, x1_m: float, y1_m: float, t1_s: float
    ) -> bool:
        """Return whether fire at a corner of a cell is too close to a leg.

        If so, the leg is also in danger on any finer raster.
        """
        _, _, west_m, north_m, cell_m, *margins = self._raster()
        self._evaluate(x0_m, y0_m, x1_m, y1_m, 0.0)
        leg = (x0_m, y0_m, t0_s, x1_m, y1_m, t1_s)
        raster = (self.at_s, west_m, north_m, cell_m, *margins, self.margins.time_s)
        return bool(is_surely_in_danger(*raster, *leg))


def cell_for(box: Box, margins: Margins) -> float:
    """Return the cell size at which a raster over a box and its reach has at most ``NODES`` nodes.

    The size is at least ``MIN_CELL_M``. To limit the raster's error on a large unit, the size is at
    most ``MAX_CELL_M``, or a third of the distance margin if that is larger. On a large unit the
    raster may therefore have more than ``NODES`` nodes.
    """
    by_budget_m = math.sqrt(_reached_m2(box, margins) / NODES)
    return max(MIN_CELL_M, min(by_budget_m, max(margins.distance_m / 3.0, MAX_CELL_M)))


def _reached_m2(box: Box, margins: Margins) -> float:
    wide_m, high_m = box[2] - box[0], box[3] - box[1]
    return (wide_m + 2.0 * margins.reach_m) * (high_m + 2.0 * margins.reach_m)


def hazard_of(
    fire: Simulation,
    box: Box,
    margins: Margins,
    *,
    cell_m: float | None = None,
    begins_s: float = LONG_AGO_S,
) -> Hazard:
    """Return the hazard of a fire for all points in a box; no point burns before ``begins_s``.

    Between the corners of a cell, ignition times are bounded by their gradient around the cell.
    These bounds can miss fires smaller than a cell, such as new fires; the sources of the fire
    (``sources_of``) therefore lower the bounds.
    """
    cell = cell_for(box, margins) if cell_m is None else cell_m
    return Hazard(fire, sources_of(fire), box, margins, cell, begins_s)


def sources_of(fire: Any) -> Floats:
    """Return the known ignitions (n, 3) of a simulation, with x, y and time.

    The result is the simulation's ``sources``. If the simulation has none, the result is the
    sources of the simulation's components (``fire`` or ``fires``), at the ignition times of the
    whole simulation.
    """
    if hasattr(fire, "sources"):
        return np.asarray(fire.sources, np.float64)
    inner = [*getattr(fire, "fires", ()), *([fire.fire] if hasattr(fire, "fire") else [])]
    lit = np.concatenate([np.empty((0, 3)), *(sources_of(one) for one in inner)])
    if len(lit):
        lit[:, 2] = fire.ignition_time_s(lit[:, :2])
    return lit
