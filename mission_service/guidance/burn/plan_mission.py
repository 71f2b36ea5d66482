"""Creates multirotor missions along an ignition plan's path; the missions contain no drops."""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem, change_speed, loiter_unlimited, takeoff, waypoint
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.config.sections import BurnSection, VehicleSection
from mission_service.guidance.burn.burn_unit import burn_unit_of
from mission_service.ignition_plan import PathPoint

Floats = NDArray[np.float64]

# Mission commands that affect only the flight. Any other command may switch an output, for example
# a command for servos, relays, grippers, winches, sprayers, cameras, parachutes, auxiliary
# functions or scripts.
FLIES_ONLY = frozenset(
    (
        mavlink.MAV_CMD_NAV_WAYPOINT,
        mavlink.MAV_CMD_NAV_LOITER_UNLIM,
        mavlink.MAV_CMD_NAV_LOITER_TIME,
        mavlink.MAV_CMD_NAV_LOITER_TO_ALT,
        mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
        mavlink.MAV_CMD_NAV_LAND,
        mavlink.MAV_CMD_NAV_TAKEOFF,
        mavlink.MAV_CMD_NAV_DELAY,
        mavlink.MAV_CMD_DO_CHANGE_SPEED,
    )
)
ACCEPTANCE_M = 2.0  # acceptance radius of waypoints; ArduCopter uses its own (WPNAV_RADIUS)
BAND = 0.2  # the height above the ground may exceed a leg's height by up to this fraction
SAMPLES_A_CELL = 4
SAME_PLACE_M = 0.05


def has_drop(items: Iterable[MissionItem]) -> bool:
    """Return whether a mission has an item outside ``FLIES_ONLY``, which could switch an output."""
    return any(item.command not in FLIES_ONLY for item in items)


def mission_items(
    path: Sequence[PathPoint],
    speed_m_s: float,
    vehicle: VehicleSection,
    burn: BurnSection,
    from_ground: bool,
) -> tuple[MissionItem, ...]:
    """Return a mission along a path, which ends with a climb to the safe height and a hold.

    Each leg is flown straight. PX4 passes corners within ``ACCEPTANCE_M``, ArduCopter within its
    own radius. ``from_ground`` adds a takeoff to the safe height at home, where the path begins.
    ArduCopter climbs and descends at the rates in ``burn``. PX4 uses its parameters MPC_Z_V_AUTO_UP
    and MPC_Z_V_AUTO_DN (3 and 1.5 m/s), which a mission cannot change.
    """
    first, last = path[0], path[-1]
    items = []
    if from_ground:
        home = (vehicle.home_lat_deg, vehicle.home_lon_deg)
        items.append(takeoff(*home, _safe_amsl_m(first, burn), pitch_deg=0.0))
    items.append(change_speed(mavlink.SPEED_TYPE_GROUNDSPEED, speed_m_s))
    if vehicle.stack == "ardupilot":
        items.append(change_speed(mavlink.SPEED_TYPE_CLIMB_SPEED, burn.climb_m_s))
        items.append(change_speed(mavlink.SPEED_TYPE_DESCENT_SPEED, burn.sink_m_s))
    acceptance_m = ACCEPTANCE_M if vehicle.stack == "px4" else 0.0
    items += [
        waypoint(point.lat_deg, point.lon_deg, point.altitude_amsl_m, acceptance_m)
        for point in path
    ]
    items.append(loiter_unlimited(last.lat_deg, last.lon_deg, _safe_amsl_m(last, burn), 0.0))
    return tuple(items)


def return_height_m(scenario: Scenario, landscape: Landscape) -> float | None:
    """Return the height above home at which a return is safe; None without a burn.

    The return is at the safe height above the highest ground in the rectangle around home and the
    unit. Raises FireModelError if the landscape has no elevation.
    """
    burn = scenario.burn_flown
    if burn is None:
        return None
    vehicle = scenario.vehicles[0]
    home = (vehicle.home_lat_deg, vehicle.home_lon_deg)
    home_m = landscape.xy_of_lat_lon(*home)
    west, south, east, north = burn_unit_of(burn, landscape, home).area.bounds
    across = _steps(min(west, home_m[0]), max(east, home_m[0]), landscape)
    down = _steps(min(south, home_m[1]), max(north, home_m[1]), landscape)
    x, y = np.meshgrid(across, down)
    ground_m = np.max(landscape.elevation_at(x, y)) - landscape.elevation_at(*home_m)
    return float(round(float(ground_m) + burn.safe_height_m, 1))


