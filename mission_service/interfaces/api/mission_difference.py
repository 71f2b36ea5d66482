"""Computes the difference between two missions. Pure."""

from collections.abc import Sequence

from mission_service.ground_distance import distance_m
from mission_service.interfaces.api.models import MissionDifference
from mission_service.runtime.published_states import ItemState


def difference_of(before: Sequence[ItemState], after: Sequence[ItemState]) -> MissionDifference:
    """Return the difference between two missions, item by item from the first."""
    alike = 0
    while alike < min(len(before), len(after)) and before[alike] == after[alike]:
        alike += 1
    moved_m = [_apart_m(old, new) for old, new in zip(before, after, strict=False)]
    return MissionDifference(
        alike, len(after) - alike, len(before) - alike, round(max(moved_m, default=0.0), 1)
    )


def _apart_m(one: ItemState, other: ItemState) -> float:
    """Return the distance between two items in metres; 0 if either has no position."""
    if one.lat_deg is None or one.lon_deg is None or other.lat_deg is None or other.lon_deg is None:
        return 0.0
    return distance_m((one.lat_deg, one.lon_deg), (other.lat_deg, other.lon_deg))
