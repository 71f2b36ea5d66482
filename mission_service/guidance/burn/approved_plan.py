"""Tracks an approved plan in flight, and checks whether the remaining path is safe."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from mission_service.guidance.burn.lines.flight_constraints import (
    FlightConstraints,
    FlightPoint,
    Leg,
)
from mission_service.ignition_plan import IgnitionPlan, PathPoint, PlannedDrop

Floats = NDArray[np.float64]

MAX_PROGRESS_M = 30.0  # maximum progress in one update
HIGH_SHARE = 0.9  # a vehicle above this fraction of the safe height counts as at the safe height
# For fire from the vehicle's own spheres: the upper limit of the time margin, the spacing of
# samples along a leg, and the number of points on the circle around a sample.
OWN_SOON_S, OWN_SAMPLES_M, OWN_RING_POINTS = 10.0, 5.0, 24


class PathProgress:
    """The progress of a vehicle along a path.

    ``points_m`` (n, 3) holds x, y and height in metres; ``after_s`` (n,) holds the times since the
    path's start.
    """

    def __init__(self, points_m: Floats, after_s: Floats) -> None:
        self.points_m = points_m
        self._after_s = after_s
        steps = np.diff(points_m, axis=0)
        self._lengths_m = np.sqrt((steps * steps).sum(axis=1))
        self._along_m = np.concatenate([[0.0], np.cumsum(self._lengths_m)])
        self.progress_m = 0.0  # progress along the path; never decreases

    @property
    def length_m(self) -> float:
        """Return the length of the whole path, including climbs and descents."""
        return float(self._along_m[-1])

    @property
    def remaining_m(self) -> float:
        """Return the length still to be flown."""
        return self.length_m - self.progress_m

    @property
    def after_s(self) -> float:
        """Return the planned time at the current progress, in seconds since the path's start."""
        return float(np.interp(self.progress_m, self._along_m, self._after_s))

    def update(self, position_m: Floats) -> float:
        """Update the progress from a position (3,); return the distance off the path in metres."""
        first = max(int(np.searchsorted(self._along_m, self.progress_m, side="right")) - 1, 0)
        last = int(np.searchsorted(self._along_m, self.progress_m + MAX_PROGRESS_M))
        min_distance_m, progress_m = np.inf, self.progress_m
        for leg in range(first, min(last, len(self._lengths_m))):
            start, length = self.points_m[leg], self._lengths_m[leg]
            step = self.points_m[leg + 1] - start
            share = low = 0.0
            if length:
                share = float((position_m - start) @ step) / float(length**2)
                low = (self.progress_m - self._along_m[leg]) / length if leg == first else 0.0
            share = min(max(share, low), 1.0)
            distance_m = float(np.linalg.norm(start + share * step - position_m))
            if distance_m < min_distance_m - 1e-6:
                min_distance_m = distance_m
                progress_m = float(self._along_m[leg] + share * length)
        self.progress_m = min(progress_m, self.progress_m + MAX_PROGRESS_M)
        return min_distance_m

    def ahead(self, now_s: float) -> Floats:
        """Return the remaining path (k, 4) with x, y, height and mission time.

        The vehicle is assumed to be at its current progress at ``now_s``.
        """
        rest = self._along_m > self.progress_m
        present = [np.interp(self.progress_m, self._along_m, axis) for axis in self.points_m.T]
        points = np.vstack([present, self.points_m[rest]])
        delay_s = now_s - self.after_s
        times = np.concatenate([[now_s], self._after_s[rest] + delay_s])
        return np.column_stack([points, times])


@dataclass(slots=True)
class ApprovedPlan:
    """An approved plan, and the vehicle's progress along the plan's path."""

    plan: IgnitionPlan
    progress: PathProgress  # progress along the path in x, y and height above the ground
    targets_m: Floats  # (m, 2) targets of the plan's drops
    next_drop: int = 0
    sent: bool = False


def approved_plan_of(plan: IgnitionPlan, landscape: Landscape) -> ApprovedPlan:
    """Return a plan as an ``ApprovedPlan`` with no progress and no drops yet."""
    height_m, after_s = np.array([(point.height_m, point.after_s) for point in plan.path]).T
    progress = PathProgress(np.column_stack([_xy(plan.path, landscape), height_m]), after_s)
    return ApprovedPlan(plan, progress, _xy(plan.drops, landscape))


def _xy(points: Sequence[PathPoint | PlannedDrop], landscape: Landscape) -> Floats:
    places = [(point.lat_deg, point.lon_deg) for point in points]
    lat, lon = np.array(places, dtype=float).reshape(-1, 2).T
    return np.column_stack(landscape.xy_of_lat_lon(lat, lon))


def first_danger_s(path: Floats, air: FlightConstraints, own_sources: Floats) -> float | None:
    """Return the mission time when the first leg too close to fire begins, or None.

    The columns of ``path`` (n, 4) are x, y, height and mission time. The check applies the rules of
    planning, except that ``HIGH_SHARE`` of the safe height counts as the safe height, because no
    vehicle holds its height exactly. The result is None if the whole path is safe.

    ``own_sources`` (m, 3) holds the spheres that the vehicle has dropped on this path. The plan
    ensures that the vehicle flies away from these spheres in time. Fire from such a sphere is
    therefore too close only if it is within reach, or will be within reach in a few seconds.
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


def _own_margin_s(leg: Leg, air: FlightConstraints, own_sources: Floats) -> float:
    """Return a leg's smallest time margin to fire from the vehicle's own spheres.

    For a sphere within reach, the margin ends when the sphere ignites. For a sphere farther
    away, the margin ends when the fire comes within reach.
    """
    begin, end = np.array(leg[0]), np.array(leg[1])
    count = max(math.ceil(math.dist(begin[:2], end[:2]) / OWN_SAMPLES_M), 1) + 1
    along = begin + np.linspace(0.0, 1.0, count)[:, None] * (end - begin)
    reach_m = air.hazard.margins.reach_m
    to_sources = along[:, None, :2] - own_sources[None, :, :2]
    within = np.hypot(to_sources[..., 0], to_sources[..., 1]) <= reach_m
    lit_s = np.where(within, own_sources[None, :, 2], np.inf).min(axis=1)
    turns = np.linspace(0.0, math.tau, OWN_RING_POINTS, endpoint=False)
    ring = reach_m * np.column_stack([np.cos(turns), np.sin(turns)])
    points = (along[:, None, :2] + ring[None]).reshape(-1, 2)
    arrives_s = air.lights(own_sources).ignition_time_s(points).reshape(count, OWN_RING_POINTS)
    return float((np.minimum(lit_s, arrives_s.min(axis=1)) - along[:, 3]).min())
