"""Converts a path over the ground to mission items.

Every mission ends in an unlimited loiter, so that a vehicle without a link stays in a safe place.
Altitudes are above mean sea level. Each leg, flown as a straight line between its ends, clears the
terrain below it by the configured height.
"""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from autopilot_bridge.items import (
    MissionItem,
    camera_trigger,
    change_speed,
    fly_as_plane,
    gimbal_pitch,
    loiter_unlimited,
    speed_type,
    waypoint,
)
from firemodel.landscape.landscape import Landscape
from mission_service.config.sections import VehicleSection
from mission_service.missions.departure import takeoff_items
from mission_service.missions.landing import hovers_on
from mission_service.missions.orbits import CORRIDOR_M, highest_ground_m

Floats = NDArray[np.float64]
BESIDE_CLEARANCE_M = 30.0  # height of a plane above the ground within CORRIDOR_M of its legs
LeastAltitude = Callable[[Floats], Floats]


def no_least(points_m: Floats) -> Floats:
    """Return -inf as the minimum altitude at points (n, 2), so that only terrain matters."""
    return np.full(len(points_m), -np.inf)


def flyable(path_m: Floats, turn_radius_m: float, min_leg_m: float, tolerance_m: float) -> Floats:
    """Return a path (m, 2) with fewer, longer legs than ``path_m`` (n, 2); x, y in metres.

    The path is simplified to ``tolerance_m``. A point is omitted if the leg to it is shorter than
    ``min_leg_m``, or too short for a fly-by turn there (turn radius times the tangent of half the
    turn angle). The last point is always kept.
    """
    if len(path_m) < 3:
        return path_m
    # Points are rounded to a micrometre, because GEOS divides by zero for closer points.
    line = shapely.simplify(shapely.LineString(np.round(path_m, 6)), tolerance_m)
    points = shapely.get_coordinates(line)
    points[0], points[-1] = path_m[0], path_m[-1]
    kept = [points[0]]
    for index in range(1, len(points) - 1):
        leg = points[index] - kept[-1]
        after = points[index + 1] - points[index]
        turn = abs(
            (math.atan2(after[1], after[0]) - math.atan2(leg[1], leg[0]) + math.pi) % math.tau
            - math.pi
        )
        needed_m = turn_radius_m * math.tan(min(turn, 2.6) / 2.0)
        if np.hypot(*leg) >= max(min_leg_m, needed_m):
            kept.append(points[index])
    if len(kept) > 1 and np.hypot(*(points[-1] - kept[-1])) < min_leg_m:
        kept.pop()
    return np.array([*kept, points[-1]])


def leg_altitudes_m(
    points_m: Floats,
    landscape: Landscape,
    altitude_agl_m: float,
    around_last_m: float,
    min_at: LeastAltitude = no_least,
) -> list[float]:
    """Return an altitude above sea level for each point so that all legs clear the terrain.

    The last point is a loiter, for which terrain within ``around_last_m`` is considered. ``min_at``
    gives the minimum altitude at points (n, 2), independent of the terrain.
    """
    highest = [
        _needed_m(_along(start, end, landscape), landscape, altitude_agl_m, min_at)
        for start, end in pairwise(points_m)
    ]
    turns = np.linspace(0.0, math.tau, 32, endpoint=False)
    circle = around_last_m * np.column_stack([np.cos(turns), np.sin(turns)])
    around = np.concatenate([points_m[-1] + share * circle for share in (0.0, 0.5, 1.0)])
    highest.append(_needed_m(around, landscape, altitude_agl_m, min_at))
    legs = [highest[0], *highest]
    return [round(max(before, after), 1) for before, after in pairwise(legs)]


def _along(start_m: Floats, end_m: Floats, landscape: Landscape) -> Floats:
    """Return points (n, 2) on a leg, at most half a cell of the landscape apart."""
    length_m = float(np.hypot(*(end_m - start_m)))
    count = max(2, math.ceil(length_m / (landscape.cell_size_m / 2.0)) + 1)
    return np.asarray(start_m + np.linspace(0.0, 1.0, count)[:, None] * (end_m - start_m))


