"""Compiled inner loops of the believed front (``belief``). Lengths in cells, times in seconds.

Self-contained: nothing here calls a compiled function of another file (see ``firemodel.compiled``).
"""

import math

import numpy as np

from firemodel.compiled import compiled

UNKNOWN, UNBURNED, BURNED = 0, 1, 2
SAMPLES_PER_CELL = 2  # along a bearing, as the distance error does
TANGENT_CELLS = 3.5  # the front's slant is taken over this much of it to either side
HOLLOW = 0.5  # difference of the slants on both sides from which on a front is hollow
BEHIND_CELLS = 0.7
STEEPEST = 4.0  # slant beyond which the radial speed is no longer believed


@compiled
def facing(front, rows, cols, north, east, stretch, centre_row, centre_col, shape):  # type: ignore[no-untyped-def]
    """Where the front faces, arrays (3, 360): by its slant ahead, on both sides, and behind.

    Fills in its normal, how much faster than across itself it moves along the bearing, and the cell
    just behind it, from which the fire comes.
    """
    n = front.size
    for i in range(n):
        r = max(front[i], 0.5)
        w = int(round(TANGENT_CELLS / (r * math.pi / 180.0)))
        w = min(max(w, 2), 15)
        arm = w * math.pi / 180.0 * r
        forward = (front[(i + w) % n] - front[i]) / arm
        backward = (front[i] - front[(i - w) % n]) / arm
        cos, sin = math.cos(math.radians(i)), math.sin(math.radians(i))
        for side in range(3):
            slant = (forward, 0.5 * (forward + backward), backward)[side]
            slant = min(max(slant, -STEEPEST), STEEPEST)
            along = math.sqrt(1.0 + slant * slant)
            north[side, i] = (cos + slant * sin) / along
            east[side, i] = (sin - slant * cos) / along
            stretch[side, i] = along
            row = round(centre_row - r * cos + BEHIND_CELLS * north[side, i])
            col = round(centre_col + r * sin - BEHIND_CELLS * east[side, i])
            rows[side, i] = min(max(row, 0), shape[0] - 1)
            cols[side, i] = min(max(col, 0), shape[1] - 1)


@compiled
def outwards(front, rate, stretch, speed):  # type: ignore[no-untyped-def]
    """Speed along each bearing from the speeds (3, 360) across the front.

    Where the front is hollow, fire comes in from the faster side (Godunov); elsewhere it is the
    speed with its slant over both sides.
    """
    n = front.size
    for i in range(n):
        speed[i] = rate[1, i] * stretch[1, i]
        r = max(front[i], 0.5)
        w = int(round(TANGENT_CELLS / (r * math.pi / 180.0)))
        w = min(max(w, 2), 15)
        bend = front[(i + w) % n] - 2.0 * front[i] + front[(i - w) % n]
        if bend > HOLLOW * w * math.pi / 180.0 * r:
            speed[i] = max(speed[i], rate[0, i] * stretch[0, i], rate[2, i] * stretch[2, i])


@compiled
def watch(window, top, left, centre_row, centre_col, north, east, least, most):  # type: ignore[no-untyped-def]
    """What a window of cells (y, x) says of the front on each bearing.

    ``least`` is the outermost sample on burned ground (-1: none in the window), ``most`` the first
    sample on ground known to be unburned beyond it (inf: none).
    """
    rows, cols = window.shape
    down, right = top + (rows - 1) / 2.0 - centre_row, left + (cols - 1) / 2.0 - centre_col
    away, reach = math.hypot(down, right), math.hypot(rows, cols) / 2.0
    first = max(int((away - reach) * SAMPLES_PER_CELL), 0)
    last = int((away + reach) * SAMPLES_PER_CELL) + 1
    for i in range(north.size):
        least[i], most[i] = -1.0, np.inf
        aside = abs(north[i] * right + east[i] * down)
        if aside > reach or (away > reach and east[i] * right - north[i] * down < 0.0):
            continue
        for k in range(first, last):
            r = k / SAMPLES_PER_CELL
            row = round(centre_row - r * north[i]) - top
            col = round(centre_col + r * east[i]) - left
            if row < 0 or col < 0 or row >= rows or col >= cols:
                continue
            code = window[row, col]
            if code == BURNED:
                least[i], most[i] = r, np.inf
            elif code == UNBURNED and most[i] == np.inf:
                most[i] = r


@compiled
def learn(factor, covariance, sector, advance, predicted, variance):  # type: ignore[no-untyped-def]
    """Kalman update of the sectors' factors: observed advance = factor x predicted, plus noise."""
    n = factor.size
    scale = variance + predicted * predicted * covariance[sector, sector]
    column = covariance[:, sector].copy()
    off = advance - predicted * factor[sector]
    for i in range(n):
        factor[i] += column[i] * predicted / scale * off
    shrink = predicted * predicted / scale
    for i in range(n):
        for k in range(n):
            covariance[i, k] -= shrink * column[i] * column[k]
