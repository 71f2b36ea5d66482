"""The wind over a landscape for any speed and direction, from solutions for two directions."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import bilinear
from firemodel.wind import flow_kernels as kernels
from firemodel.wind.flow_grid import FlowGrid, block_means, flow_grid
from firemodel.wind.flow_solver import (
    Coefficients,
    Initial,
    Potential,
    coefficients,
    solve_potential,
)
from firemodel.wind.vegetation import (
    REFERENCE_M,
    Surface,
    mean_roughness_m,
    profile_at,
    profile_means,
)

MAX_COLUMNS = 500_000  # larger landscapes are solved with larger cells
MAX_DIVERGENCE = 5e-7  # largest divergence that remains, in units of reference speed over cell size
NEUTRAL_ALPHA_RATIO = 1.0
MapFunction = Callable[[Callable[[Initial], Potential], list[Initial]], Iterable[Potential]]


@dataclass(frozen=True, eq=False)
class TerrainWind:
    """Corrections of the wind for a reference wind of 1 m/s towards east, and towards south.

    ``factor`` by ``factor`` cells of the landscape form one column of the grid. ``surface`` is the
    surface of the grid without its buffer. ``divergence`` is the largest divergence that remains,
    in units of reference speed over cell size. ``steps`` counts the solver's steps.
    """

    grid: FlowGrid
    surface: Surface
    rough_m: float
    reference_m: float
    alpha_ratio: float
    potentials: tuple[Floats, Floats]
    tables: Coefficients
    factor: int
    shape: tuple[int, int]
    divergence: float
    steps: int

    def responses(self, above_vegetation_m: float) -> NDArray[np.float32]:
        """Return the wind (2, 2, y, x) of each cell of the landscape at a height.

        The first axis is the reference wind (1 m/s towards north, and towards east), the second
        the component of the local wind (towards north, and towards east).
        """
        rows, cols = np.indices(self.grid.shape).reshape(2, -1)
        above_m = self.surface.height_m.ravel() + above_vegetation_m
        found = self._columns(rows, cols, above_m).reshape(2, 2, *self.grid.shape)
        return self.refined(found)

    def corrections(self, phi: Floats, above_m: Floats) -> Floats:
        """Return the correction (2, y, x) of a potential in each column of the grid.

        ``above_m`` (y, x) contains heights above the ground. The components of the correction are
        towards east and south.
        """
        rows, cols = np.indices(self.grid.shape).reshape(2, -1)
        return self._corrections(phi, rows, cols, above_m.ravel()).reshape(2, *self.grid.shape)

    def refined(self, values: Floats) -> NDArray[np.float32]:
        """Return values (..., rows, columns of the grid) for each cell of the landscape."""
        if self.factor == 1:
            return values.astype(np.float32)
        at_row, at_col = ((np.arange(size) + 0.5) / self.factor - 0.5 for size in self.shape)
        fine = np.empty((*values.shape[:-2], *self.shape), dtype=np.float32)
        for index in np.ndindex(*values.shape[:-2]):
            fine[index] = bilinear(values[index], at_row[:, None], at_col[None, :])
        return fine

    def responses_at(self, row: Floats, col: Floats, above_ground_m: Floats) -> Floats:
        """Return the wind (2, 2, m) at positions (m) of the landscape and heights (m).

        The axes are those of ``responses``; the result is interpolated bilinearly. Positions
        outside the landscape have the wind at the landscape's edge.
        """
        scaled = [(np.asarray(at, dtype=np.float64) + 0.5) / self.factor - 0.5 for at in (row, col)]
        sizes = self.grid.shape
        places = [np.clip(at, 0.0, size - 1.0) for at, size in zip(scaled, sizes, strict=True)]
        first = [np.floor(at).astype(np.int64) for at in places]
        total = np.zeros((2, 2, len(places[0])))
        for down in (0, 1):
            for right in (0, 1):
                corner = [
                    np.minimum(base + step, size - 1)
                    for base, step, size in zip(first, (down, right), sizes, strict=True)
                ]
                weight = np.prod(
                    [
                        1.0 - np.abs(at - base - step)
                        for at, base, step in zip(places, first, (down, right), strict=True)
                    ],
                    axis=0,
                )
                above_m = np.asarray(above_ground_m, np.float64)
                total += weight * self._columns(corner[0], corner[1], above_m)
        return total

    def lowest_m(self, row: float, col: float) -> float:
        """Return the height above the ground up to which the initial wind at a position is 0."""
        cell = tuple(
            min(max(int((at + 0.5) / self.factor), 0), size - 1)
            for at, size in zip((row, col), self.grid.shape, strict=True)
        )
        return float(self.surface.displacement_m[cell] + self.surface.roughness_m[cell])

    def _corrections(
        self, phi: Floats, rows: NDArray[np.int64], cols: NDArray[np.int64], above_m: Floats
    ) -> Floats:
        """Return the correction (2, m) towards east and south in columns (m) at heights."""
        inner, out = self.grid.inner, np.empty((2, len(rows)))
        shares = above_m / self.grid.depth_m[inner][rows, cols]
        at = rows + inner[0].start + 1, cols + inner[1].start + 1
        kernels.corrections_at(phi, *at, shares, self.grid.centres, out, *self.tables)
        return out

    def _columns(self, rows: NDArray[np.int64], cols: NDArray[np.int64], above_m: Floats) -> Floats:
        """Return the wind (2, 2, m) in columns (m) at heights above the ground."""
        surface = Surface(*(part[rows, cols] for part in self.surface))
        initial = profile_at(above_m, surface, self.rough_m, self.reference_m)
        by_east, by_south = (self._corrections(phi, rows, cols, above_m) for phi in self.potentials)
        by_east[0] += initial
        by_south[1] += initial
        # From axes (east, south) to (north, east), for the reference wind and for the local wind.
        return np.array([[by_south[1], -by_south[0]], [-by_east[1], by_east[0]]])


def terrain_wind(
    elevation_m: NDArray[np.floating],
    cell_m: float,
    surface: Surface,
    reference_m: float = REFERENCE_M,
    alpha_ratio: float = NEUTRAL_ALPHA_RATIO,
    max_columns: int = MAX_COLUMNS,
    run: MapFunction = map,
) -> TerrainWind:
    """Solve the wind over terrain for two directions.

    The initial wind has the same speed and direction everywhere at ``reference_m`` above the
    vegetation, and a logarithmic profile. The result is the divergence-free wind that differs least
    from the initial wind (Sasaki 1970, Mon. Wea. Rev. 98, 875; Sherman 1978, J. Appl. Meteor. 17,
    312), with open sides and an open top, as in WindNinja (Forthofer et al. 2014, IJWF 23, 969).

    Args:
        elevation_m: (y, x), row 0 in the north.
        cell_m: The size of the square cells in metres.
        surface: The vegetation of each cell (y, x).
        reference_m: The height of the reference wind above the vegetation.
        alpha_ratio: The ratio of the horizontal to the vertical precision modulus: 1 in neutral air
            (Forthofer et al. 2014); a smaller value means less vertical motion, as in stable air.
        max_columns: If the landscape has more cells, n by n cells form one column, with the
            smallest sufficient n.
        run: Calls a function for each direction, like ``map``; for example that of an executor.

    Returns:
        The solutions, which give the wind for any speed and direction.

    Raises:
        FireModelError: An elevation is missing, or the solver does not converge.
    """
    factor = 1
    while -(-elevation_m.shape[0] // factor) * -(-elevation_m.shape[1] // factor) > max_columns:
        factor += 1
    grid = flow_grid(block_means(elevation_m, factor), factor * cell_m)
    coarse = Surface(*(block_means(part, factor) for part in surface))
    wide = Surface(*(np.pad(part, grid.margins, mode="edge") for part in coarse))
    profile = profile_means(grid, wide, reference_m)

    def solve(initial: Initial) -> Potential:
        return solve_potential(grid, initial, alpha_ratio, MAX_DIVERGENCE / grid.cell_m)

    found = list(run(solve, [(profile, None), (None, profile)]))
    return TerrainWind(
        grid,
        coarse,
        mean_roughness_m(wide),
        reference_m,
        alpha_ratio,
        (found[0].phi, found[1].phi),
        coefficients(grid.elevation_m, grid.cell_m, grid.top_m, grid.levels, alpha_ratio),
        factor,
        (elevation_m.shape[0], elevation_m.shape[1]),
        max(each.divergence_1_s for each in found) * grid.cell_m,
        max(each.steps for each in found),
    )


def local_wind(
    responses: NDArray[np.floating], speed_m_s: float, from_deg: float
) -> NDArray[np.floating]:
    """Return the local wind for a reference wind.

    Args:
        responses: (2, 2, ...) of ``TerrainWind.responses`` or ``responses_at``.
        speed_m_s: The speed of the reference wind.
        from_deg: The direction from which the wind blows, clockwise from grid north.

    Returns:
        The wind (2, ...) towards grid north and towards grid east in m/s.

    Raises:
        FireModelError: The speed is negative or not finite, or the direction is not finite.
    """
    if not (np.isfinite(speed_m_s) and speed_m_s >= 0.0 and np.isfinite(from_deg)):
        raise FireModelError(
            f"wind over terrain: speed {speed_m_s} m/s from {from_deg}° is not a valid wind"
        )
    toward = np.deg2rad(from_deg + 180.0)
    wind: NDArray[np.floating] = speed_m_s * (
        np.cos(toward) * responses[0] + np.sin(toward) * responses[1]
    )
    return wind
