"""The importance of front cells and of the two planning windows (Islam & Hu, section III).

A ring is an array with one value for each cell of the perimeter. Index 0 is the vehicle's cell. The
index increases against the direction of flight and ends at the cell ahead of the vehicle (section
III.B).
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def adjusted_spread_rate(spread_rate: Floats, alpha: float) -> Floats:
    """Return the spread rates with their heterogeneity scaled by ``alpha`` >= 0 (eq. 7)."""
    if not spread_rate.size:  # the front is within one cell
        return spread_rate
    lowest = spread_rate.min()
    adjusted: Floats = lowest + alpha * (spread_rate - lowest)
    if alpha >= 1.0:
        return np.where(spread_rate <= spread_rate.mean(), spread_rate, adjusted)
    return adjusted


def cell_importance(spread_rate: Floats, since_visit_s: Floats, to_cell_s: Floats) -> Floats:
    """Return the spread expected between the last and the next visit to each cell (eq. 4)."""
    return spread_rate * since_visit_s + spread_rate * to_cell_s


def time_to_cells_s(step_m: Floats, speed_m_s: float) -> Floats:
    """Return the flight time to each cell of a ring (eq. 3).

    The vehicle reaches the cells in the first half of the ring by turning back, and the other cells
    without a turn. ``step_m[i]`` is the distance from cell i to cell i + 1; the last step closes
    the ring.
    """
    behind_m = np.concatenate([[0.0], np.cumsum(step_m)])
    length_m = behind_m[-1]
    half = step_m.size // 2
    distance_m = behind_m[:-1].copy()
    distance_m[half:] = length_m - distance_m[half:]
    return distance_m / speed_m_s


def window_importance(importance: Floats) -> tuple[float, float]:
    """Return the importance of the back window (eq. 5) and of the front window (eq. 6).

    The back window is the first half of the ring, the front window the second half.
    """
    half = importance.size // 2
    return float(importance[:half].sum()), float(importance[half:].sum())


def ring_importance(
    spread_rate: Floats, since_visit_s: Floats, step_m: Floats, speed_m_s: float, alpha: float
) -> Floats:
    """Return the importance of each cell of a ring (listing 3), for ``window_importance``."""
    rate = adjusted_spread_rate(spread_rate, alpha)
    return cell_importance(rate, since_visit_s, time_to_cells_s(step_m, speed_m_s))
