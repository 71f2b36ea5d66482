"""Estimate the wind over terrain from measurements at several places and heights."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.wind.terrain_wind import TerrainWind

LENGTH_M = 5000.0
DEVIATION_M_S = 1.0
ROWS_AT_ONCE = 64
MAX_SPEED_M_S = 100.0


class MeasuredWind(NamedTuple):
    """A wind measured by a station or an aircraft.

    The position is in rows and columns of the landscape (see ``Landscape``). ``from_deg`` is
    clockwise from grid north. ``sd_m_s`` is the standard deviation of the error in each component;
    a measurement with twice the deviation has a quarter of the weight.
    """

    row: float
    col: float
    above_ground_m: float
    speed_m_s: float
    from_deg: float
    sd_m_s: float = 1.0


class FittedWind(NamedTuple):
    """The spatially varying reference wind that was fitted to measurements.

    The reference wind at a position (speeds towards north and east, in m/s) is ``mean`` plus the
    covariances with the measured positions times ``gains`` (m, 2).
    """

    mean: Floats
    rows: Floats
    cols: Floats
    gains: Floats
    length_cells: float

    @property
    def speed_m_s(self) -> float:
        """The speed of the mean reference wind."""
        return float(np.hypot(*self.mean))

    @property
    def from_deg(self) -> float:
        """The direction of the mean reference wind, clockwise from grid north."""
        north, east = self.mean
        return math.degrees(math.atan2(-east, -north)) % 360.0

    def reference_at(self, row: Floats, col: Floats) -> Floats:
        """Return the reference wind (2, m) at positions (m)."""
        distance = np.hypot(row[:, None] - self.rows, col[:, None] - self.cols)
        weights = np.exp(-distance / self.length_cells)
        return self.mean[:, None] + (weights @ self.gains).T

    def wind_at(
        self, terrain: TerrainWind, row: Floats, col: Floats, above_ground_m: Floats
    ) -> Floats:
        """Return the wind (2, m) towards north and east at positions and heights (m)."""
        responses = terrain.responses_at(row, col, above_ground_m)
        found: Floats = np.einsum("rcm,rm->cm", responses, self.reference_at(row, col))
        return found

    def wind_of_cells(self, responses: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the wind (2, y, x) of each cell from the terrain's responses (2, 2, y, x)."""
        rows, cols = responses.shape[2:]
        wind = np.empty((2, rows, cols), dtype=np.float32)
        for top in range(0, rows, ROWS_AT_ONCE):
            block = responses[:, :, top : top + ROWS_AT_ONCE]
            row, col = np.indices(block.shape[2:]).reshape(2, -1).astype(np.float64)
            reference = self.reference_at(row + top, col).reshape(2, *block.shape[2:])
            wind[:, top : top + ROWS_AT_ONCE] = np.einsum("rcyx,ryx->cyx", block, reference)
        return wind


def fit_wind(
    terrain: TerrainWind,
    measured: Sequence[MeasuredWind],
    length_m: float = LENGTH_M,
    deviation_m_s: float = DEVIATION_M_S,
) -> FittedWind:
    """Return the reference wind that best fits the measurements.

    The wind at a place is the response of the terrain to a reference wind that varies slowly in
    space: an unknown mean plus a Gaussian process with an exponential covariance (universal
    kriging; Cressie 1993, Statistics for Spatial Data, ch. 3). The mean is estimated by generalised
    least squares. Because all measurements are fitted by one reference wind, those of an
    aircraft high above a valley also improve the wind at the ground. Where the reference wind
    varies, the result has a divergence of about ``deviation_m_s / length_m``.

    Args:
        terrain: The solutions for the landscape.
        measured: At least one measurement.
        length_m: The distance over which the covariance falls to 1/e.
        deviation_m_s: The standard deviation of the process; 0 gives one reference wind.

    Returns:
        The reference wind, which ``FittedWind.wind_at`` and ``wind_of_cells`` turn into winds.

    Raises:
        FireModelError: There is no measurement, or one is impossible or too close to the ground.
    """
    if not measured:
        raise FireModelError("measured wind: no measurements; specify at least one")
    for number, each in enumerate(measured):
        _check(number, each, terrain)
    rows, cols, above_m, speeds, from_deg, sd = np.array(measured, dtype=np.float64).T
    responses = terrain.responses_at(rows, cols, above_m)
    toward = np.deg2rad(from_deg + 180.0)
    values = np.stack([speeds * np.cos(toward), speeds * np.sin(toward)], axis=1).ravel()
    # Rows of ``design`` are components of measurements, columns components of the reference wind.
    count = len(measured)
    design = responses.transpose(2, 1, 0)  # (m, component, reference)
    length_cells = length_m * terrain.factor / terrain.grid.cell_m
    distance = np.hypot(rows[:, None] - rows, cols[:, None] - cols)
    shared = deviation_m_s**2 * np.exp(-distance / length_cells)
    covariance = np.einsum("icr,ij,jdr->icjd", design, shared, design)
    covariance = covariance.reshape(2 * count, 2 * count) + np.diag(np.repeat(sd**2, 2))
    mean_of = design.reshape(2 * count, 2)
    solved = np.linalg.solve(covariance, np.column_stack([mean_of, values]))
    mean = np.linalg.solve(mean_of.T @ solved[:, :2], mean_of.T @ solved[:, 2])
    rest = (solved[:, 2] - solved[:, :2] @ mean).reshape(count, 2)
    gains = deviation_m_s**2 * np.einsum("icr,ic->ir", design, rest)
    return FittedWind(mean.astype(np.float64), rows, cols, gains, length_cells)


def _check(number: int, each: MeasuredWind, terrain: TerrainWind) -> None:
    def fail(reason: str) -> FireModelError:
        return FireModelError(f"measured wind {number}: {reason}")

    if not all(map(math.isfinite, each)):
        raise fail(f"{each} has a value that is not a number")
    rows, cols = terrain.shape
    if not (-0.5 <= each.row <= rows - 0.5 and -0.5 <= each.col <= cols - 0.5):
        raise fail(f"row {each.row:.1f}, column {each.col:.1f} is outside the landscape")
    if not (0.0 <= each.speed_m_s <= MAX_SPEED_M_S and 0.01 <= each.sd_m_s <= MAX_SPEED_M_S):
        raise fail(
            f"speed {each.speed_m_s:g} m/s, sd {each.sd_m_s:g} m/s; the speed must be 0 to 100 "
            "m/s, and the standard deviation 0.01 to 100 m/s"
        )
    lowest_m = terrain.lowest_m(each.row, each.col)
    if each.above_ground_m <= lowest_m:
        raise fail(
            f"{each.above_ground_m:g} m above ground is within the vegetation, where the profile "
            f"is 0 up to {lowest_m:.2f} m; specify the height of the instrument above the ground"
        )
