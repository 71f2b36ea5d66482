"""An ignition plan's path as the mission of a multirotor, which never contains a drop."""

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

# Commands that only fly. Any other one may switch an output: servos, relays, grippers, winches and
# sprayers do, cameras and parachutes may be outputs, auxiliary functions and scripts anything.
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
THERE_M = 2.0  # acceptance radius of a corner; ArduCopter has its own (WPNAV_RADIUS)
BAND = 0.2  # of its height: a leg is flown between its height and so much more above the ground
SAMPLES_A_CELL = 4
SAME_PLACE_M = 0.05


def has_drop(items: Iterable[MissionItem]) -> bool:
    """Whether a mission has an item that may switch an output: any that is not ``FLIES_ONLY``."""
    return any(item.command not in FLIES_ONLY for item in items)


def mission_items(
    path: Sequence[PathPoint],
    speed_m_s: float,
    vehicle: VehicleSection,
    burn: BurnSection,
    from_ground: bool,
) -> tuple[MissionItem, ...]:
    """The mission that flies a path, climbs at its end to the safe height and holds there.

    Each leg is flown straight, corners are passed within ``THERE_M``. ``from_ground``: with a
    takeoff at home, where the path begins, up to the safe height. ArduCopter climbs and sinks as
    the burn has it; PX4 by its parameters MPC_Z_V_AUTO_UP and _DN (3 and 1.5 m/s), which no mission
    changes.
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
    there_m = THERE_M if vehicle.stack == "px4" else 0.0
    items += [
        waypoint(point.lat_deg, point.lon_deg, point.altitude_amsl_m, there_m) for point in path
    ]
    items.append(loiter_unlimited(last.lat_deg, last.lon_deg, _safe_amsl_m(last, burn), 0.0))
    return tuple(items)


def return_height_m(scenario: Scenario, landscape: Landscape) -> float | None:
    """Height above home of a safe return: the safe height over the highest ground of any path.

    None without a burn. Raises FireModelError without elevation.
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
    """Altitude of the safe height over a point's ground, or of the point if it is higher."""
    lift_m = max(burn.safe_height_m - point.height_m, 0.0)
    return round(point.altitude_amsl_m + lift_m, 2)


def plan_points(
    path: Floats, landscape: Landscape, above_map_m: float = 0.0
) -> tuple[PathPoint, ...]:
    """Path (n, 4) of x, y, height_m, after_s as places with altitudes.

    Between them altitudes change evenly, and each leg is from its height to a share of ``BAND`` of
    it more above the ground under it: where the slope changes, a leg is cut into as few as needed
    (no finer than ``SAMPLES_A_CELL`` to a cell). ``above_map_m``: altitude of the autopilot minus
    that of the landscape, measured on the ground. Raises FireModelError without elevation.
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
    """Corners (sample, altitude) of a line from ``begin_m`` between lowest and highest altitudes.

    Each leg is as long as one slope allows. Where none does from one sample to the next, that
    sample's middle is a corner.
    """
    corners: list[tuple[int, float]] = []
    at, altitude_m = 0, begin_m
    last = len(lowest_m) - 1
    while at < last:
        low, high = -math.inf, math.inf
        reached = at
        for place in range(at + 1, last + 1):
            steps = place - at
            low_there = max(low, (float(lowest_m[place]) - altitude_m) / steps)
            high_there = min(high, (float(highest_m[place]) - altitude_m) / steps)
            if low_there > high_there:
                break
            low, high, reached = low_there, high_there, place
        steps = max(reached - at, 1)
        reached = at + steps
        middle_m = float(lowest_m[reached] + highest_m[reached]) / 2.0
        slope = (middle_m - altitude_m) / steps
        altitude_m += steps * (slope if low == -math.inf else min(max(slope, low), high))
        at = reached
        corners.append((at, altitude_m))
    return corners
