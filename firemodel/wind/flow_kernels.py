"""The discrete equations of the mass-consistent wind, compiled.

Unknowns are values of the potential at the centres of columns (y, x) and on levels k = 0 to n - 1,
where level 0 is the ground; on level n, the open top, and beyond the open sides the potential is
0. Arrays of the potential have a margin of one column on each side, which contains 0. ``ground`` is
a stack (6, y, x) of fields with the same margin, ``layers`` a table (4, n + 1) (``flow_solver``).

The flow through a face between two columns is proportional to the difference of the potential at
equal height, which is the difference on a level minus slope times vertical difference. All terms
derive from one energy; therefore the equations are symmetric and positive definite on any terrain.
The equations are per unit of ground area.
"""

import numpy as np

from firemodel.compiled import inlined, kernel

# Rows of ``ground``; "right" and "below" are the faces towards the next column and the next row.
RIGHT, BELOW, RISE_RIGHT, RISE_BELOW, INVERSE_DEPTH, SLOPES = range(6)
# Rows of ``layers``; the width belongs to level k, the others to the layer below level k.
WIDTH, TAPER, INVERSE, TAPER2 = range(4)
NEAR, FAR = np.float32(0.75), np.float32(0.25)  # weights of linear interpolation between grids


@inlined
def _rise(phi, ground, k, row, col):  # type: ignore[no-untyped-def]
    """Return the sum of slope times potential difference over the four faces of a cell."""
    here = phi[k, row, col]
    return (
        ground[RISE_RIGHT, row, col] * (phi[k, row, col + 1] - here)
        + ground[RISE_RIGHT, row, col - 1] * (here - phi[k, row, col - 1])
        + ground[RISE_BELOW, row, col] * (phi[k, row + 1, col] - here)
        + ground[RISE_BELOW, row - 1, col] * (here - phi[k, row - 1, col])
    )


@inlined
def _steep(phi, k, row, col, taper, taper_below, below, above):  # type: ignore[no-untyped-def]
    """Return the tapered differences of the potential over the two layers at a level."""
    here = phi[k, row, col]
    return taper_below * (here - phi[below, row, col]) + taper * (phi[above, row, col] - here)


@kernel
def apply_flow(phi, out, ground, layers):  # type: ignore[no-untyped-def]
    """Write minus the divergence of the flow of a potential to ``out``.

    The arrays have n + 1 levels; level n of ``phi`` is 0.
    """
    levels, rows, cols = phi.shape[0] - 1, phi.shape[1] - 1, phi.shape[2] - 1
    for row in range(1, rows):
        for k in range(levels):
            below, above = max(k - 1, 0), k + 1
            width, taper, taper_below = layers[WIDTH, k], layers[TAPER, above], layers[TAPER, k]
            stiff_a, stiff_q = layers[INVERSE, above], layers[TAPER2, above]
            under_a, under_q = layers[INVERSE, k], layers[TAPER2, k]
            for col in range(1, cols):
                here = phi[k, row, col]
                level = (
                    ground[RIGHT, row, col] * (phi[k, row, col + 1] - here)
                    - ground[RIGHT, row, col - 1] * (here - phi[k, row, col - 1])
                    + ground[BELOW, row, col] * (phi[k, row + 1, col] - here)
                    - ground[BELOW, row - 1, col] * (here - phi[k, row - 1, col])
                )
                own = _steep(phi, k, row, col, taper, taper_below, below, above)
                east = own + _steep(phi, k, row, col + 1, taper, taper_below, below, above)
                west = own + _steep(phi, k, row, col - 1, taper, taper_below, below, above)
                south = own + _steep(phi, k, row + 1, col, taper, taper_below, below, above)
                north = own + _steep(phi, k, row - 1, col, taper, taper_below, below, above)
                tilted = (
                    ground[RISE_RIGHT, row, col] * east
                    - ground[RISE_RIGHT, row, col - 1] * west
                    + ground[RISE_BELOW, row, col] * south
                    - ground[RISE_BELOW, row - 1, col] * north
                )
                rise = _rise(phi, ground, k, row, col)
                tilted += taper * (rise + _rise(phi, ground, above, row, col))
                tilted -= taper_below * (rise + _rise(phi, ground, below, row, col))
                depth, slopes = ground[INVERSE_DEPTH, row, col], ground[SLOPES, row, col]
                up = (depth * stiff_a + slopes * stiff_q) * (phi[above, row, col] - here)
                down = (depth * under_a + slopes * under_q) * (here - phi[below, row, col])
                out[k, row, col] = tilted - width * level - up + down


