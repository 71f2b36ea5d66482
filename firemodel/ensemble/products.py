"""Compute maps from the windows of an ensemble's members."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, Place, window_at
from firemodel.ensemble.member_fires import Window

TIMES_AT_ONCE = 2**24  # maximum number of arrival times that are sorted at once, to save memory


def burn_probability(windows: Sequence[Window], shape: tuple[int, int], after_s: float) -> Floats:
    """Return the fraction (y, x) of members in which each cell burned within ``after_s``."""
    burned = np.zeros(shape)
    for window in windows:
        here = window_at(window.top, window.left, window.after_s.shape)
        burned[here] += window.after_s <= after_s
    return burned / max(len(windows), 1)


def arrival_quantiles_s(
    windows: Sequence[Window], shape: tuple[int, int], shares: Sequence[float]
) -> NDArray[np.float32]:
    """Return the times by which each cell has burned in given fractions of the members.

    Args:
        windows: The members' windows; one or more.
        shape: The grid's rows and columns.
        shares: Fractions of the members, above 0 and at most 1.

    Returns:
        Seconds after the start (shares, y, x); infinity where the cell burned in a smaller fraction
        of the members.
    """
    count = len(windows)
    # The smallest number of members that is at least the fraction, converted to an index into the
    # sorted times. The term 1e-9 allows for rounding errors of fractions such as 0.1 * 3.
    places = [max(int(np.ceil(share * count - 1e-9)), 1) - 1 for share in shares]
    found = np.full((len(shares), *shape), np.inf, dtype=np.float32)
    rows, cols = _all_burned(windows)
    rows_at_once = max(TIMES_AT_ONCE // (count * max(cols.stop - cols.start, 1)), 1)
    for top in range(rows.start, rows.stop, rows_at_once):
        block = found[:, top : min(top + rows_at_once, rows.stop), cols]
        stack = np.full((count, *block.shape[1:]), np.inf, dtype=np.float32)
        for layer, window in zip(stack, windows, strict=True):
            first = max(window.top, top)
            end = min(window.top + window.after_s.shape[0], top + len(layer))
            left = window.left - cols.start
            if first < end:
                times_s = window.after_s[first - window.top : end - window.top]
                layer[first - top : end - top, left : left + times_s.shape[1]] = times_s
        reached = np.isfinite(stack).any(axis=0)
        times_s = stack[:, reached]
        times_s.sort(axis=0)  # faster than ``partition`` on processors with vector instructions
        block[:, reached] = times_s[places]
    return found


def _all_burned(windows: Sequence[Window]) -> Place:
    """Return the smallest window that contains the windows of all members that burned cells."""
    corners = np.array(
        [
            (window.top, window.left, *np.add((window.top, window.left), window.after_s.shape))
            for window in windows
            if window.after_s.size
        ]
    ).reshape(-1, 4)
    if not len(corners):
        return np.s_[0:0, 0:0]
    (top, left), (bottom, right) = corners[:, :2].min(axis=0), corners[:, 2:].max(axis=0)
    return np.s_[int(top) : int(bottom), int(left) : int(right)]


def mean_flame_length_m(windows: Sequence[Window], shape: tuple[int, int]) -> NDArray[np.float32]:
    """Return the mean flame length (y, x) over the members in which fire arrived, or NaN."""
    total, came = np.zeros(shape), np.zeros(shape)
    for window in windows:
        here = window_at(window.top, window.left, window.after_s.shape)
        known = np.isfinite(window.flame_m)
        total[here] += np.where(known, window.flame_m, 0.0)
        came[here] += known
    mean = np.divide(total, came, out=np.full(shape, np.nan), where=came > 0.0)
    found: NDArray[np.float32] = mean.astype(np.float32)
    return found
