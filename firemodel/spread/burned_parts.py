"""Compute the burned area within cells from the arrival times at the nodes of the lattice.

Counting the cells whose centre has been reached is biased where fuels meet: fire passes round a
slow cell and reaches its centre last, so the cell's burned rim is not counted.
"""

import math

from firemodel.compiled import inlined, kernel
from firemodel.spread.labels import key_of
from firemodel.spread.travel_time import STEP_COL, STEP_ROW


@inlined
def triangle_share(one_s, two_s, three_s, at_s):  # type: ignore[no-untyped-def]
    """Return the burned fraction of a triangle with the given arrival times at its corners.

    The arrival time varies linearly within the triangle.
    """
    first, last = min(one_s, two_s, three_s), max(one_s, two_s, three_s)
    middle = max(min(one_s, two_s), min(max(one_s, two_s), three_s))
    if at_s >= last:
        return 1.0
    if at_s <= first:
        return 0.0
    if at_s < middle:
        return (at_s - first) * (at_s - first) / ((middle - first) * (last - first))
    return 1.0 - (last - at_s) * (last - at_s) / ((last - middle) * (last - first))


@kernel
def burned_cells(at_s, arrival_s, labels, lattice):  # type: ignore[no-untyped-def]
    """Return the burned area at the given time, in cells.

    Each cell is divided into triangles between its centre and two neighbouring nodes on its edge. A
    cell of an initial fire counts in full.
    """
    total, per_side = 0.0, 2 // lattice.step  # number of triangles on each side of a cell
    for row in range(lattice.rows):
        for col in range(lattice.cols):
            key = key_of(2 * row + 1, 2 * col + 1, lattice)
            centre_s = labels.best_s[key]
            if labels.source[key] < 0 or not math.isfinite(centre_s):
                total += 1.0 if arrival_s[row, col] <= at_s else 0.0
                continue
            first_s = last_s = centre_s
            for side in range(1, 9, lattice.step):  # corners are in every second direction
                i, j = 2 * row + 1 + STEP_ROW[side % 8], 2 * col + 1 + STEP_COL[side % 8]
                time_s = labels.best_s[key_of(i, j, lattice)]
                if math.isfinite(time_s):
                    first_s, last_s = min(first_s, time_s), max(last_s, time_s)
            if at_s < first_s:
                continue
            before_s = 0.0
            for side in range(1, 10, lattice.step):
                i, j = 2 * row + 1 + STEP_ROW[side % 8], 2 * col + 1 + STEP_COL[side % 8]
                time_s = labels.best_s[key_of(i, j, lattice)]
                if not math.isfinite(time_s):
                    time_s = last_s  # fire does not pass this corner
                if side > 1:
                    share = triangle_share(before_s, time_s, centre_s, at_s)
                    total += share / (4.0 * per_side)
                before_s = time_s
    return total
