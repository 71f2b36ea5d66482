"""Where and when fire is too near: times of ignition on a raster, asked along legs of a flight.

A place x is in danger at time t if any place y, no farther from it than ``distance_margin_m`` and,
where x is downwind of y, as much more as the wind goes that way in ``wind_margin_s``, ignites after
t - residence_s and before t + time_margin_s. The raster must never miss what the simulation has.
So each cell holds bounds of the times within it, it counts from its nearest corner on, and a sample
of a leg stands for all of the leg about it, in place and in time.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import kernel
from firemodel.ellipses.observations import Simulation
from mission_service.config.sections import BurnSection
from mission_service.errors import MissionServiceError

Floats = NDArray[np.float64]
Box = tuple[float, float, float, float]  # west, south, east, north

FINE_CELL_M, FINE_NODES = 0.6, 500_000  # of a finer raster, for where the other is in doubt
# A raster of a unit of 20 acres has cells of about 2.3 m.
LEAST_CELL_M, MOST_CELL_M, NODES = 1.5, 3.0, 20_000
LONG_AGO_S = -1e9  # earlier times of ignition are this one
BLOCK = 32  # cells whose times are asked for at once
SPARE_CELLS = 3  # of a raster around what can be reached: bounds of times look at neighbours


@dataclass(frozen=True)
class Margins:
    """How far away in space and time fire must be; the wind blows ``toward_rad`` (from east)."""

    time_s: float
    distance_m: float
    wind_m: float  # more of it straight downwind
    toward_rad: float
    residence_s: float

    @property
    def reach_m(self) -> float:
        """How far away fire can matter at most."""
        return self.distance_m + self.wind_m


def margins_of(settings: BurnSection, wind_m_s: float, toward_rad: float) -> Margins:
    """As set, in this wind."""
    return Margins(
        settings.time_margin_s,
        settings.distance_margin_m,
        settings.wind_margin_s * wind_m_s,
        toward_rad,
        settings.residence_s,
    )


class Hazard:
    """Bounds of the times of ignition in cells (y, x), row 0 in the north; infinity for never.

    The simulation is asked block by block, where a leg comes near first. What lies beyond the
    raster is not known, and so in danger.
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
        around_m = margins.reach_m + SPARE_CELLS * cell_m
        self.west_m, self.north_m = box[0] - around_m, box[3] + around_m
        cols = math.ceil((box[2] + around_m - self.west_m) / cell_m)
        rows = math.ceil((self.north_m - box[1] + around_m) / cell_m)
        self.at_s = np.full((rows + 1, cols + 1), np.nan)  # at the corners of cells
        self.first_s, self.last_s = np.full((rows, cols), -np.inf), np.full((rows, cols), np.inf)
        self._known = np.zeros((-(-rows // BLOCK), -(-cols // BLOCK)), np.bool_)
        self._fire, self._sources, self._begins_s = fire, sources, begins_s

    def _look(self, x0_m: float, y0_m: float, x1_m: float, y1_m: float, more_m: float) -> None:
        """Ask the simulation for all that a leg needs and is not known yet."""
        around_m = self.margins.reach_m + self.cell_m + more_m
        size_m = BLOCK * self.cell_m
        low_x, high_x = min(x0_m, x1_m) - around_m, max(x0_m, x1_m) + around_m
        low_y, high_y = min(y0_m, y1_m) - around_m, max(y0_m, y1_m) + around_m
        left = max(math.floor((low_x - self.west_m) / size_m), 0)
        right = max(math.floor((high_x - self.west_m) / size_m) + 1, 0)
        top = max(math.floor((self.north_m - high_y) / size_m), 0)
        bottom = max(math.floor((self.north_m - low_y) / size_m) + 1, 0)
        known = self._known[top:bottom, left:right]
        if known.all():
            return
        rows, cols = np.nonzero(~known)
        self._fill(
            (top + int(rows.min())) * BLOCK,
            (top + int(rows.max()) + 1) * BLOCK,
            (left + int(cols.min())) * BLOCK,
            (left + int(cols.max()) + 1) * BLOCK,
        )
        known[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1] = True

    def _fill(self, top: int, bottom: int, left: int, right: int) -> None:
        """Cells of whole blocks; bounds of times need a ring of corners around them."""
        rows = np.arange(max(top - 1, 0), min(bottom + 2, self.at_s.shape[0]))
        cols = np.arange(max(left - 1, 0), min(right + 2, self.at_s.shape[1]))
        nodes = np.empty((rows.size, cols.size, 2))
        nodes[..., 0] = self.west_m + self.cell_m * cols
        nodes[..., 1] = (self.north_m - self.cell_m * rows)[:, None]
        at_s = np.asarray(self._fire.ignition_time_s(nodes.reshape(-1, 2)), np.float64)
        if np.isnan(at_s).any():
            x_m, y_m = nodes.reshape(-1, 2)[np.argmax(np.isnan(at_s))]
            raise MissionServiceError(
                f"fire simulation: time of ignition at x {x_m:.1f}, y {y_m:.1f} is not a number; "
                "nothing can be planned on it: erase the last correction"
            )
        at_s = np.maximum(at_s, LONG_AGO_S).reshape(rows.size, cols.size)
        self.at_s[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1] = at_s
        first, last = self.first_s[top:bottom, left:right], self.last_s[top:bottom, left:right]
        _steep_bounds(self.at_s, self.cell_m, self._begins_s, top, left, first, last)
        west_m, north_m = self.west_m + left * self.cell_m, self.north_m - top * self.cell_m
        _mark_lit(self._sources, west_m, north_m, self.cell_m, first)

    @cached_property
    def fine(self) -> "Hazard":
        """The same on a finer raster."""
        cell_m = max(FINE_CELL_M, math.sqrt(_reached_m2(self.box, self.margins) / FINE_NODES))
        return self.over(self.box, min(cell_m, self.cell_m))

    def over(self, box: Box, cell_m: float) -> "Hazard":
        """The same elsewhere."""
        return Hazard(self._fire, self._sources, box, self.margins, cell_m, self._begins_s)

    def _raster(self, more_m: float = 0.0) -> tuple[Any, ...]:
        far = self.margins
        return (
            *(self.first_s, self.last_s, self.west_m, self.north_m, self.cell_m),
            *(far.distance_m + more_m, far.wind_m * math.cos(far.toward_rad)),
            *(far.wind_m * math.sin(far.toward_rad), far.residence_s),
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
        """The least time by which a vehicle on a straight leg is ahead of fire within reach.

        Infinity if none comes; negative where it burns. Danger is less than ``margins.time_s``.
        ``more_m`` is added to the distance margin.
        """
        self._look(x0_m, y0_m, x1_m, y1_m, more_m)
        return float(_leg_margin(*self._raster(more_m), x0_m, y0_m, t0_s, x1_m, y1_m, t1_s))

    def surely_in_danger(
        self, x0_m: float, y0_m: float, t0_s: float, x1_m: float, y1_m: float, t1_s: float
    ) -> bool:
        """Whether fire at a corner of a cell is too near a leg: no finer raster can deny that."""
        _, _, west_m, north_m, cell_m, *margins = self._raster()
        self._look(x0_m, y0_m, x1_m, y1_m, 0.0)
        leg = (x0_m, y0_m, t0_s, x1_m, y1_m, t1_s)
        raster = (self.at_s, west_m, north_m, cell_m, *margins, self.margins.time_s)
        return bool(_surely(*raster, *leg))

    def margins_s(self, x_m: Floats, y_m: Floats, at_s: Floats, spacing_m: float = 0.0) -> Floats:
        """That of each sample (n,); they stand for what is around them, ``spacing_m`` apart."""
        found = np.empty(len(x_m))
        if len(x_m):
            box = (float(x_m.min()), float(y_m.min()), float(x_m.max()), float(y_m.max()))
            self._look(*box, spacing_m / 2.0)
        _sample_margins(*self._raster(), x_m, y_m, at_s, spacing_m / 2.0, found)
        return found


def cell_for(box: Box, margins: Margins) -> float:
    """The size of cells for what can be reached in a box, by the budget of nodes.

    Never more than a third of the distance margin or 3 m, so that large units do not get wide
    margins.
    """
    by_budget_m = math.sqrt(_reached_m2(box, margins) / NODES)
    return max(LEAST_CELL_M, min(by_budget_m, max(margins.distance_m / 3.0, MOST_CELL_M)))


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
    """A raster of a fire that answers for all places in a box. It burns nowhere before it begins.

    Between the corners of a cell times are bounded by how steep they are around it. That can miss
    what is smaller than a cell, as fires just lit are: see ``sources_of``.
    """
    cell = cell_for(box, margins) if cell_m is None else cell_m
    return Hazard(fire, sources_of(fire), box, margins, cell, begins_s)


def sources_of(fire: Any) -> Floats:
    """Where and when a simulation was lit (n, 3) x, y, at_s, as far as it knows.

    One that knows has ``sources``; one made of others has these as ``fire`` or ``fires``, and may
    have other times.
    """
    if hasattr(fire, "sources"):
        return np.asarray(fire.sources, np.float64)
    inner = [*getattr(fire, "fires", ()), *([fire.fire] if hasattr(fire, "fire") else [])]
    lit = np.concatenate([np.empty((0, 3)), *(sources_of(one) for one in inner)])
    if len(lit):
        lit[:, 2] = fire.ignition_time_s(lit[:, :2])
    return lit


@kernel
def _mark_lit(sources, west, north, cell, first):  # type: ignore[no-untyped-def]
    """A small fire may reach into the next cell before it comes to any corner."""
    rows, cols = first.shape
    for number in range(sources.shape[0]):
        col = math.floor((sources[number, 0] - west) / cell)
        row = math.floor((north - sources[number, 1]) / cell)
        # Not beyond the raster: a fire far away has no row to speak of.
        if not (-2 < row < rows + 1 and -2 < col < cols + 1):
            continue
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(col - 1, 0), min(col + 2, cols)):
                first[r, c] = min(first[r, c], sources[number, 2])


@kernel
def _steep_bounds(at_s, cell, begins, top, left, first, last):  # type: ignore[no-untyped-def]
    """From the four corners, by the steepest slope among them and their neighbours.

    That finds fires lit between nodes and ridges where fires meet: all of a cell is within half
    its diagonal of a corner.
    """
    most_row, most_col = at_s.shape[0] - 1, at_s.shape[1] - 1
    for here in range(first.shape[0]):
        for there in range(first.shape[1]):
            row, col = top + here, left + there
            low, high, east, south = math.inf, -math.inf, 0.0, 0.0
            for r in range(row, row + 2):
                for c in range(col, col + 2):
                    low, high = min(low, at_s[r, c]), max(high, at_s[r, c])
            if low == math.inf:
                first[here, there], last[here, there] = low, low
                continue
            r1, c1 = min(row + 2, most_row), min(col + 2, most_col)
            for r in range(max(row - 1, 0), r1 + 1):
                for c in range(max(col - 1, 0), c1 + 1):
                    if at_s[r, c] == math.inf:
                        continue
                    if c < c1 and at_s[r, c + 1] < math.inf:
                        east = max(east, abs(at_s[r, c + 1] - at_s[r, c]))
                    if r < r1 and at_s[r + 1, c] < math.inf:
                        south = max(south, abs(at_s[r + 1, c] - at_s[r, c]))
            spare = math.sqrt(0.5) * math.hypot(east, south)
            first[here, there], last[here, there] = max(low - spare, begins), high + spare


@kernel
def _margin(first, last, west, north, cell, reach, wx, wy, residence, x, y, t0, t1, slack):  # type: ignore[no-untyped-def]
    """Of what is within ``slack`` of a place from t0 to t1."""
    rows, cols = first.shape
    wind = math.hypot(wx, wy)
    most = reach + wind + slack
    left, right = math.floor((x - most - west) / cell), math.floor((x + most - west) / cell)
    top, bottom = math.floor((north - y - most) / cell), math.floor((north - y + most) / cell)
    if left < 0 or top < 0 or right >= cols or bottom >= rows:
        return -math.inf
    about = slack + math.sqrt(0.5) * cell  # of all of a cell, seen from its middle
    least = math.inf
    for row in range(top, bottom + 1):
        for col in range(left, right + 1):
            if last[row, col] <= t0 - residence or first[row, col] - t1 >= least:
                continue
            # From the middle of the cell, where it may burn, to the vehicle.
            dx, dy = x - (west + (col + 0.5) * cell), y - (north - (row + 0.5) * cell)
            away = math.hypot(max(abs(dx) - 0.5 * cell, 0.0), max(abs(dy) - 0.5 * cell, 0.0))
            along = wx * dx + wy * dy + wind * about
            gap = math.hypot(dx, dy) - about
            more = 0.0
            if along > 0.0:
                more = wind if along >= wind * gap else along / gap
            if away <= reach + more + slack:
                least = first[row, col] - t1
    return least


@kernel
def _leg_margin(  # type: ignore[no-untyped-def]
    first, last, west, north, cell, reach, wx, wy, residence, x0, y0, t0, x1, y1, t1
):
    # Also straight up and down by half a cell, so that what is safe there is so on the leg after.
    count = max(math.ceil(math.hypot(x1 - x0, y1 - y0) / cell), 1)
    least = math.inf
    for number in range(count):
        part, middle, end = number / count, (number + 0.5) / count, (number + 1) / count
        here = _margin(
            *(first, last, west, north, cell, reach, wx, wy, residence),
            *(x0 + middle * (x1 - x0), y0 + middle * (y1 - y0)),
            *(t0 + part * (t1 - t0), t0 + end * (t1 - t0), 0.5 * cell),
        )
        least = min(least, here)
    return least


@kernel
def _surely(  # type: ignore[no-untyped-def]
    at_s, west, north, cell, reach, wx, wy, residence, time, x0, y0, t0, x1, y1, t1
):
    most = reach + math.hypot(wx, wy)
    count = max(math.ceil(math.hypot(x1 - x0, y1 - y0) / cell), math.ceil(t1 - t0), 1)
    for number in range(count + 1):
        part = number / count
        x, y, t = x0 + part * (x1 - x0), y0 + part * (y1 - y0), t0 + part * (t1 - t0)
        left, right = math.ceil((x - most - west) / cell), math.floor((x + most - west) / cell)
        top, bottom = math.ceil((north - y - most) / cell), math.floor((north - y + most) / cell)
        for row in range(max(top, 0), min(bottom, at_s.shape[0] - 1) + 1):
            for col in range(max(left, 0), min(right, at_s.shape[1] - 1) + 1):
                if t - residence < at_s[row, col] < t + time:
                    dx, dy = x - (west + col * cell), y - (north - row * cell)
                    away = math.hypot(dx, dy)
                    along = max(wx * dx + wy * dy, 0.0)
                    if away <= reach or away * away <= reach * away + along:
                        return True
    return False


@kernel
def _sample_margins(  # type: ignore[no-untyped-def]
    first, last, west, north, cell, reach, wx, wy, residence, x, y, at_s, slack, found
):
    for number in range(x.shape[0]):
        found[number] = _margin(
            *(first, last, west, north, cell, reach, wx, wy, residence),
            *(x[number], y[number], at_s[number], at_s[number], slack),
        )