def _steps(begin_m: float, end_m: float, landscape: Landscape) -> Floats:
    count = math.ceil((end_m - begin_m) / landscape.cell_size_m) + 2
    return np.linspace(begin_m, end_m, count)


def _safe_amsl_m(point: PathPoint, burn: BurnSection) -> float:
    """Return the altitude of the safe height at a point; at least the point's own altitude."""
    lift_m = max(burn.safe_height_m - point.height_m, 0.0)
    return round(point.altitude_amsl_m + lift_m, 2)


def plan_points(
    path: Floats, landscape: Landscape, above_map_m: float = 0.0
) -> tuple[PathPoint, ...]:
    """Convert a path (n, 4) of x, y, height_m and after_s to points with altitudes.

    Between two points the altitude changes linearly. The height above the ground stays between the
    leg's height and 1 + ``BAND`` times this height. For this purpose a leg over uneven ground is
    divided into the fewest possible parts, at most ``SAMPLES_A_CELL`` per cell. ``above_map_m`` is
    the autopilot's altitude minus the landscape's altitude, as measured on the ground. Raises
    FireModelError if the landscape has no elevation.
    """
    ground_m = _ground(path[:1], landscape)[0]
    altitude_m = _middle(ground_m, path[0, 2])
    points = [(*path[0], altitude_m)]
    for start, end in pairwise(path):
        length_m = math.dist(start[:2], end[:2])
        if length_m < SAME_PLACE_M:
            if end[2] != start[2]:
                altitude_m = _middle(_ground(end[None], landscape)[0], end[2])
                points.append((*end, altitude_m))
            continue
        count = max(math.ceil(length_m * SAMPLES_A_CELL / landscape.cell_size_m), 4) + 1
        along = start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)
        lowest_m = _ground(along, landscape) + along[:, 2]
        corners = _in_channel(lowest_m, lowest_m + BAND * along[:, 2], altitude_m)
        points += [(*along[place], altitude) for place, altitude in corners]
        altitude_m = corners[-1][1]
    table = np.array(points)
    lat, lon = landscape.lat_lon_of(table[:, 0], table[:, 1])
    return tuple(
        PathPoint(
            round(float(lat[row]), 7),
            round(float(lon[row]), 7),
            round(float(table[row, 4]) + above_map_m, 2),
            round(float(table[row, 2]), 2),
            round(float(table[row, 3]), 3),
        )
        for row in range(len(table))
    )


def _ground(points: Floats, landscape: Landscape) -> Floats:
    return np.asarray(landscape.elevation_at(points[:, 0], points[:, 1]), dtype=np.float64)


def _middle(ground_m: float, height_m: float) -> float:
    return float(ground_m + (1.0 + 0.5 * BAND) * height_m)


def _in_channel(lowest_m: Floats, highest_m: Floats, begin_m: float) -> list[tuple[int, float]]:
    """Return the corners (sample, altitude) of a line that stays between two altitude profiles.

    The line begins at ``begin_m``. Each part has a constant slope, and is as long as possible. If
    no slope leads to the next sample, the next corner is midway between the two profiles there.
    """
    corners: list[tuple[int, float]] = []
    at, altitude_m = 0, begin_m
    last = len(lowest_m) - 1
    while at < last:
        low, high = -math.inf, math.inf
        reached = at
        for place in range(at + 1, last + 1):
            steps = place - at
            new_low = max(low, (float(lowest_m[place]) - altitude_m) / steps)
            new_high = min(high, (float(highest_m[place]) - altitude_m) / steps)
            if new_low > new_high:
                break
            low, high, reached = new_low, new_high, place
        steps = max(reached - at, 1)
        reached = at + steps
        middle_m = float(lowest_m[reached] + highest_m[reached]) / 2.0
        slope = (middle_m - altitude_m) / steps
        altitude_m += steps * (slope if low == -math.inf else min(max(slope, low), high))
        at = reached
        corners.append((at, altitude_m))
    return corners
