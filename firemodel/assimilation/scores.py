"""Compare forecasts of burned areas with later observations."""

from typing import Any

import numpy as np
import shapely
from scipy.spatial import cKDTree

from firemodel.arrays import Floats, Mask

SPACING_M = 30.0  # distance between points on outlines
LOW, HIGH = 0.1, 0.9  # probabilities between which 80 % of the true fronts should lie


def overlap(one: Mask, other: Mask) -> float:
    """Return the intersection over union of two areas (y, x); 1 if both are empty."""
    union = np.count_nonzero(one | other)
    return float(np.count_nonzero(one & other) / union) if union else 1.0


def critical_success(before: Mask, forecast: Mask, observed: Mask) -> float | None:
    """Return the intersection over union of the newly burned areas; None if nothing is new."""
    new, new_forecast = observed & ~before, forecast & ~before
    if not (new | new_forecast).any():
        return None
    return overlap(new, new_forecast)


def mean_distance_m(found: Any, true: Any) -> float:
    """Return the mean distance in m from points on the true outline to the estimated outline.

    Both are shapely areas in one projected CRS. The measure is that of Beachly et al. 2018 for
    corrected fronts.
    """
    distance_m, _ = cKDTree(_outline(found)).query(_outline(true))
    return float(np.mean(distance_m))


def _outline(area: Any) -> Floats:
    """Return points (n, 2) on the outline of an area."""
    found: Floats = shapely.get_coordinates(shapely.segmentize(area.boundary, SPACING_M))
    return found


def coverage(probability: Floats, observed: Mask) -> float | None:
    """Return the fraction of the observed front where the forecast probability is 10 to 90 %.

    The front consists of the sides that burned and unburned cells share. A side counts if the
    forecast probability is at least 10 % in its burned cell and at most 90 % in its unburned cell.

    Args:
        probability: (y, x) the forecast probability that a cell has burned.
        observed: (y, x) the burned cells.

    Returns:
        The fraction, or None if there is no front.
    """
    inside = total = 0
    for axis in (0, 1):
        burned = np.moveaxis(observed, axis, 0)
        chance = np.moveaxis(probability, axis, 0)
        front = burned[1:] != burned[:-1]
        of_burned = np.where(burned[1:], chance[1:], chance[:-1])[front]
        of_unburned = np.where(burned[1:], chance[:-1], chance[1:])[front]
        inside += int(np.count_nonzero((of_burned >= LOW) & (of_unburned <= HIGH)))
        total += of_burned.size
    return inside / total if total else None


def crps_s(probabilities: list[Floats], observed: list[Mask], times_s: Floats) -> float:
    """Return the continuous ranked probability score of arrival times in s.

    The score is the integral over time of the squared error of the probability that a cell has
    burned (Hersbach 2000), summed over all cells and divided by the number of cells that have
    burned by the last time.

    Args:
        probabilities: The forecast probabilities (y, x) at each time.
        observed: The burned cells (y, x) at each time.
        times_s: The times in s, in ascending order.
    """
    errors = [
        float(np.sum((probability - burned) ** 2))
        for probability, burned in zip(probabilities, observed, strict=True)
    ]
    return float(np.trapezoid(errors, times_s)) / max(int(np.count_nonzero(observed[-1])), 1)
