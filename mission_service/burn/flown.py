"""A plan on its way: where it leads, what is to be dropped next, whether the rest is still safe."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape import Landscape
from mission_service.burn.flight import Air, OwnFires, Place
from mission_service.burn.plan import IgnitionPlan
from mission_service.burn.timetable import Timetable

Floats = NDArray[np.float64]


@dataclass(slots=True)
class Flown:
    """The plan that is approved, as it is flown."""

    plan: IgnitionPlan
    table: Timetable  # in x, y and height above the ground
    targets_m: Floats  # (m, 2) of its drops
    next_drop: int = 0
    sent: bool = False
    looked_at_s: float = -math.inf


def flown_of(plan: IgnitionPlan, landscape: Landscape) -> Flown:
    """A plan, not yet begun."""
    points = np.array([(point.height_m, point.after_s) for point in plan.path])
    places = _xy([(point.lat_deg, point.lon_deg) for point in plan.path], landscape)
    table = Timetable(np.column_stack([places, points[:, 0]]), points[:, 1])
    targets = _xy([(drop.lat_deg, drop.lon_deg) for drop in plan.drops], landscape)
    return Flown(plan, table, targets)


def _xy(places: list[tuple[float, float]], landscape: Landscape) -> Floats:
    lat, lon = np.array(places, dtype=float).reshape(-1, 2).T
    return np.column_stack(landscape.xy_of_lat_lon(lat, lon))


def first_danger_s(path: Floats, air: Air, own_sources: Floats) -> float | None:
    """When a vehicle on a path (n, 4) x, y, height, at_s first comes too near to fire.

    By the rules that plans are made by; ``own_sources`` (m, 3) are spheres that it has dropped on
    the way. None: all of it is safe.
    """
    own = OwnFires(air)
    own.sources = own_sources
    for begin, end in pairwise(Place(*row) for row in path.tolist()):
        leg = (begin, end)
        if min(air.margin_s(leg), own.margin_s(leg)) < air.settings.time_margin_s:
            return begin.at_s
    return None
