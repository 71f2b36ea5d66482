"""Search offline for the best positions of n discs around a static fire.

These positions are a reference for the positions of virtual agents. One disc at a time moves to the
allowed cell with the largest increase in covered weight, which is computed exactly from sums along
rows. The search runs from many starting placements, and then from the best result with some discs
moved at random. Finally, discs are shifted by fractions of a cell.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import kernel
from mission_service.errors import MissionServiceError
from mission_service.guidance.formation.agent_maps import AgentMaps
from mission_service.guidance.formation.map_grid import MapGrid
from mission_service.guidance.formation.settings import Settings

Floats = NDArray[np.float64]
MIN_STEP_CELLS = 1.0 / 16.0
STARTS, KICKS = 8, 40


@dataclass(frozen=True, eq=False)
class Placement:
    """The row and column (n, 2) of each disc's centre, and the fraction of the weight covered."""

    places: Floats
    coverage: float


@kernel
def add_disc(weights, counts, row, col, radius, sign):  # type: ignore[no-untyped-def]
    """Add ``sign`` to ``counts`` within ``radius`` of a position, and return the changed weight.

    The changed weight is the weight that only this disc covers: gained with sign 1, lost with sign
    -1. Lengths are in cells. A cell counts if its centre is within the radius.
    """
    rows, cols = weights.shape
    changed = 0.0
    for r in range(max(math.ceil(row - radius), 0), min(math.floor(row + radius), rows - 1) + 1):
        half = math.sqrt(max(radius * radius - (r - row) ** 2, 0.0))
        for c in range(max(math.ceil(col - half), 0), min(math.floor(col + half), cols - 1) + 1):
            if counts[r, c] == (0 if sign > 0 else 1):
                changed += weights[r, c]
            counts[r, c] += sign
    return changed


@kernel
def covered(weights, counts, places, radius):  # type: ignore[no-untyped-def]
    """Return the weight that discs at ``places`` cover; ``counts`` is all 0 before and after."""
    total = 0.0
    for place in places:
        total += add_disc(weights, counts, place[0], place[1], radius, 1)
    for place in places:
        add_disc(weights, counts, place[0], place[1], radius, -1)
    return total


@kernel
def best_cell(weights, counts, allowed, radius, sums):  # type: ignore[no-untyped-def]
    """Return the allowed cell where a disc adds most to the covered weight, and the increase.

    ``sums`` (rows, cols + 1) is a work array for sums along rows.
    """
    rows, cols = weights.shape
    for r in range(rows):
        sums[r, 0] = 0.0
        for c in range(cols):
            sums[r, c + 1] = sums[r, c] + (weights[r, c] if counts[r, c] == 0 else 0.0)
    reach = math.floor(radius)
    best, best_row, best_col = -1.0, 0, 0
    for row in range(rows):
        for col in range(cols):
            if allowed[row, col]:
                found = 0.0
                for r in range(max(row - reach, 0), min(row + reach, rows - 1) + 1):
                    half = math.floor(math.sqrt(radius * radius - (r - row) ** 2))
                    found += sums[r, min(col + half + 1, cols)] - sums[r, max(col - half, 0)]
                if found > best:
                    best, best_row, best_col = found, row, col
    return best_row, best_col, best


@kernel
def settle(weights, counts, allowed, places, order, radius, sums):  # type: ignore[no-untyped-def]
    """Move each disc in turn to its best cell until no move helps; return the covered weight.

    ``places`` (n, 2) is modified in place; a disc with a negative row has not yet been placed.
    """
    total = 0.0
    for i in order:
        if places[i, 0] >= 0:
            total += add_disc(weights, counts, places[i, 0], places[i, 1], radius, 1)
    gained = True
    while gained:
        gained = False
        for i in order:
            lost = 0.0
            if places[i, 0] >= 0:
                lost = add_disc(weights, counts, places[i, 0], places[i, 1], radius, -1)
            row, col, found = best_cell(weights, counts, allowed, radius, sums)
            if places[i, 0] < 0 or found > lost + 1e-9:
                places[i, 0], places[i, 1] = row, col
                gained = True
            total += add_disc(weights, counts, places[i, 0], places[i, 1], radius, 1) - lost
    for place in places:
        add_disc(weights, counts, place[0], place[1], radius, -1)
    return total


@kernel
def refine(weights, counts, allowed, places, radius):  # type: ignore[no-untyped-def]
    """Shift discs by fractions of a cell while the covered weight increases; return this weight."""
    rows, cols = weights.shape
    total = 0.0
    for place in places:
        total += add_disc(weights, counts, place[0], place[1], radius, 1)
    step = 0.5
    while step >= MIN_STEP_CELLS:
        gained = False
        for place in places:
            for side in range(8):
                row = place[0] + step * round(math.sin(side * math.pi / 4.0))
                col = place[1] + step * round(math.cos(side * math.pi / 4.0))
                r, c = math.floor(row + 0.5), math.floor(col + 0.5)
                if 0 <= r < rows and 0 <= c < cols and allowed[r, c]:
                    lost = add_disc(weights, counts, place[0], place[1], radius, -1)
                    found = add_disc(weights, counts, row, col, radius, 1)
                    if found > lost + 1e-9:
                        place[0], place[1] = row, col
                        total += found - lost
                        gained = True
                    else:
                        add_disc(weights, counts, row, col, radius, -1)
                        add_disc(weights, counts, place[0], place[1], radius, 1)
        if not gained:
            step *= 0.5
    for place in places:
        add_disc(weights, counts, place[0], place[1], radius, -1)
    return total


