"""A plan on its way: where it leads, what is to be dropped next, whether the rest is still safe."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape import Landscape
from mission_service.burn.flight import Air, Place
from mission_service.burn.hazard import Hazard, hazard_of
from mission_service.burn.plan import IgnitionPlan
from mission_service.burn.timetable import Timetable

Floats = NDArray[np.float64]

HIGH_SHARE = 0.9  # of the safe height: high enough
OWN_SOON_S = 10.0


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

    By the rules that plans are made by, but that nearly the safe height is safe as well: nothing
    flies quite as high as it is told. None: all of it is safe.

    ``own_sources`` (m, 3) are spheres that it has dropped on the way. That it leaves them in time
    the plan has seen to, so here they are too near when they burn within reach, or soon will.
    """
    safe_m = air.settings.safe_height_m
    places = [
        Place(x_m, y_m, safe_m if height_m >= HIGH_SHARE * safe_m else height_m, at_s)
        for x_m, y_m, height_m, at_s in path.tolist()
    ]
    legs = [leg for leg in pairwise(places) if not air.is_high(leg)]
    soon_s = min(OWN_SOON_S, air.settings.ignition_delay_s / 3.0)
    own = _own_hazard(legs, air, own_sources)
    for begin, end in legs:
        way = (begin.x_m, begin.y_m, begin.at_s, end.x_m, end.y_m, end.at_s)
        if air.margin_s((begin, end)) < air.settings.time_margin_s:
            return begin.at_s
        if own is not None and own.leg_margin_s(*way) < soon_s:
            return begin.at_s
    return None


def _own_hazard(legs: list[tuple[Place, Place]], air: Air, own_sources: Floats) -> Hazard | None:
    if not len(own_sources) or not legs:
        return None
    x_m = [place.x_m for leg in legs for place in leg]
    y_m = [place.y_m for leg in legs for place in leg]
    return hazard_of(
        air.lights(own_sources),
        (min(x_m), min(y_m), max(x_m), max(y_m)),
        air.hazard.margins,
        cell_m=air.hazard.cell_m,
        sources=own_sources,
    )
