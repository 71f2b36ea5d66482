"""Compiled inner loops of ``front_estimate``; lengths are in cells and times in seconds.

An array has 360 elements, one per whole-degree bearing, or 72 elements, one per sector of five
degrees. The slant of the front on a bearing is the change in the front's distance per cell
perpendicular to the bearing; the slant of a circle around the centre is 0.
"""

import math

import numpy as np

from firemodel.compiled import compiled

UNBURNED, BURNED = 1, 2  # codes as in fire_map
SAMPLES_PER_CELL = 2  # samples along a bearing, as for the distance error
TANGENT_CELLS = 3.5  # length on each side of a bearing over which the slant is computed
HOLLOW = 0.5  # the front is hollow where the slants on both sides differ by more than this
LEAP_CELLS = 2.0  # a larger outward step to the next bearing is a leap to another part of the front
PLACES = 9  # maximum number of places per bearing where the rate of spread is computed
BEHIND_CELLS = 0.7  # distance from the front back to the cell from which the fire spreads
STEEPEST = 4.0  # limit of the slant; the speed along a bearing increases with the slant
WITHIN_CELLS = 1.5  # maximum distance from burned to unburned ground across a front in view
BEYOND_CELLS = 2.0  # minimum distance of an unseen front from the ground in view

PER_SECTOR = 5
# A view is compared with an earlier view if the front has advanced at least this far between the
# two views, or if at least this time has passed.
BASELINE_CELLS, BASELINE_S = 2.0, 1800.0
CELL_VARIANCE = 1.0 / 12.0  # variance of a position with a resolution of one cell
# Relative error of the advance from ignition to the first view, when the wind is unknown.
UNLIKE_AT_FIRST = 1.0
AT_IGNITION_CELLS = 1.0  # maximum distance of the front from the centre at ignition
COSINES, SINES = (
    np.array([function(degrees * (math.pi / 180.0)) for degrees in range(360)])
    for function in (math.cos, math.sin)
)
SURPRISE = 3.0  # differences larger than this, in standard deviations, get less weight


@compiled
def front_normals(  # type: ignore[no-untyped-def]
    front, centre_row, centre_col, shape, bearing, rows, cols, north, east, stretch, max_advance
):
    """Compute the front's normals and the cells behind the front, in arrays of ``PLACES`` * 360.

    The arrays begin with one place for each bearing. For each bearing on which the front is hollow,
    two more places follow, with the slants of the two sides. Wherever the front leaps outwards from
    one bearing to the next, three more places follow on the flank between these bearings.
    ``stretch`` is the speed along the bearing divided by the speed normal to the front, and
    ``max_advance`` limits the advance along the bearing. Returns the number of places.
    """
    n, count = front.size, front.size
    degree = math.pi / 180.0
    for i in range(n):
        r = max(front[i], 0.5)
        w = min(max(round(TANGENT_CELLS / (r * degree)), 2), 15)
        # Negative indices count from the end; taking a remainder would be slower.
        ahead, following = i + w - (n if i + w >= n else 0), i + 1 if i + 1 < n else 0
        forward = (front[ahead] - front[i]) / (w * degree * r)
        backward = (front[i] - front[i - w]) / (w * degree * r)
        to_next, to_last = front[following] - front[i], front[i - 1] - front[i]
        hollow = forward - backward > HOLLOW
        leaps_on = to_next - max(-to_last, 0.0) > LEAP_CELLS
        leaps_back = to_last - max(-to_next, 0.0) > LEAP_CELLS
        cos, sin = COSINES[i], SINES[i]
        for kind in range(9 if hollow or leaps_on or leaps_back else 1):
            far, limit, cap = r, np.inf, STEEPEST
            cos_there, sin_there = cos, sin
            if kind == 0:
                slant = 0.5 * (forward + backward)
            elif kind <= 2:
                if not hollow:
                    continue
                slant = forward if kind == 1 else backward
            else:
                if not (leaps_on if kind <= 5 else leaps_back):
                    continue
                side, limit = (1, to_next) if kind <= 5 else (-1, to_last)
                slant, cap = side * limit / (degree * r), np.inf
                far = r + limit * (0.1 + 0.35 * (kind % 3))
                cos_there = math.cos((i + side) * degree)
                sin_there = math.sin((i + side) * degree)
            slant = min(max(slant, -cap), cap)
            along = math.sqrt(1.0 + slant * slant)
            place = i if kind == 0 else count
            count += 0 if kind == 0 else 1
            bearing[place], stretch[place], max_advance[place] = i, along, limit
            north[place] = (cos + slant * sin) / along
            east[place] = (sin - slant * cos) / along
            behind = 0.0 if kind > 2 else BEHIND_CELLS
            row = centre_row - far * cos_there + behind * north[place]
            col = centre_col + far * sin_there - behind * east[place]
            rows[place] = min(max(round(row), 0), shape[0] - 1)
            cols[place] = min(max(round(col), 0), shape[1] - 1)
    return count


