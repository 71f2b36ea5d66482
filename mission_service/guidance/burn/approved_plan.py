"""An approved plan in flight: progress, next drop, and whether the rest is still safe."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from mission_service.guidance.burn.line_flight import FlightConstraints, FlightPoint
from mission_service.guidance.burn.path_progress import PathProgress
from mission_service.ignition_plan import IgnitionPlan

Floats = NDArray[np.float64]

HIGH_SHARE = 0.9  # of the safe height: high enough
OWN_SOON_S, OWN_SAMPLES_M, OWN_AROUND = 10.0, 5.0, 24


@dataclass(slots=True)
class ApprovedPlan:
    """The approved plan and its progress."""

    plan: IgnitionPlan
    progress: PathProgress  # in x, y and height above the ground
    targets_m: Floats  # (m, 2) of its drops
    next_drop: int = 0
    sent: bool = False
    looked_at_s: float = -math.inf


def approved_plan_of(plan: IgnitionPlan, landscape: Landscape) -> ApprovedPlan:
    """An approved plan before its begin."""
    points = np.array([(point.height_m, point.after_s) for point in plan.path])
    places = _xy([(point.lat_deg, point.lon_deg) for point in plan.path], landscape)
    progress = PathProgress(np.column_stack([places, points[:, 0]]), points[:, 1])
    targets = _xy([(drop.lat_deg, drop.lon_deg) for drop in plan.drops], landscape)
    return ApprovedPlan(plan, progress, targets)


def _xy(places: list[tuple[float, float]], landscape: Landscape) -> Floats:
    lat, lon = np.array(places, dtype=float).reshape(-1, 2).T
    return np.column_stack(landscape.xy_of_lat_lon(lat, lon))


def first_danger_s(path: Floats, air: FlightConstraints, own_sources: Floats) -> float | None:
    """When a vehicle on a path (n, 4) x, y, height, at_s first comes too near to fire.

    By the rules of planning, but a height of nearly the safe height is safe as well, since no
    vehicle holds its height exactly. None: all of it is safe.

    ``own_sources`` (m, 3) are spheres that it has dropped on the path. The plan ensures that it
    leaves them in time, so here they are too near only when they burn within reach, or soon will.
    """
    safe_m = air.settings.safe_height_m
    places = [
        FlightPoint(x_m, y_m, safe_m if height_m >= HIGH_SHARE * safe_m else height_m, at_s)
        for x_m, y_m, height_m, at_s in path.tolist()
    ]
    soon_s = min(OWN_SOON_S, air.settings.ignition_delay_s / 3.0)
    for leg in pairwise(places):
        if air.is_high(leg):
            continue
        if air.margin_s(leg) < air.settings.time_margin_s:
            return leg[0].at_s
        if len(own_sources) and _own_margin_s(leg, air, own_sources) < soon_s:
            return leg[0].at_s
    return None


def _own_margin_s(
    leg: tuple[FlightPoint, FlightPoint], air: FlightConstraints, own_sources: Floats
) -> float:
    """The smallest time by which a leg is ahead of the fires of own spheres within reach.

    From each sphere itself, and from its fire where that enters the reach from outside.
    """
    begin, end = np.array(leg[0]), np.array(leg[1])
    count = max(math.ceil(math.dist(begin[:2], end[:2]) / OWN_SAMPLES_M), 1) + 1
    along = begin + np.linspace(0.0, 1.0, count)[:, None] * (end - begin)
    reach_m = air.hazard.margins.reach_m
    to_sources = along[:, None, :2] - own_sources[None, :, :2]
    within = np.hypot(to_sources[..., 0], to_sources[..., 1]) <= reach_m
    lit_s = np.where(within, own_sources[None, :, 2], np.inf).min(axis=1)
    turns = np.linspace(0.0, math.tau, OWN_AROUND, endpoint=False)
    ring = reach_m * np.column_stack([np.cos(turns), np.sin(turns)])
    points = (along[:, None, :2] + ring[None]).reshape(-1, 2)
    comes_s = air.lights(own_sources).ignition_time_s(points).reshape(count, OWN_AROUND)
    return float((np.minimum(lit_s, comes_s.min(axis=1)) - along[:, 3]).min())