def coverage(weights: Floats, places: Floats, radius_cells: float) -> float:
    """Return the fraction of the total weight that the discs cover.

    ``weights`` is (rows, cols), and ``places`` (n, 2) are the centres of the discs. For the weights
    of the monitoring-area map, this is the virtual-agent coverage of section 6.2. If all weights
    are 0, the result is 1.
    """
    total = float(weights.sum())
    if total == 0.0:
        return 1.0
    counts = np.zeros(weights.shape, dtype=np.int64)
    places = np.asarray(places, dtype=np.float64).reshape(-1, 2)
    return float(covered(weights.astype(np.float64), counts, places, radius_cells)) / total


def best_placement(
    weights: Floats,
    allowed: NDArray[np.bool_],
    count: int,
    radius_cells: float,
    *,
    seed: int = 0,
    starts: int = STARTS,
    kicks: int = KICKS,
) -> Placement:
    """Return the best positions found for ``count`` discs on ``allowed`` cells (rows, cols).

    The same seed gives the same positions. Raises MissionServiceError if ``count`` is less than 1,
    or if no allowed cell is near a weight.
    """
    cells = np.argwhere(allowed & _near(weights > 0, radius_cells))
    if count < 1 or not cells.size:
        raise MissionServiceError(
            f"placement: {count} discs on {np.count_nonzero(allowed)} allowed cells; none can "
            "cover a cell with a weight"
        )
    north, west = cells.min(axis=0)
    box = np.s_[north : cells[:, 0].max() + 1, west : cells[:, 1].max() + 1]
    # The box also contains all weights.
    box = _joined(box, weights > 0)
    corner = np.array([box[0].start, box[1].start])
    near = np.zeros(weights.shape, dtype=np.bool_)
    near[cells[:, 0], cells[:, 1]] = True
    part = np.ascontiguousarray(weights[box], dtype=np.float64)
    free = np.ascontiguousarray(near[box])
    counts = np.zeros(part.shape, dtype=np.int64)
    sums = np.empty((part.shape[0], part.shape[1] + 1))
    rng = np.random.default_rng(seed)
    best, best_places = -1.0, np.empty((0, 2))
    for attempt in range(starts + kicks):
        if attempt == 0:
            places = np.full((count, 2), -1.0)  # -1: the disc has not yet been placed
        elif attempt < starts:
            places = (cells[rng.integers(len(cells), size=count)] - corner).astype(np.float64)
        else:
            places = best_places.copy()
            moved = rng.permutation(count)[: rng.integers(1, max(count // 2, 1) + 1)]
            places[moved] = (cells[rng.integers(len(cells), size=moved.size)] - corner).astype(
                float
            )
        order = rng.permutation(count)
        found = float(settle(part, counts, free, places, order, radius_cells, sums))
        if found > best + 1e-9:
            best, best_places = found, places
        if best >= weights.sum() - 1e-9:
            break
    best = float(refine(part, counts, free, best_places, radius_cells))
    return Placement(best_places + corner, best / float(weights.sum()))


def best_around(
    fire: NDArray[np.bool_],
    grid: MapGrid,
    settings: Settings,
    count: int,
    seed: int = 0,
    starts: int = STARTS,
    kicks: int = KICKS,
) -> Placement:
    """Return the best positions found for ``count`` virtual agents around a fire (y, x)."""
    maps = maps_of(np.flatnonzero(fire), grid, settings)
    return best_placement(
        weights_of(maps),
        maps.augmentation == 0,
        count,
        settings.coverage_radius_m / grid.cell_m,
        seed=seed,
        starts=starts,
        kicks=kicks,
    )


def maps_of(fire: NDArray[np.int64], grid: MapGrid, settings: Settings) -> AgentMaps:
    """Return the maps of an agent that has received all burned cells; ``fire`` (n) lists them."""
    radii_m = (settings.augmentation_m(grid.cell_m), settings.agent_area_m, settings.monitoring_m)
    maps = AgentMaps(grid.shape, grid.cell_m, *radii_m)
    maps.set(fire, np.empty(0, dtype=np.int64))
    return maps


def weights_of(maps: AgentMaps) -> Floats:
    """Return the monitoring-area map (y, x) of section 3.4.

    A weight is 1 near fire, 0.2 farther away but within d_mon, and 0 elsewhere and on fire.
    """
    weights = np.where(maps.augmentation > 0, 1.0, np.where(maps.monitored > 0, 0.2, 0.0))
    return np.where(maps.fire, 0.0, weights)


def _near(cells: NDArray[np.bool_], radius_cells: float) -> NDArray[np.bool_]:
    from scipy.ndimage import distance_transform_edt

    if not cells.any():
        return np.zeros(cells.shape, dtype=np.bool_)
    return np.asarray(distance_transform_edt(~cells) <= radius_cells, dtype=np.bool_)


def _joined(box: tuple[slice, slice], cells: NDArray[np.bool_]) -> tuple[slice, slice]:
    found = np.argwhere(cells)
    low, high = found.min(axis=0), found.max(axis=0) + 1
    return (
        slice(min(box[0].start, int(low[0])), max(box[0].stop, int(high[0]))),
        slice(min(box[1].start, int(low[1])), max(box[1].stop, int(high[1]))),
    )
