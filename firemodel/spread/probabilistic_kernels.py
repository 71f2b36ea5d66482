"""Compute one update of the automaton: the inner loop of ``probabilistic``."""

import numpy as np

from firemodel.compiled import kernel

# North, east, south, west as steps of (row, col).
STEP_ROW = np.array([-1, 0, 1, 0])
STEP_COL = np.array([0, 1, 0, -1])


@kernel
def _can_spread(cell, side, arrival_s, can_burn, cols):  # type: ignore[no-untyped-def]
    """Return the neighbour on a side if it is unburned and can burn, else -1."""
    row, col = cell // cols + STEP_ROW[side], cell % cols + STEP_COL[side]
    if not (0 <= row < arrival_s.size // cols and 0 <= col < cols):
        return -1
    target = row * cols + col
    return target if can_burn[target] and arrival_s[target] == np.inf else -1


@kernel
def update(  # type: ignore[no-untyped-def]
    at_s, spreads, cells, lasted, count, arrival_s, burned_out_s, can_burn, cols, burning_steps
):
    """Spread from the first ``count`` cells, drop burned-out cells, and return the number left."""
    size = count
    for k in range(count):
        for side in range(4):
            target = _can_spread(cells[k], side, arrival_s, can_burn, cols)
            if target >= 0 and spreads[4 * k + side]:
                arrival_s[target] = at_s
                cells[size], lasted[size] = target, 0
                size += 1
    kept = 0
    for k in range(size):
        cell = cells[k]
        if k < count:
            lasted[k] += 1
            continues = lasted[k] < burning_steps
            for side in range(4):
                if burning_steps == 0 and _can_spread(cell, side, arrival_s, can_burn, cols) >= 0:
                    continues = True
            if not continues:
                burned_out_s[cell] = at_s
                continue
        cells[kept], lasted[kept] = cell, lasted[k]
        kept += 1
    return kept
