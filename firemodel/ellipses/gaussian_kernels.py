"""Compute, for ``gaussian_process``, how a field changes travel times along straight paths."""

from typing import NamedTuple

from firemodel.arrays import Floats
from firemodel.compiled import kernel

PARTS = 8  # number of parts into which a path is divided for computing the mean


class Field(NamedTuple):
    """The values of exp w, a factor on the fire's slowness, at nodes spaced ``apart_m`` apart.

    Rows are along y (row 0 in the south) and columns along x.

    Values between nodes are interpolated; beyond the edge, the value at the edge is used.
    """

    west_m: float
    south_m: float
    apart_m: float
    slower: Floats


@kernel
def _corner(x, apart, count):  # type: ignore[no-untyped-def]
    """Return the last node at or before x, and the distance of x from this node (0 to 1)."""
    at = min(max(x / apart, 0.0), count - 1.0)
    node = min(int(at), count - 2)
    return node, at - node


@kernel
def _at(x, y, field):  # type: ignore[no-untyped-def]
    nodes = field.slower
    col, right = _corner(x - field.west_m, field.apart_m, nodes.shape[1])
    row, up = _corner(y - field.south_m, field.apart_m, nodes.shape[0])
    south = (1.0 - right) * nodes[row, col] + right * nodes[row, col + 1]
    north = (1.0 - right) * nodes[row + 1, col] + right * nodes[row + 1, col + 1]
    return (1.0 - up) * south + up * north


@kernel
def stretch(points, origin, field, found):  # type: ignore[no-untyped-def]
    """Write the mean of exp w along the path to each point into ``found`` (n,)."""
    for place in range(points.shape[0]):
        x, y = origin[place, 0], origin[place, 1]
        dx, dy = (points[place, 0] - x) / PARTS, (points[place, 1] - y) / PARTS
        total = 0.0
        for piece in range(PARTS):
            total += _at(x + (piece + 0.5) * dx, y + (piece + 0.5) * dy, field)
        found[place] = total / PARTS


@kernel
def _share(x, y, dx, dy, number, field):  # type: ignore[no-untyped-def]
    """Return one of the four nodes around a part of a path, and the node's weight in the mean."""
    rows, cols = field.slower.shape
    piece = number // 4 + 0.5
    col, right = _corner(x + piece * dx - field.west_m, field.apart_m, cols)
    row, up = _corner(y + piece * dy - field.south_m, field.apart_m, rows)
    if number % 2:
        col += 1
    else:
        right = 1.0 - right
    if number % 4 >= 2:
        row += 1
    else:
        up = 1.0 - up
    return row * cols + col, right * up / PARTS


@kernel
def slopes(points, origin, field, found):  # type: ignore[no-untyped-def]
    """Compute the derivatives of ln(mean of exp w along each path) with respect to w at each node.

    The derivatives are written into ``found`` (n, rows, cols), which is 0 on entry.
    """
    cols = field.slower.shape[1]
    for place in range(points.shape[0]):
        x, y = origin[place, 0], origin[place, 1]
        dx, dy = (points[place, 0] - x) / PARTS, (points[place, 1] - y) / PARTS
        total = 0.0
        for second in range(2):
            for corner in range(4 * PARTS):
                node, share = _share(x, y, dx, dy, corner, field)
                part = share * field.slower[node // cols, node % cols]
                if second:
                    found[place, node // cols, node % cols] += part / total
                else:
                    total += part


@kernel
def variances(points, origin, of_rates, field, covariance, found):  # type: ignore[no-untyped-def]
    """Write the variance of ln(time along each path) into ``found`` (n,).

    ``of_rates`` (n, k) are the derivatives of this logarithm with respect to the rates.
    ``covariance`` (k + nodes, k + nodes) is the covariance matrix of the rates and of w at the
    nodes. All parts of a path have the same weight.
    """
    k = of_rates.shape[1]
    for place in range(points.shape[0]):
        x, y = origin[place, 0], origin[place, 1]
        dx, dy = (points[place, 0] - x) / PARTS, (points[place, 1] - y) / PARTS
        total = 0.0
        for one in range(k):
            for other in range(k):
                both = of_rates[place, one] * of_rates[place, other]
                total += both * covariance[one, other]
        for corner in range(4 * PARTS):
            node, share = _share(x, y, dx, dy, corner, field)
            for rate in range(k):
                total += 2.0 * share * of_rates[place, rate] * covariance[rate, k + node]
            for another in range(4 * PARTS):
                other_node, other_share = _share(x, y, dx, dy, another, field)
                total += share * other_share * covariance[k + node, k + other_node]
        found[place] = total