@compiled
def speed_along_bearings(bearing, rate, stretch, max_advance, step_s, unit):  # type: ignore[no-untyped-def]
    """Compute the front's speed along each bearing; in a hollow the faster side sets the speed.

    The method is Godunov's scheme for the Hamilton-Jacobi equation of the front.
    """
    for place in range(rate.size):
        speed = min(rate[place] * stretch[place], max_advance[place] / step_s)
        if place < unit.size or speed > unit[bearing[place]]:
            unit[bearing[place]] = speed


@compiled
def interpolate_sectors(factor, found):  # type: ignore[no-untyped-def]
    """Interpolate ``factor`` linearly from the sector centres to the bearings."""
    sectors = factor.size
    for i in range(found.size):
        at = (i + 0.5) / PER_SECTOR - 0.5
        low = math.floor(at)
        share = at - low
        found[i] = factor[low % sectors] * (1.0 - share) + factor[(low + 1) % sectors] * share


@compiled
def advance_front(  # type: ignore[no-untyped-def]
    unit, factors, step_s, edge, speed, front, modelled, unseen
):
    """Advance the front at the speed ``unit`` times the factor, at most to ``edge``.

    The product is written to ``speed``. ``modelled`` and ``unseen`` advance at the speed ``unit``.
    """
    for i in range(front.size):
        speed[i] = unit[i] * factors[i]
        front[i] = min(front[i] + speed[i] * step_s, edge[i])
        modelled[i] += unit[i] * step_s
        unseen[i] += unit[i] * step_s


@compiled
def values_at_front(values, front, centre_row, centre_col, north, east, found):  # type: ignore[no-untyped-def]
    """Compute the value, from ``values`` (y, x), of the cell at the front on each bearing."""
    rows, cols = values.shape
    for i in range(front.size):
        row = min(max(round(centre_row - front[i] * north[i]), 0), rows - 1)
        col = min(max(round(centre_col + front[i] * east[i]), 0), cols - 1)
        found[i] = values[row, col]


@compiled
def mixed_front(  # type: ignore[no-untyped-def]
    modelled, cautious, last_seen, shares, model_share, burned, mixture, front
):
    """Compute the mixture, and the front as a mean of the model's estimate and the mixture.

    ``shares`` holds the fractions of the mixture taken from the model's estimate, the cautious
    estimate, and ``last_seen``, the front as last seen (NaN where the front has never been seen).
    The front is at most half a cell inside ground seen burned.
    """
    for i in range(front.size):
        seen = modelled[i] if math.isnan(last_seen[i]) else last_seen[i]
        mixture[i] = shares[0] * modelled[i] + shares[1] * cautious[i] + shares[2] * seen
        mixed = model_share * modelled[i] + (1.0 - model_share) * mixture[i]
        front[i] = max(mixed, burned[i] - 0.5)


@compiled
def bearings_in_view(burned_to, unburned_from, burned, in_view):  # type: ignore[no-untyped-def]
    """Update ``burned`` (outermost ground seen burned) and the mask of bearings with the front."""
    for i in range(burned.size):
        burned[i] = max(burned[i], burned_to[i])
        near = unburned_from[i] <= burned_to[i] + WITHIN_CELLS
        in_view[i] = burned_to[i] >= burned[i] and near