@kernel
def factor_columns(pivot, ground, layers):  # type: ignore[no-untyped-def]
    """Write the inverse pivots of the tridiagonal equations of each column to ``pivot``."""
    levels, rows, cols = pivot.shape[0] - 1, pivot.shape[1] - 1, pivot.shape[2] - 1
    for row in range(1, rows):
        for k in range(levels):
            below = max(k - 1, 0)
            change = layers[TAPER, k + 1] - layers[TAPER, k]
            for col in range(1, cols):
                depth, slopes = ground[INVERSE_DEPTH, row, col], ground[SLOPES, row, col]
                across = (
                    ground[RIGHT, row, col]
                    + ground[RIGHT, row, col - 1]
                    + ground[BELOW, row, col]
                    + ground[BELOW, row - 1, col]
                )
                bend = (
                    ground[RISE_RIGHT, row, col]
                    - ground[RISE_RIGHT, row, col - 1]
                    + ground[RISE_BELOW, row, col]
                    - ground[RISE_BELOW, row - 1, col]
                )
                up = depth * layers[INVERSE, k + 1] + slopes * layers[TAPER2, k + 1]
                down = depth * layers[INVERSE, k] + slopes * layers[TAPER2, k]
                own = layers[WIDTH, k] * across + up + down - 2.0 * bend * change
                pivot[k, row, col] = 1.0 / (own - down * down * pivot[below, row, col])


@inlined
def _solve_row(out, row, pivot, ground, layers):  # type: ignore[no-untyped-def]
    """Solve the tridiagonal equations of the columns in a row; ``out`` has the right-hand side."""
    levels, cols = out.shape[0] - 1, out.shape[2] - 1
    for k in range(1, levels):
        a, q = layers[INVERSE, k], layers[TAPER2, k]
        for col in range(1, cols):
            couple = ground[INVERSE_DEPTH, row, col] * a + ground[SLOPES, row, col] * q
            out[k, row, col] += couple * pivot[k - 1, row, col] * out[k - 1, row, col]
    for step in range(levels):
        k = levels - 1 - step
        a, q = layers[INVERSE, k + 1], layers[TAPER2, k + 1]
        for col in range(1, cols):
            couple = ground[INVERSE_DEPTH, row, col] * a + ground[SLOPES, row, col] * q
            out[k, row, col] = pivot[k, row, col] * (
                out[k, row, col] + couple * out[k + 1, row, col]
            )


@kernel
def solve_columns(source, out, damping, pivot, ground, layers):  # type: ignore[no-untyped-def]
    """Write the damped solutions of the columns alone to ``out``, for the right-hand side."""
    levels, rows, cols = out.shape[0] - 1, out.shape[1] - 1, out.shape[2] - 1
    for row in range(1, rows):
        for k in range(levels):
            for col in range(1, cols):
                out[k, row, col] = damping * source[k, row, col]
        _solve_row(out, row, pivot, ground, layers)


@kernel
def improve_columns(phi, source, out, damping, pivot, ground, layers):  # type: ignore[no-untyped-def]
    """Add the damped solutions of the columns for the residual to ``phi``.

    ``out`` contains the image of ``phi`` (``apply_flow``), and is overwritten.
    """
    levels, rows, cols = out.shape[0] - 1, out.shape[1] - 1, out.shape[2] - 1
    for row in range(1, rows):
        for k in range(levels):
            for col in range(1, cols):
                out[k, row, col] = damping * (source[k, row, col] - out[k, row, col])
        _solve_row(out, row, pivot, ground, layers)
        for k in range(levels):
            for col in range(1, cols):
                phi[k, row, col] += out[k, row, col]


@kernel
def restrict_residual(source, image, coarse):  # type: ignore[no-untyped-def]
    """Write the residual ``source - image`` to the grid of half the resolution.

    The weights are those of ``add_interpolated``, transposed. ``image`` is overwritten.
    """
    levels, rows, cols = source.shape[0] - 1, source.shape[1] - 1, source.shape[2] - 1
    big_rows, big_cols = coarse.shape[1] - 1, coarse.shape[2] - 1
    for k in range(levels):
        for row in range(1, rows):
            for col in range(1, cols):
                image[k, row, col] = source[k, row, col] - image[k, row, col]
            held = image[k, row, 0]  # 0, like the margin on the other side
            for big in range(1, big_cols):  # the sums of four columns replace the first columns
                col = 2 * big - 1
                last = image[k, row, min(col + 1, cols)]
                after = image[k, row, min(col + 2, cols)]
                image[k, row, big] = (
                    FAR * held + NEAR * image[k, row, col] + NEAR * last + FAR * after
                )
                held = last
        for big_row in range(1, big_rows):
            row = 2 * big_row - 1
            second, after_row = min(row + 1, rows), min(row + 2, rows)
            for big in range(1, big_cols):
                inner = image[k, row, big] + image[k, second, big]
                outer = image[k, row - 1, big] + image[k, after_row, big]
                coarse[k, big_row, big] = FAR * (NEAR * inner + FAR * outer)


