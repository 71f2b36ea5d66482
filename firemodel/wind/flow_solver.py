"""Solve the equations of the mass-consistent wind by conjugate gradients.

The preconditioner is a multigrid cycle in single precision. Each of its grids has half as many
columns in each horizontal direction as the one before, and the same levels: columns are solved
exactly, because the layers near the ground are much thinner than the cells are wide.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.wind import flow_kernels as kernels
from firemodel.wind.flow_grid import FlowGrid, block_means

Stack = NDArray[np.float32]
Initial = tuple[Stack | None, Stack | None]  # speed (n, y, x) towards east, and towards south
DAMPING = np.float32(0.85)
MAX_STEPS = 200
COARSEST = 3  # columns and rows of the coarsest grid
COARSEST_SWEEPS = 6


class Potential(NamedTuple):
    """The potential (n + 1, y, x) of a correction, with margins; ``steps`` counts solver steps.

    ``divergence_1_s`` is the largest divergence of the corrected wind.
    """

    phi: Floats
    divergence_1_s: float
    steps: int


class Coefficients(NamedTuple):
    """The coefficients of the equations on one grid (see ``flow_kernels``)."""

    ground: NDArray[np.floating]  # (6, y, x)
    layers: NDArray[np.floating]  # (4, n + 1)
    face_depth: NDArray[np.floating]  # (2, y, x), depth at the faces over cell size

    def narrow(self) -> "Coefficients":
        """Return the coefficients in single precision."""
        return Coefficients(*(part.astype(np.float32) for part in self))


def coefficients(
    elevation_m: Floats, cell_m: float, top_m: float, levels: Floats, alpha_ratio: float
) -> Coefficients:
    """Return the coefficients for elevations (y, x) without margin.

    ``alpha_ratio`` is the ratio of the horizontal to the vertical precision modulus (alpha_1 and
    alpha_2 in Sherman 1978): a small value permits little vertical motion.
    """
    height = np.pad(elevation_m, 1, mode="edge")
    depth = top_m - height
    ground = np.zeros((6, *height.shape))
    face_depth = np.zeros((2, *height.shape))
    rise_right, rise_below = np.diff(height, axis=1), np.diff(height, axis=0)
    face_depth[0, :, :-1] = 0.5 * (depth[:, 1:] + depth[:, :-1]) / cell_m
    face_depth[1, :-1] = 0.5 * (depth[1:] + depth[:-1]) / cell_m
    ground[kernels.RIGHT] = face_depth[0] / cell_m
    ground[kernels.BELOW] = face_depth[1] / cell_m
    # The potential is 0 on the outer faces, half a cell from the centres of the first columns.
    ground[kernels.RIGHT, :, [0, -2]] *= 2.0
    ground[kernels.BELOW, [0, -2]] *= 2.0
    ground[kernels.RISE_RIGHT, :, :-1] = rise_right / (4.0 * cell_m**2)
    ground[kernels.RISE_BELOW, :-1] = rise_below / (4.0 * cell_m**2)
    ground[kernels.INVERSE_DEPTH] = 1.0 / depth
    across = (rise_right / cell_m) ** 2 / (face_depth[0, :, :-1] * cell_m)
    along = (rise_below / cell_m) ** 2 / (face_depth[1, :-1] * cell_m)
    slopes = ground[kernels.SLOPES]
    slopes[:, :-1] += 0.5 * across
    slopes[:, 1:] += 0.5 * across
    slopes[:-1] += 0.5 * along
    slopes[1:] += 0.5 * along
    return Coefficients(ground, _layer_table(levels, alpha_ratio), face_depth)


def _layer_table(levels: Floats, alpha_ratio: float) -> Floats:
    thick = np.diff(levels)
    taper = 1.0 - 0.5 * (levels[1:] + levels[:-1])
    table = np.zeros((4, len(levels)))
    table[kernels.TAPER, 1:] = taper
    table[kernels.INVERSE, 1:] = alpha_ratio**2 / thick
    table[kernels.TAPER2, 1:] = taper**2 / thick
    table[kernels.WIDTH, :-1] = 0.5 * thick
    table[kernels.WIDTH, 1:] += 0.5 * thick
    return table


class MultigridCycle:
    """An approximate, symmetric inverse of the equations, in single precision."""

    def __init__(self, grid: FlowGrid, alpha_ratio: float) -> None:
        """Compute coefficients and column factors on all grids; the finest is the first."""
        self._levels: list[tuple[Coefficients, Stack]] = []
        self._work: list[tuple[Stack, Stack, Stack]] = []
        elevation_m, cell_m = grid.elevation_m, grid.cell_m
        while True:
            found = coefficients(elevation_m, cell_m, grid.top_m, grid.levels, alpha_ratio).narrow()
            shape = (len(grid.levels), *found.ground.shape[1:])
            pivot = np.zeros(shape, np.float32)
            kernels.factor_columns(pivot, found.ground, found.layers)
            self._levels.append((found, pivot))
            self._work.append(tuple(np.zeros(shape, np.float32) for _ in range(3)))  # type: ignore[arg-type]
            if max(elevation_m.shape) <= COARSEST:
                break
            elevation_m, cell_m = block_means(elevation_m, 2), 2.0 * cell_m

    def source(self) -> Stack:
        """Return the array for the right-hand side of the finest grid."""
        return self._work[0][0]

    def solution(self, at: int = 0) -> Stack:
        """Compute and return the approximate solution for the right-hand side on a grid."""
        (found, pivot), (source, phi, image) = self._levels[at], self._work[at]
        tables = (found.ground, found.layers)
        kernels.solve_columns(source, phi, DAMPING, pivot, *tables)
        last = at + 1 == len(self._levels)
        if not last:
            kernels.apply_flow(phi, image, *tables)
            kernels.restrict_residual(source, image, self._work[at + 1][0])
            kernels.add_interpolated(self.solution(at + 1), phi)
        for _ in range(COARSEST_SWEEPS if last else 1):
            kernels.apply_flow(phi, image, *tables)
            kernels.improve_columns(phi, source, image, DAMPING, pivot, *tables)
        return phi


def solve_potential(
    grid: FlowGrid, initial: Initial, alpha_ratio: float, tolerance_1_s: float
) -> Potential:
    """Return the potential that makes an initial wind divergence-free.

    Args:
        grid: The grid.
        initial: The mean initial speeds in m/s in the volumes around the levels, with the buffer,
            without margin; None means 0.
        alpha_ratio: See ``coefficients``.
        tolerance_1_s: The largest divergence in 1/s that may remain.

    Raises:
        FireModelError: The divergence stays above the tolerance.
    """
    cycle = MultigridCycle(grid, alpha_ratio)
    found = coefficients(grid.elevation_m, grid.cell_m, grid.top_m, grid.levels, alpha_ratio)
    tables = (found.ground, found.layers)
    shape = (len(grid.levels), *found.ground.shape[1:])
    phi, residual, direction, image = (np.zeros(shape) for _ in range(4))
    for speed, eastward in zip(initial, (True, False), strict=True):
        if speed is not None:
            kernels.add_divergence(
                speed, residual, eastward, *tables, found.face_depth, grid.cell_m
            )
    source = cycle.source()
    largest = kernels.step_along(phi, residual, source, direction, image, 0.0, *tables)
    former = 1.0
    for step in range(MAX_STEPS):
        if largest <= tolerance_1_s:
            return Potential(phi, largest, step)
        improved = cycle.solution()
        product = kernels.dot(residual, improved)
        kernels.turn_direction(direction, improved, product / former if step else 0.0)
        former = product
        kernels.apply_flow(direction, image, *tables)
        length = product / kernels.dot(direction, image)
        largest = kernels.step_along(phi, residual, source, direction, image, length, *tables)
    raise FireModelError(
        f"wind over terrain: the divergence is still {largest:.2g} 1/s after {MAX_STEPS} steps; "
        "the ground may be too steep (cliffs in the elevation?): smooth it or use larger cells"
    )
