"""A perimeter that others drew becomes corrections, a ring each."""

from typing import Any

import shapely

from mission_service.api.answers import ApiError
from mission_service.maps.perimeters_in import Perimeter

MOST_RINGS = 50
MOST_POINTS = 900  # of a correction; less than requests may have


def corrections_of(perimeter: Perimeter) -> list[dict[str, Any]]:
    """A request for each outline: the fire burns along it now. Raises ApiError for too many."""
    rings = perimeter.rings()
    if len(rings) > MOST_RINGS:
        raise ApiError(422, f"it has {len(rings)} outlines; at most {MOST_RINGS} can be taken")
    asked = {"do": "correct", "state": "burning", "shape": "polygon"}
    return [{**asked, "points": thinned(ring)} for ring in rings]


def thinned(ring: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """A ring (lat, lon) with as many corners as a request may have, its shape kept at best."""
    tolerance_deg, kept = 1e-6, ring
    while len(kept) > MOST_POINTS:
        polygon = shapely.Polygon(ring).simplify(tolerance_deg)
        kept = [(float(lat), float(lon)) for lat, lon in shapely.get_coordinates(polygon)[:-1]]
        tolerance_deg *= 2.0
    return kept
