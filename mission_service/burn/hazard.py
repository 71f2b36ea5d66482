"""Where and when fire is too near: times of ignition on a raster, asked along legs of a flight.

A place x is in danger at time t if any place y, no farther from it than ``distance_margin_m`` and,
where x is downwind of y, as much more as the wind goes that way in ``wind_margin_s``, ignites after
t - residence_s and before t + time_margin_s. The raster must never miss what the simulation has.
So each cell holds bounds of the times within it, it counts from its nearest corner on, and a sample
of a leg stands for all of the leg about it, in place and in time.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import kernel
from firemodel.marks import Simulation
from mission_service.config_sections import BurnSection
from mission_service.errors import MissionServiceError

Floats = NDArray[np.float64]
Box = tuple[float, float, float, float]  # west, south, east, north

FINE_CELL_M, FINE_NODES = 0.5, 12_000  # of a raster around one leg, where the other is in doubt
# A raster of a unit of 20 acres has cells of about 1.9 m.
LEAST_CELL_M, MOST_CELL_M, NODES = 1.5, 3.0, 30_000
LONG_AGO_S = -1e9  # earlier times of ignition are this one
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


@dataclass(frozen=True, eq=False)
class Hazard:
    """Bounds of the times of ignition in cells (y, x), row 0 in the north; infinity for never.

    What lies beyond the raster is not known, and so in danger.
    """

    at_s: Floats  # at the corners of cells (y + 1, x + 1)
    first_s: Floats
    last_s: Floats
    west_m: float
    north_m: float
    cell_m: float
    margins: Margins

    @property
    def _raster(self) -> tuple[Any, ...]:
        far = self.margins
        return (
            *(self.first_s, self.last_s, self.west_m, self.north_m, self.cell_m),
            *(far.distance_m, far.wind_m * math.cos(far.toward_rad)),
            *(far.wind_m * math.sin(far.toward_rad), far.residence_s),
        )

    def leg_margin_s(
        self, x0_m: float, y0_m: float, t0_s: float, x1_m: float, y1_m: float, t1_s: float
    ) -> float:
        """The least time by which a vehicle on a straight leg is ahead of fire within reach.

        Infinity if none comes; negative where it burns. Danger is less than ``margins.time_s``.
        """
        return float(_leg_margin(*self._raster, x0_m, y0_m, t0_s, x1_m, y1_m, t1_s))

    def surely_in_danger(
        self, x0_m: float, y0_m: float, t0_s: float, x1_m: float, y1_m: float, t1_s: float
    ) -> bool:
        """Whether fire at a corner of a cell is too near a leg: no finer raster can deny that."""
        _, _, west_m, north_m, cell_m, *margins = self._raster
        leg = (x0_m, y0_m, t0_s, x1_m, y1_m, t1_s)
        raster = (self.at_s, west_m, north_m, cell_m, *margins, self.margins.time_s)
        return bool(_surely(*raster, *leg))

    def margins_s(self, x_m: Floats, y_m: Floats, at_s: Floats, spacing_m: float = 0.0) -> Floats:
        """That of each sample (n,); they stand for what is around them, ``spacing_m`` apart."""
        found = np.empty(len(x_m))
        _sample_margins(*self._raster, x_m, y_m, at_s, spacing_m / 2.0, found)
        return found

    def in_danger(
        self, x_m: Floats, y_m: Floats, at_s: Floats, spacing_m: float = 0.0
    ) -> NDArray[np.bool_]:
        """Whether each sample (n,) is in danger."""
        return self.margins_s(x_m, y_m, at_s, spacing_m) < self.margins.time_s


def cell_for(box: Box, margins: Margins) -> float:
    """The size of cells for what can be reached in a box, by the budget of nodes.

    Never more than a third of the distance margin or 3 m, so that large units do not get wide
    margins.
    """
    wide_m = box[2] - box[0] + 2.0 * margins.reach_m
    high_m = box[3] - box[1] + 2.0 * margins.reach_m
    by_budget_m = math.sqrt(wide_m * high_m / NODES)
    return max(LEAST_CELL_M, min(by_budget_m, max(margins.distance_m / 3.0, MOST_CELL_M)))


def fine_cell_m(box: Box, margins: Margins) -> float:
    """The size of cells for a raster around one leg."""
    wide_m = box[2] - box[0] + 2.0 * margins.reach_m
    high_m = box[3] - box[1] + 2.0 * margins.reach_m
    return max(FINE_CELL_M, math.sqrt(wide_m * high_m / FINE_NODES))


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
    around_m = margins.reach_m + SPARE_CELLS * cell
    west, north = box[0] - around_m, box[3] + around_m
    cols = math.ceil((box[2] + around_m - west) / cell)
    rows = math.ceil((north - box[1] + around_m) / cell)
    x = west + cell * np.arange(cols + 1)
    y = north - cell * np.arange(rows + 1)
    nodes = np.stack([np.tile(x, rows + 1), np.repeat(y, cols + 1)], axis=1)
    at_s = np.asarray(fire.ignition_time_s(nodes), np.float64).reshape(rows + 1, cols + 1)
    if np.isnan(at_s).any():
        x_m, y_m = nodes[np.argmax(np.isnan(at_s))]
        raise MissionServiceError(
            f"fire simulation: time of ignition at x {x_m:.1f}, y {y_m:.1f} is not a number; "
            "nothing can be planned on it: erase the last correction"
        )
    at_s = np.maximum(at_s, LONG_AGO_S)
    first, last = np.empty((rows, cols)), np.empty((rows, cols))
    _steep_bounds(at_s, cell, begins_s, first, last)
    _mark_lit(sources_of(fire), west, north, cell, first)
    return Hazard(at_s, first, last, west, north, cell, margins)


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
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(col - 1, 0), min(col + 2, cols)):
                first[r, c] = min(first[r, c], sources[number, 2])


@kernel
def _steep_bounds(at_s, cell, begins, first, last):  # type: ignore[no-untyped-def]
    """From the four corners, by the steepest slope among them and their neighbours.

    That finds fires lit between nodes and ridges where fires meet: all of a cell is within half
    its diagonal of a corner.
    """
    rows, cols = first.shape
    for row in range(rows):
        for col in range(cols):
            low, high, east, south = math.inf, -math.inf, 0.0, 0.0
            for r in range(row, row + 2):
                for c in range(col, col + 2):
                    low, high = min(low, at_s[r, c]), max(high, at_s[r, c])
            if low == math.inf:
                first[row, col], last[row, col] = low, low
                continue
            for r in range(max(row - 1, 0), min(row + 3, rows + 1)):
                for c in range(max(col - 1, 0), min(col + 3, cols + 1)):
                    if at_s[r, c] == math.inf:
                        continue
                    if c + 1 <= cols and at_s[r, c + 1] < math.inf:
                        east = max(east, abs(at_s[r, c + 1] - at_s[r, c]))
                    if r + 1 <= rows and at_s[r + 1, c] < math.inf:
                        south = max(south, abs(at_s[r + 1, c] - at_s[r, c]))
            spare = math.sqrt(0.5) * math.hypot(east, south)
            first[row, col], last[row, col] = max(low - spare, begins), high + spare


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
