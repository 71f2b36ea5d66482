"""Separation of vehicles: altitude layers, and the rule for which of two vehicles gives way.

Layers are heights above the terrain under each leg, and the legs of two vehicles end at different
points, so that a higher layer may be close to a lower layer over a slope. A mission is therefore
also placed above the missions of vehicles in lower layers (``Track``, ``heights_below``). Two
vehicles may fly at nearly the same altitude because the scenario places them in the same layer, or
during a climb or a return. If they approach each other, one moves away from the fire and loiters
until the other has passed. A landing plane descends through the layers of other vehicles, which
keep clear of its descent (``descent_of``). Coordinates are in metres, x east, y north.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.items import LANDINGS, MissionItem, has_position
from firemodel.landscape.landscape import Landscape
from mission_service.missions.heights import heights_near
from mission_service.position_fix import PositionFix

Floats = NDArray[np.float64]

SPACING_M = 30.0
AROUND = 16  # samples of a loiter
NEAR_M = 200.0  # allows for cut corners, loiters and fronts observed at different times
MARGIN_M = 10.0  # added to the required separation for altitude control errors
AHEAD_S = 25.0  # time for an upload, half a turn and the flight to the waiting position
PASSED_M = 1000.0
NAV_LOITER_UNLIM, NAV_LOITER_TO_ALT, NAV_VTOL_TAKEOFF = 17, 31, 84


@dataclass(frozen=True, slots=True)
class Track:
    """Samples (n, 2) of a mission's track, with the lowest and highest altitude at each sample."""

    points_m: Floats
    lowest_m: Floats
    highest_m: Floats
    box_m: tuple[float, float, float, float] = field(init=False)  # west, south, east, north

    def __post_init__(self) -> None:
        """Compute the bounding box, with which most pairs of tracks are quickly ruled out."""
        object.__setattr__(self, "box_m", box_around(self.points_m))


def track_of(
    items: tuple[MissionItem, ...],
    landscape: Landscape,
    radius_m: float,
    start_m: tuple[float, float] | None = None,
) -> Track:
    """Return the track of a mission, up to and including one lap of its unlimited loiter.

    From ``start_m`` to the first point, the track has that point's altitude. A vertical takeoff,
    whose height is relative to home, is omitted.
    """
    last = next(place for place, item in enumerate(items) if item.command == NAV_LOITER_UNLIM)
    with_place = [item for item in items[: last + 1] if has_position(item.command)]
    flown = [item for item in with_place if item.command != NAV_VTOL_TAKEOFF]
    lat, lon = (np.array([getattr(item, axis) for item in flown]) / 1e7 for axis in "xy")
    points = np.column_stack(landscape.xy_of_lat_lon(lat, lon))
    altitudes = np.array([item.z for item in flown])
    if start_m is not None:
        points = np.vstack([start_m, points])
        altitudes = np.concatenate([altitudes[:1], altitudes])
    parts, lowest, highest = [], [], []
    for leg in range(len(points) - 1):
        parts.append(along(points[leg], points[leg + 1]))
        pair = altitudes[leg : leg + 2]
        lowest.append(np.full(len(parts[-1]), pair.min()))
        highest.append(np.full(len(parts[-1]), pair.max()))
    turns = np.linspace(0.0, math.tau, AROUND, endpoint=False)
    parts.append(points[-1] + radius_m * np.column_stack([np.cos(turns), np.sin(turns)]))
    lowest.append(np.full(AROUND, altitudes[-1]))
    highest.append(np.full(AROUND, altitudes[-1]))
    return Track(np.concatenate(parts), np.concatenate(lowest), np.concatenate(highest))


def descent_of(items: tuple[MissionItem, ...], landscape: Landscape, radius_m: float) -> Floats:
    """Return points (n, 2) of the descent in a landing mission: its loiter and the final leg."""
    place = {item.command: (item.x / 1e7, item.y / 1e7) for item in items}
    touchdown = next(place[command] for command in LANDINGS if command in place)
    home_m = np.array(landscape.xy_of_lat_lon(*touchdown))
    loiter_m = np.array(landscape.xy_of_lat_lon(*place.get(NAV_LOITER_TO_ALT, touchdown)))
    turns = np.linspace(0.0, math.tau, AROUND, endpoint=False)
    ring = loiter_m + radius_m * np.column_stack([np.cos(turns), np.sin(turns)])
    return np.vstack([ring, along(loiter_m, home_m)])


def ahead_on(track: Track, x_m: float, y_m: float) -> Track:
    """Return the part of a track that remains to be flown from a position."""
    first = int(np.argmin(np.hypot(track.points_m[:, 0] - x_m, track.points_m[:, 1] - y_m)))
    return Track(track.points_m[first:], track.lowest_m[first:], track.highest_m[first:])


def places_of(fixes: list[PositionFix]) -> Track:
    """Return the positions of one or more vehicles as a track."""
    places = np.array([(fix.x_m, fix.y_m, fix.altitude_m) for fix in fixes])
    return Track(places[:, :2], places[:, 2], places[:, 2])


