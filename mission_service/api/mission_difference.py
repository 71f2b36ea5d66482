"""What a person looks at before saying yes to a mission, beside its figures. Pure."""

import math
from collections.abc import Sequence

from mission_service.api.states import Difference
from mission_service.distance import M_PER_DEG
from mission_service.picture import ItemState


def farthest_m(items: Sequence[ItemState], lat_deg: float, lon_deg: float) -> float:
    """How far from a place a mission leads."""
    placed = [(item.lat_deg, item.lon_deg) for item in items]
    away_m = [
        _distance_m(lat_deg, lon_deg, lat, lon)
        for lat, lon in placed
        if lat is not None and lon is not None
    ]
    return round(max(away_m, default=0.0), 1)


def difference_of(before: Sequence[ItemState], after: Sequence[ItemState]) -> Difference:
    """How a mission differs from the one before it, item by item from the first."""
    alike = 0
    while alike < min(len(before), len(after)) and before[alike] == after[alike]:
        alike += 1
    moved_m = [_apart_m(old, new) for old, new in zip(before, after, strict=False)]
    return Difference(
        alike, len(after) - alike, len(before) - alike, round(max(moved_m, default=0.0), 1)
    )


def _apart_m(one: ItemState, other: ItemState) -> float:
    if one.lat_deg is None or one.lon_deg is None:
        return 0.0
    if other.lat_deg is None or other.lon_deg is None:
        return 0.0
    return _distance_m(one.lat_deg, one.lon_deg, other.lat_deg, other.lon_deg)


def _distance_m(
    lat_deg: float, lon_deg: float, other_lat_deg: float, other_lon_deg: float
) -> float:
    """Between places so near to each other that the earth is flat."""
    east_deg = (other_lon_deg - lon_deg) * math.cos(math.radians(lat_deg))
    return M_PER_DEG * math.hypot(other_lat_deg - lat_deg, east_deg)