@kernel
def add_interpolated(coarse, phi):  # type: ignore[no-untyped-def]
    """Add a potential of half the resolution, interpolated bilinearly, to ``phi``."""
    levels, rows, cols = phi.shape[0] - 1, phi.shape[1] - 1, phi.shape[2] - 1
    for k in range(levels):
        for row in range(1, rows):
            near = (row + 1) // 2
            far = near - 1 if row % 2 else near + 1
            for big in range(1, coarse.shape[2] - 1):
                col = 2 * big - 1
                left = NEAR * coarse[k, near, big - 1] + FAR * coarse[k, far, big - 1]
                here = NEAR * coarse[k, near, big] + FAR * coarse[k, far, big]
                right = NEAR * coarse[k, near, big + 1] + FAR * coarse[k, far, big + 1]
                phi[k, row, col] += NEAR * here + FAR * left
                if col + 1 < cols:
                    phi[k, row, col + 1] += NEAR * here + FAR * right


@kernel
def dot(left, right):  # type: ignore[no-untyped-def]
    """Return the sum of products of two arrays of the same shape, with margins of 0."""
    levels, rows, cols = left.shape[0] - 1, left.shape[1] - 1, left.shape[2] - 1
    total = 0.0
    for k in range(levels):
        for row in range(1, rows):
            a, b, c, d = 0.0, 0.0, 0.0, 0.0
            col = 1
            while col + 3 < cols:
                a += left[k, row, col] * right[k, row, col]
                b += left[k, row, col + 1] * right[k, row, col + 1]
                c += left[k, row, col + 2] * right[k, row, col + 2]
                d += left[k, row, col + 3] * right[k, row, col + 3]
                col += 4
            while col < cols:
                a += left[k, row, col] * right[k, row, col]
                col += 1
            total += (a + b) + (c + d)
    return total


@kernel
def step_along(phi, residual, narrow, direction, image, length, ground, layers):  # type: ignore[no-untyped-def]
    """Move ``phi`` along a direction, update the residual, and return the largest divergence.

    ``image`` is the image of ``direction``. ``narrow`` receives the residual in single precision.
    The divergence is per unit of volume: wind in m/s gives 1/s.
    """
    levels, rows, cols = phi.shape[0] - 1, phi.shape[1] - 1, phi.shape[2] - 1
    largest = 0.0
    for k in range(levels):
        for row in range(1, rows):
            for col in range(1, cols):
                phi[k, row, col] += length * direction[k, row, col]
                rest = residual[k, row, col] - length * image[k, row, col]
                residual[k, row, col] = rest
                narrow[k, row, col] = rest
                share = abs(rest) * ground[INVERSE_DEPTH, row, col] / layers[WIDTH, k]
                largest = max(largest, share)
    return largest


@kernel
def turn_direction(direction, improved, share):  # type: ignore[no-untyped-def]
    """Replace the direction by ``improved`` plus a share of the direction."""
    levels, rows, cols = direction.shape[0] - 1, direction.shape[1] - 1, direction.shape[2] - 1
    for k in range(levels):
        for row in range(1, rows):
            for col in range(1, cols):
                direction[k, row, col] = improved[k, row, col] + share * direction[k, row, col]


