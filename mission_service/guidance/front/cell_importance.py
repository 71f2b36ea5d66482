"""Importance of front cells and of the two planning windows (Islam & Hu, section III).

Rings are arrays over the cells of the perimeter. Index 0 is the cell of the UAS; the index grows
against the flying direction and ends with the cell ahead of the UAS (section III.B).
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def adjusted_spread_rate(spread_rate: Floats, alpha: float) -> Floats:
    """Return eq. 7: spread rates with their heterogeneity scaled by ``alpha`` (>= 0)."""
    if not spread_rate.size:  # a front within one cell
        return spread_rate
    lowest = spread_rate.min()
    adjusted: Floats = lowest + alpha * (spread_rate - lowest)
    if alpha >= 1.0:
        return np.where(spread_rate <= spread_rate.mean(), spread_rate, adjusted)
    return adjusted


def cell_importance(spread_rate: Floats, since_visit_s: Floats, to_cell_s: Floats) -> Floats:
    """Return eq. 4: the spread expected between the last and the next visit of each cell."""
    return spread_rate * since_visit_s + spread_rate * to_cell_s


def time_to_cells_s(step_m: Floats, speed_m_s: float) -> Floats:
    """Return eq. 3 on a ring: time to each cell, backwards in the back half, else forwards.

    ``step_m[i]`` is the distance from cell i to cell i + 1 (the last one closes the ring).
    """
    behind_m = np.concatenate([[0.0], np.cumsum(step_m)])
    length_m = behind_m[-1]
    half = step_m.size // 2
    distance_m = behind_m[:-1].copy()
    distance_m[half:] = length_m - distance_m[half:]
    return distance_m / speed_m_s


def window_importance(importance: Floats) -> tuple[float, float]:
    """Return eqs. 5 and 6: (back, front), the sums over the first and second half of the ring."""
    half = importance.size // 2
    return float(importance[:half].sum()), float(importance[half:].sum())


def ring_importance(
    spread_rate: Floats, since_visit_s: Floats, step_m: Floats, speed_m_s: float, alpha: float
) -> Floats:
    """Return the importance of each cell of a ring by listing 3, to be summed by halves."""
    rate = adjusted_spread_rate(spread_rate, alpha)
    return cell_importance(rate, since_visit_s, time_to_cells_s(step_m, speed_m_s))
