"""Simplifies uploaded rings in O(n log n) and without recursion."""

import heapq
import itertools

import shapely

Ring = list[tuple[float, float]]
TRIED = 4  # if sides cross, the second attempt starts from this multiple of ``most`` corners


def thinned(ring: Ring, most: int) -> Ring:
    """Simplify a ring to at most ``most`` corners, with little change and no crossing sides.

    The last corner differs from the first. If the simplified ring crosses itself, the result is the
    outline of its largest part. The function raises no exception.
    """
    if len(ring) <= most:
        return ring
    found = min_areas_removed(ring, most)
    if shapely.Polygon(found).is_valid:
        return found
    # Sides cross: apply the slow simplification that preserves topology to a ring of few corners.
    few = shapely.Polygon(min_areas_removed(ring, TRIED * most))
    parts = shapely.get_parts(shapely.make_valid(few, method="structure", keep_collapsed=False))
    largest = shapely.Polygon(max(parts, key=lambda part: part.area).exterior)
    tolerance, corners = 1e-6, shapely.get_coordinates(largest)
    while len(corners) - 1 > most:
        corners = shapely.get_coordinates(largest.simplify(tolerance))
        tolerance *= 2.0
    return [(float(x), float(y)) for x, y in corners[:-1]]


def min_areas_removed(ring: Ring, most: int) -> Ring:
    """Return a ring without the corners of the smallest triangles (Visvalingam & Whyatt 1993)."""
    count = len(ring)
    before = [(k - 1) % count for k in range(count)]
    after = [(k + 1) % count for k in range(count)]

    def area(corner: int) -> float:
        (ax, ay), (bx, by), (cx, cy) = ring[before[corner]], ring[corner], ring[after[corner]]
        return abs((bx - ax) * (cy - ay) - (cx - ax) * (by - ay))

    areas = [area(corner) for corner in range(count)]
    heap = [(areas[corner], corner) for corner in range(count)]
    heapq.heapify(heap)
    present = [True] * count
    left = count
    while left > max(most, 3):
        smallest, corner = heapq.heappop(heap)
        if not present[corner] or smallest != areas[corner]:
            continue  # the corner was removed, or its area has changed
        present[corner] = False
        left -= 1
        one, other = before[corner], after[corner]
        after[one], before[other] = other, one
        for each in (one, other):
            areas[each] = max(area(each), smallest)  # never less than the last removed area
            heapq.heappush(heap, (areas[each], each))
    return list(itertools.compress(ring, present))