@compiled
def bound_front(window, in_view, burned_to, unburned_from, burned, front):  # type: ignore[no-untyped-def]
    """Move the front to enclose the burned ground in view and exclude the unburned ground."""
    shows_burned = shows_unburned = False
    for code in window.flat:
        shows_burned = shows_burned or code == BURNED
        shows_unburned = shows_unburned or code == UNBURNED
    for i in range(front.size):
        free = unburned_from[i]
        if not in_view[i] and free < np.inf and free > burned[i]:
            front[i] = min(front[i], free)
            if not shows_burned and free >= burned[i] + BEYOND_CELLS:
                front[i] = min(front[i], free - BEYOND_CELLS)
        if not shows_unburned and burned_to[i] >= burned[i] and burned_to[i] >= 0.0:
            front[i] = max(front[i], burned_to[i] + BEYOND_CELLS)
        front[i] = max(front[i], burned[i] - 0.5)


@compiled
def bounds_in_window(  # type: ignore[no-untyped-def]
    window, top, left, centre_row, centre_col, north, east, burned_to, unburned_from
):
    """Compute the bounds of the front on each bearing from a window of cells (y, x).

    ``burned_to`` is the distance of the outermost sample on burned ground (-1 if there is none).
    ``unburned_from`` is the distance of the first sample on unburned ground beyond ``burned_to``
    (inf if there is none).
    """
    rows, cols = window.shape
    down, right = top + (rows - 1) / 2.0 - centre_row, left + (cols - 1) / 2.0 - centre_col
    away, reach = math.hypot(down, right), math.hypot(rows, cols) / 2.0
    first = max(int((away - reach) * SAMPLES_PER_CELL), 0)
    last = int((away + reach) * SAMPLES_PER_CELL) + 1
    for i in range(north.size):
        burned_to[i], unburned_from[i] = -1.0, np.inf
        offset = abs(north[i] * right + east[i] * down)
        if offset > reach or (away > reach and east[i] * right - north[i] * down < 0.0):
            continue
        for k in range(first, last):
            r = k / SAMPLES_PER_CELL
            row = round(centre_row - r * north[i]) - top
            col = round(centre_col + r * east[i]) - left
            if row < 0 or col < 0 or row >= rows or col >= cols:
                continue
            code = window[row, col]
            if code == BURNED:
                burned_to[i], unburned_from[i] = r, np.inf
            elif code == UNBURNED and unburned_from[i] == np.inf:
                unburned_from[i] = r


@compiled
def update_factors(  # type: ignore[no-untyped-def]
    due, front, anchor, modelled, stretch, unlike, min_factor, max_factor, factor, covariance
):
    """Update the sectors' factors with a Kalman filter, from the bearings in the mask ``due``.

    ``anchor`` is the front in the earlier view with which the current view is compared. The filter
    assumes: observed advance since the anchor = factor x modelled advance + noise. ``unlike`` is
    the relative error of an advance due to causes other than the factor.
    """
    n = factor.size
    column = np.empty(n)
    for sector in range(n):
        count, advance, predicted, slant, first = 0, 0.0, 0.0, 0.0, True
        for i in range(sector * PER_SECTOR, (sector + 1) * PER_SECTOR):
            if due[i]:
                count += 1
                advance += front[i] - anchor[i]
                predicted += modelled[i]
                slant += stretch[i]
                first = first and anchor[i] <= AT_IGNITION_CELLS
        if count == 0:
            continue
        advance, predicted, slant = advance / count, predicted / count, slant / count
        noise = (UNLIKE_AT_FIRST if first else unlike) * predicted * factor[sector]
        variance = 2.0 * CELL_VARIANCE * slant * slant + noise * noise
        scale = variance + predicted * predicted * covariance[sector, sector]
        off = advance - predicted * factor[sector]
        # If the variance and the noise cannot explain a difference, the view shows another part of
        # the front, not a different rate.
        scale *= max(1.0, off * off / (scale * SURPRISE * SURPRISE))
        for i in range(n):
            column[i] = covariance[i, sector]
        for i in range(n):
            changed = factor[i] + column[i] * predicted / scale * off
            factor[i] = min(max(changed, min_factor), max_factor)
        shrink = predicted * predicted / scale
        for i in range(n):
            for k in range(n):
                covariance[i, k] -= shrink * column[i] * column[k]
