"""Describe wind that varies from place to place, relative to the wind of a weather entry.

A wind is a complex number in m/s: the component toward grid north, plus i times the component
toward grid east. Multiplying two such numbers multiplies the speeds and adds the directions
(clockwise). The local wind is the entry's wind times a local ratio. A change in the entry's wind
(ensemble errors, learned inputs, a wind report) therefore changes the wind everywhere by the same
factor and angle.
"""

import cmath
import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.errors import FireModelError

MAX_GRIDS_OF_FIELD = 2  # maximum number of grids in the sum of a field
OPPOSED = 1e-6  # a vector mean below this fraction of the mean speed has no direction
ROWS_AT_ONCE = 256  # grids are summed in blocks to save memory


class WindGrids:
    """Grids of wind vectors that several fields share; compared by identity."""

    def __init__(self, toward: NDArray[np.floating]) -> None:
        """Store grids of winds or of ratios.

        Args:
            toward: (grids, 2, y, x) the components toward grid north and grid east.

        Raises:
            FireModelError: The array has another shape, or a value is not a finite number.
        """
        values = np.ascontiguousarray(toward, dtype=np.float32)
        if values.ndim != 4 or values.shape[1] != 2 or values.size == 0:
            raise FireModelError(
                f"wind field: has the shape {values.shape}, but must have (grids, 2, rows, columns)"
            )
        if not np.isfinite(values).all():
            raise FireModelError("wind field: contains values that are not finite numbers")
        self.toward = values

    @cached_property
    def cells(self) -> NDArray[np.float32]:
        """The same values with flattened cells (grids, 2, n)."""
        return self.toward.reshape(*self.toward.shape[:2], -1)

    def digest(self) -> str:
        """Return the SHA-256 of the shape and the values."""
        return hashlib.sha256(repr(self.toward.shape).encode() + self.toward.tobytes()).hexdigest()

    def __getstate__(self) -> dict[str, object]:
        """Return the attributes for a pickle, without the second view of the values."""
        return {"toward": self.toward}


@dataclass(frozen=True, slots=True)
class WindField:
    """The ratio of the local wind to the wind of a weather entry.

    The ratio is the sum of one or two ``grids``, each multiplied by a complex number: ``parts``
    contains pairs of a grid's index and its factor. A field between two grids of a stack can thus
    be interpolated without an additional grid.
    """

    grids: WindGrids
    parts: tuple[tuple[int, complex], ...]
    toward_grid_deg: float | None = None  # the entry's wind, if the ratio depends on its direction

    def __post_init__(self) -> None:
        """Raise FireModelError for parts that do not fit the grids."""
        known = all(0 <= number < len(self.grids.toward) for number, _ in self.parts)
        if not (1 <= len(self.parts) <= MAX_GRIDS_OF_FIELD and known):
            raise FireModelError(
                f"wind field: parts = {self.parts}; they must be one or two of the grids 0 to "
                f"{len(self.grids.toward) - 1}"
            )

    @property
    def grid_shape(self) -> tuple[int, int]:
        """The number of rows and the number of columns."""
        rows, cols = self.grids.toward.shape[2:]
        return rows, cols

    def ratio(self) -> NDArray[np.float32]:
        """Return the ratio (2, y, x): the real and the imaginary part."""
        found = np.empty((2, *self.grid_shape), dtype=np.float32)
        for rows in _blocks(self.grids):
            total = _sum(self.grids, self.parts, rows)
            found[0, rows], found[1, rows] = total.real, total.imag
        return found

    def turned(self, turn_deg: float) -> "WindField":
        """Return the field for the entry's wind turned clockwise."""
        if self.toward_grid_deg is None:
            return self
        return response_field(self.grids, self.toward_grid_deg + turn_deg)


def response_field(grids: WindGrids, toward_grid_deg: float) -> WindField:
    """Return the field of an entry's wind in this direction, from the terrain's responses.

    The two grids are the local wind for an entry's wind of 1 m/s toward grid north, and toward grid
    east. The local wind for any other direction is a weighted sum of these two local winds.
    """
    toward = cmath.rect(1.0, math.radians(toward_grid_deg))
    parts = ((0, toward.real / toward), (1, toward.imag / toward))
    return WindField(grids, parts, toward_grid_deg % 360.0)


class MeanWind(NamedTuple):
    """The wind of a whole grid: its mean, and the local wind relative to the mean."""

    speed_m_s: float
    toward_grid_deg: float
    field: WindField | None  # None in calm air


def field_of(ratio: NDArray[np.floating]) -> WindField:
    """Return the field of a ratio (2, y, x): the real and the imaginary part.

    The local wind is the entry's wind, multiplied by the modulus of the ratio and turned clockwise
    by its argument. Raises FireModelError for an array of another shape.
    """
    return WindField(WindGrids(np.asarray(ratio)[None]), ((0, 1.0 + 0.0j),))


def mean_wind(grids: WindGrids, shares: Sequence[tuple[int, float]]) -> MeanWind:
    """Return the wind of a weighted sum of wind grids (m/s), relative to its mean.

    The speed is the mean of the local speeds, and the direction is that of the mean vector. If
    local winds cancel each other, the direction is grid north; in calm air there is no field.

    Args:
        grids: The grids.
        shares: The index and the weight of one or two grids.
    """
    speeds, vectors, count = 0.0, 0.0j, 0
    for rows in _blocks(grids):
        total = _sum(grids, shares, rows)
        speeds, vectors = speeds + float(np.abs(total).sum()), vectors + complex(total.sum())
        count += total.size
    speed_m_s, vector = speeds / count, vectors / count
    if speed_m_s == 0.0:
        return MeanWind(0.0, 0.0, None)
    toward = cmath.phase(vector) if abs(vector) > OPPOSED * speed_m_s else 0.0
    mean = cmath.rect(speed_m_s, toward)
    parts = tuple((number, share / mean) for number, share in shares)
    return MeanWind(speed_m_s, math.degrees(toward) % 360.0, WindField(grids, parts))


def _blocks(grids: WindGrids) -> Iterator[slice]:
    for top in range(0, grids.toward.shape[2], ROWS_AT_ONCE):
        yield slice(top, top + ROWS_AT_ONCE)


def _sum(
    grids: WindGrids, parts: Sequence[tuple[int, complex]], rows: slice
) -> NDArray[np.complex128]:
    """Return the sum of grids, each multiplied by a number, in the given rows."""
    found: Any = 0.0
    for number, factor in parts:
        north, east = grids.toward[number, :, rows].astype(np.float64)
        found = found + factor * (north + 1j * east)
    return np.asarray(found)