def _above_ground_beside_m(points_m: Floats, landscape: Landscape) -> list[float]:
    """Return an altitude for each point such that all legs clear the ground beside them.

    A plane may fly beside a leg: before and after turns, and while it holds for an upload.
    """
    places = [(float(x_m), float(y_m)) for x_m, y_m in points_m]
    legs = pairwise([*places, places[-1]])
    highest = [highest_ground_m(landscape, *leg, CORRIDOR_M) for leg in legs]
    return [round(max(pair) + BESIDE_CLEARANCE_M, 1) for pair in pairwise([highest[0], *highest])]


def _needed_m(
    points_m: Floats, landscape: Landscape, altitude_agl_m: float, min_at: LeastAltitude
) -> float:
    terrain_m = float(np.max(landscape.elevation_at(points_m[:, 0], points_m[:, 1])))
    return max(terrain_m + altitude_agl_m, float(np.max(min_at(points_m))))


def _end_of_images(
    points_m: Floats, altitude_amsl_m: float, vehicle: VehicleSection, landscape: Landscape
) -> list[MissionItem]:
    """Return the items that stop the camera where the last leg (n, 2) reaches the loiter.

    Items after an unlimited loiter are not executed. If the last leg is short, the camera stops
    before this leg.
    """
    stop = [camera_trigger(0.0)]
    leg = points_m[-1] - points_m[-2] if len(points_m) > 1 else np.zeros(2)
    length_m = float(np.hypot(*leg))
    if length_m < vehicle.loiter_radius_m + vehicle.min_leg_m:
        return stop
    place = points_m[-1] - leg * vehicle.loiter_radius_m / length_m
    lat_deg, lon_deg = landscape.lat_lon_of(float(place[0]), float(place[1]))
    return [waypoint(float(lat_deg), float(lon_deg), altitude_amsl_m), *stop]


def mission_along(
    path_m: Floats,
    clockwise: bool,
    vehicle: VehicleSection,
    landscape: Landscape,
    from_ground: bool,
    landing: tuple[MissionItem, ...] = (),
    min_at: LeastAltitude = no_least,
    start_m: tuple[float, float] | None = None,
) -> tuple[MissionItem, ...]:
    """Return the mission along a path (x, y in metres), with an unlimited loiter at its end.

    Each mission first sets the speed (after any takeoff), because autopilots reset the speed when
    the mode changes. If the vehicle has ``camera_trigger_m``, the camera takes images up to the end
    of the path. ``landing`` follows the loiter, for autopilots that require a landing. ``start_m``
    is the position of a vehicle in the air.
    """
    points = flyable(path_m, vehicle.turn_radius_m, vehicle.min_leg_m, landscape.cell_size_m / 2)
    altitudes = leg_altitudes_m(
        points, landscape, vehicle.altitude_agl_m, 1.5 * vehicle.loiter_radius_m, min_at
    )
    if start_m is not None:  # the vehicle climbs from its position to the first point's altitude
        first = _along(np.array(start_m), points[0], landscape)
        needed_m = _needed_m(first, landscape, vehicle.altitude_agl_m, min_at)
        altitudes[0] = max(altitudes[0], round(needed_m, 1))
    if vehicle.winged:
        beside = _above_ground_beside_m(points, landscape)
        altitudes = [max(pair) for pair in zip(altitudes, beside, strict=True)]
    lat, lon = landscape.lat_lon_of(points[:, 0], points[:, 1])
    items = [change_speed(speed_type(vehicle.kind), vehicle.airspeed_m_s)]
    if vehicle.gimbal_pitch_deg is not None:
        items.append(gimbal_pitch(vehicle.gimbal_pitch_deg))
    if vehicle.camera_trigger_m is not None:
        items.append(camera_trigger(vehicle.camera_trigger_m))
    items += [
        waypoint(float(lat[index]), float(lon[index]), altitudes[index])
        for index in range(len(points) - 1)
    ]
    if vehicle.camera_trigger_m is not None:
        items += _end_of_images(points, altitudes[-1], vehicle, landscape)
    radius_m = vehicle.loiter_radius_m if clockwise else -vehicle.loiter_radius_m
    items.append(loiter_unlimited(float(lat[-1]), float(lon[-1]), altitudes[-1], radius_m))
    begin: tuple[MissionItem, ...] = (fly_as_plane(),) if hovers_on(vehicle) else ()
    if from_ground:
        toward = (float(points[-1][0]), float(points[-1][1]))
        begin = takeoff_items(vehicle, landscape, altitudes[0], toward)
    return (*begin, *items, *landing)