def along(start: Floats, end: Floats) -> Floats:
    """Return points (n, 2) on a leg, including its ends."""
    count = max(2, math.ceil(np.hypot(*(end - start)) / SPACING_M) + 1)
    return np.asarray(start + np.linspace(0.0, 1.0, count)[:, None] * (end - start))


def box_around(points_m: Floats) -> tuple[float, float, float, float]:
    """Return the west, south, east and north bounds of points (n, 2), n > 0."""
    (west_m, south_m), (east_m, north_m) = points_m.min(axis=0), points_m.max(axis=0)
    return float(west_m), float(south_m), float(east_m), float(north_m)


def heights_below(points_m: Floats, tracks: list[Track]) -> Floats:
    """Return the highest altitude of the tracks near each point (n, 2); -inf if none is near."""
    found = np.full(len(points_m), -np.inf)
    if not len(points_m):
        return found
    west_m, south_m, east_m, north_m = box_around(points_m)
    near = [
        track
        for track in tracks
        if track.box_m[0] <= east_m + NEAR_M
        and track.box_m[2] >= west_m - NEAR_M
        and track.box_m[1] <= north_m + NEAR_M
        and track.box_m[3] >= south_m - NEAR_M
    ]
    if near:
        others_m = np.concatenate([track.points_m for track in near])
        highest_m = np.concatenate([track.highest_m for track in near])
        heights_near(points_m, others_m, highest_m, NEAR_M, found)
    return found


def comes_too_low(track: Track, others: list[Track], separation_m: float) -> bool:
    """Return whether a mission is less than ``separation_m`` above the tracks below it."""
    return bool(np.any(track.lowest_m < heights_below(track.points_m, others) + separation_m))


def is_near(
    own: PositionFix, other: PositionFix, separation_m: float, turn_radius_m: float
) -> bool:
    """Return whether two vehicles at similar altitudes are, or soon will be, close together."""
    if abs(own.altitude_m - other.altitude_m) >= separation_m:
        return False
    near_m = separation_m + 2.0 * turn_radius_m
    east_m, north_m = other.x_m - own.x_m, other.y_m - own.y_m
    if math.hypot(east_m, north_m) < near_m:
        return True
    east_m_s, north_m_s = other.east_m_s - own.east_m_s, other.north_m_s - own.north_m_s
    speed_2 = east_m_s**2 + north_m_s**2
    if speed_2 == 0.0:
        return False
    until_s = -(east_m * east_m_s + north_m * north_m_s) / speed_2
    missed_m = math.hypot(east_m + until_s * east_m_s, north_m + until_s * north_m_s)
    return 0.0 < until_s < AHEAD_S and missed_m < near_m


def gives_way(own: PositionFix, other: PositionFix, own_comes_later: bool) -> bool:
    """Return whether ``own`` gives way to ``other``.

    The vehicle behind gives way. If neither vehicle is behind, ``own_comes_later`` decides.
    """
    east_m, north_m = other.x_m - own.x_m, other.y_m - own.y_m
    towards = own.east_m_s * east_m + own.north_m_s * north_m > 0.0
    comes = other.east_m_s * east_m + other.north_m_s * north_m < 0.0
    return own_comes_later if towards == comes else towards


def has_passed(
    own: PositionFix, other: PositionFix, separation_m: float, turn_radius_m: float
) -> bool:
    """Return whether a vehicle that gave way may continue, by horizontal distance alone."""
    east_m, north_m = other.x_m - own.x_m, other.y_m - own.y_m
    distance_m = math.hypot(east_m, north_m)
    leaves = other.east_m_s * east_m + other.north_m_s * north_m >= 0.0
    far_m = 2.0 * (separation_m + 2.0 * turn_radius_m)
    return distance_m > PASSED_M or (leaves and distance_m > far_m)


def straight_on(fix: PositionFix) -> Floats:
    """Return points (n, 2) on a vehicle's course, as far as it flies in ``AHEAD_S``."""
    start = np.array([fix.x_m, fix.y_m])
    return along(start, start + AHEAD_S * np.array([fix.east_m_s, fix.north_m_s]))


def avoidance_position(
    own: PositionFix, other_path_m: Floats, away_from_m: tuple[float, float], offset_m: float
) -> Floats:
    """Return the waiting position (1, 2), ahead and to one side.

    The side is the one away from the fire, unless the other vehicle's path (n, 2) is on that side.
    """
    speed = max(math.hypot(own.east_m_s, own.north_m_s), 0.1)
    ahead = np.array([own.east_m_s, own.north_m_s]) / speed
    right = np.array([ahead[1], -ahead[0]])
    fix = np.array([own.x_m, own.y_m])
    outwards = right if float(right @ (fix - away_from_m)) >= 0.0 else -right
    places = [fix + offset_m * (ahead / 3.0 + side) for side in (outwards, -outwards)]
    clear_m = [float(np.hypot(*(other_path_m - place).T).min()) for place in places]
    chosen = places[0 if clear_m[0] >= min(offset_m / 2.0, clear_m[1]) else 1]
    return np.array([chosen])