@kernel
def add_divergence(speed, out, eastward, ground, layers, depth, cell_m):  # type: ignore[no-untyped-def]
    """Add the divergence of one component of the initial wind to ``out``.

    ``speed`` (n, y, x) without margin is the initial speed towards east or towards south, as the
    mean of the volume around each level. ``depth`` (2, y, x) is the depth of the flow at the faces
    right and below, divided by the cell size, with margin.
    """
    levels, rows, cols = out.shape[0] - 1, out.shape[1] - 1, out.shape[2] - 1
    last_row, last_col = rows - 2, cols - 2
    for row in range(1, rows):
        for k in range(levels):
            above = min(k + 1, levels - 1)
            below = max(k - 1, 0)
            for col in range(1, cols):
                r, c = row - 1, col - 1
                if eastward:
                    r_before, c_before = r, max(c - 1, 0)
                    r_after, c_after = r, min(c + 1, last_col)
                    rise_before = ground[RISE_RIGHT, row, col - 1]
                    rise_after = ground[RISE_RIGHT, row, col]
                    deep_before, deep_after = depth[0, row, col - 1], depth[0, row, col]
                else:
                    r_before, c_before = max(r - 1, 0), c
                    r_after, c_after = min(r + 1, last_row), c
                    rise_before = ground[RISE_BELOW, row - 1, col]
                    rise_after = ground[RISE_BELOW, row, col]
                    deep_before, deep_after = depth[1, row - 1, col], depth[1, row, col]
                after = speed[k, r, c] + speed[k, r_after, c_after]
                before = speed[k, r, c] + speed[k, r_before, c_before]
                over_after = speed[above, r, c] + speed[above, r_after, c_after]
                over_before = speed[above, r, c] + speed[above, r_before, c_before]
                under_after = speed[below, r, c] + speed[below, r_after, c_after]
                under_before = speed[below, r, c] + speed[below, r_before, c_before]
                across = 0.5 * layers[WIDTH, k] * (deep_after * after - deep_before * before)
                here = rise_after * after + rise_before * before
                up = here + rise_after * over_after + rise_before * over_before
                down = here + rise_after * under_after + rise_before * under_before
                lifted = layers[TAPER, k + 1] * up - layers[TAPER, k] * down
                out[k, row, col] += across - 0.5 * cell_m * lifted


@inlined
def _along(phi, k, row, col, next_row, next_col, half, rise, deep, layers):  # type: ignore[no-untyped-def]
    """Return the corrected speed through the face between two columns on a level."""
    below, above = max(k - 1, 0), k + 1
    width, taper, taper_below = layers[WIDTH, k], layers[TAPER, above], layers[TAPER, k]
    tilted = _steep(phi, k, row, col, taper, taper_below, below, above)
    tilted += _steep(phi, k, next_row, next_col, taper, taper_below, below, above)
    across = half * (phi[k, next_row, next_col] - phi[k, row, col])
    return (across - rise * tilted / width) / deep


@inlined
def _correction(phi, k, row, col, ground, layers, depth):  # type: ignore[no-untyped-def]
    """Return the correction towards east and towards south at the centre of a column."""
    east = _along(
        *(phi, k, row, col, row, col + 1),
        *(ground[RIGHT, row, col], ground[RISE_RIGHT, row, col], depth[0, row, col], layers),
    )
    west = _along(
        *(phi, k, row, col - 1, row, col),
        *(ground[RIGHT, row, col - 1], ground[RISE_RIGHT, row, col - 1]),
        *(depth[0, row, col - 1], layers),
    )
    south = _along(
        *(phi, k, row, col, row + 1, col),
        *(ground[BELOW, row, col], ground[RISE_BELOW, row, col], depth[1, row, col], layers),
    )
    north = _along(
        *(phi, k, row - 1, col, row, col),
        *(ground[BELOW, row - 1, col], ground[RISE_BELOW, row - 1, col]),
        *(depth[1, row - 1, col], layers),
    )
    return 0.5 * (east + west), 0.5 * (south + north)


@kernel
def corrections_at(phi, rows, cols, shares, centres, out, ground, layers, depth):  # type: ignore[no-untyped-def]
    """Write the corrections of the wind in columns to ``out`` (2, m), towards east and south.

    ``rows`` and ``cols`` (m) are indices that include the margin; ``shares`` (m) are heights above
    the ground as shares of the depth of the flow. The corrections are interpolated between the
    ``centres`` (n) of the volumes, and constant below the first and above the last of them.
    """
    levels = centres.shape[0]
    for i in range(rows.shape[0]):
        row, col, share = rows[i], cols[i], shares[i]
        k = 0
        while k + 2 < levels and centres[k + 1] < share:
            k += 1
        part = (share - centres[k]) / (centres[k + 1] - centres[k])
        part = min(max(part, 0.0), 1.0)
        east, south = _correction(phi, k, row, col, ground, layers, depth)
        east_above, south_above = _correction(phi, k + 1, row, col, ground, layers, depth)
        out[0, i] = (1.0 - part) * east + part * east_above
        out[1, i] = (1.0 - part) * south + part * south_above
