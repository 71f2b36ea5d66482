"""Simplifies rings in O(n log n) and without recursion, since rings are uploaded."""

import heapq

import shapely

Ring = list[tuple[float, float]]
TRIED = 4  # times ``most``: corners kept for a second try, if sides cross


def thinned(ring: Ring, most: int) -> Ring:
    """Simplify a ring to at most ``most`` corners with the least change; no sides cross.

    The first corner is not repeated at the end. Never raises: it leaves out what it cannot keep.
    """
    if len(ring) <= most:
        return ring
    found = min_areas_removed(ring, most)
    if shapely.Polygon(found).is_valid:
        return found
    # Sides cross: simplify with topology preserved, which is slow, on few corners.
    few = shapely.Polygon(min_areas_removed(ring, TRIED * most))
    parts = shapely.get_parts(shapely.make_valid(few, method="structure", keep_collapsed=False))
    largest = shapely.Polygon(max(parts, key=lambda part: part.area).exterior)
    tolerance, kept = 1e-6, shapely.get_coordinates(largest)
    while len(kept) - 1 > most:
        kept = shapely.get_coordinates(largest.simplify(tolerance))
        tolerance *= 2.0
    return [(float(x), float(y)) for x, y in kept[:-1]]


def min_areas_removed(ring: Ring, most: int) -> Ring:
    """Return a ring without the corners that span the smallest triangles (Visvalingam & Whyatt 1993)."""
    count = len(ring)
    before = [(k - 1) % count for k in range(count)]
    after = [(k + 1) % count for k in range(count)]

    def area(corner: int) -> float:
        (ax, ay), (bx, by), (cx, cy) = ring[before[corner]], ring[corner], ring[after[corner]]
        return abs((bx - ax) * (cy - ay) - (cx - ax) * (by - ay))

    areas = [area(corner) for corner in range(count)]
    heap = [(areas[corner], corner) for corner in range(count)]
    heapq.heapify(heap)
    there = [True] * count
    left = count
    while left > max(most, 3):
        smallest, corner = heapq.heappop(heap)
        if not there[corner] or smallest != areas[corner]:
            continue  # the corner was removed, or its area has changed
        there[corner] = False
        left -= 1
        one, other = before[corner], after[corner]
        after[one], before[other] = other, one
        for each in (one, other):
            areas[each] = max(area(each), smallest)  # never less than the area removed before
            heapq.heappush(heap, (areas[each], each))
    return [place for place, stays in zip(ring, there, strict=True) if stays]
