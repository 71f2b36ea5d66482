"""Plans a climb before a mission for a plane that is too low for the mission's first legs.

The legs clear the terrain at their planned altitudes. A plane that is much lower reaches these only
after some distance, and rising ground may be nearer. In that case, it first climbs in a loiter.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem, has_position
from firemodel.landscape.landscape import Landscape
from mission_service.airspace.occupied_space import LOITER_RADIUS_FACTOR, Position, mission_places
from mission_service.config.sections import VehicleSection
from mission_service.missions.landing import place_e7
from mission_service.missions.orbits import Place, highest_ground_m

Floats = NDArray[np.float64]
CLEARANCE_M = 30.0  # minimum height above ground in a climb
BEARINGS, AWAY_RADII = 12, (2.0, 4.0)  # candidate loiter places around the plane


def with_climb(
    items: tuple[MissionItem, ...],
    section: VehicleSection,
    landscape: Landscape,
    position: Position,
    speed_m_s: float,
) -> tuple[MissionItem, ...]:
    """Return a mission that first climbs in a loiter if a climb along its legs would be too low.

    Too low means less than 30 m above ground and less than the current height. The loiter is at the
    mission's first position, or near the plane over lower ground. The mission is unchanged if it
    can be flown as it is, or if no loiter has more clearance.

    Args:
        items: The mission of a plane in the air, with altitudes above mean sea level.
        section: The vehicle; it climbs by ``climb_m_s``.
        landscape: The terrain.
        position: x, y and altitude above mean sea level, in metres.
        speed_m_s: Maximum ground speed in the climb.
    """
    places = mission_places(items, landscape, 0.0)
    path = [place.position for place in places]
    if not path or items[places[0].seq].command == mavlink.MAV_CMD_NAV_LOITER_TO_ALT:
        return items
    gradient = section.climb_m_s / speed_m_s
    over_ground_m = position[2] - float(landscape.elevation_at(*position[:2]))
    needed_m = min(CLEARANCE_M, over_ground_m)
    on_path_m = _least_height_m(landscape, position, path, gradient)
    if on_path_m >= needed_m:
        return items
    found: tuple[float, Place] | None = None
    for centre in _places(position, path[0], section.loiter_radius_m):
        height_m = _height_around_m(landscape, section, position, centre)
        if height_m > (on_path_m if found is None else found[0]):
            found = (height_m, centre)
        if height_m >= needed_m:
            break
    if found is None:
        return items
    centre = found[1]
    altitude_m = _altitude_m(landscape, section, position, centre, path, gradient)
    climb = MissionItem(
        mavlink.MAV_CMD_NAV_LOITER_TO_ALT,
        mavlink.MAV_FRAME_GLOBAL,
        *place_e7(landscape, np.array(centre)),
        altitude_m,
        param2=section.loiter_radius_m,
    )
    return (*items[: places[0].seq], climb, *items[places[0].seq :])


def without_climb(items: tuple[MissionItem, ...]) -> tuple[MissionItem, ...]:
    """Return a mission without its initial climb loiter."""
    first = next((seq for seq, item in enumerate(items) if has_position(item.command)), 0)
    climbs = bool(items) and items[first].command == mavlink.MAV_CMD_NAV_LOITER_TO_ALT
    return (*items[:first], *items[first + 1 :]) if climbs else items


def _least_height_m(
    landscape: Landscape, position: Position, path: Sequence[Position], gradient: float
) -> float:
    """Return the least height above ground on a path that is joined at a lower altitude.

    The vehicle climbs by ``gradient`` metres per metre up to the altitudes of the path.
    """
    least_m, flown_m = math.inf, 0.0
    for start, end in zip([(*position[:2], path[0][2]), *path], path, strict=False):
        length_m = math.dist(start[:2], end[:2])
        count = max(2, math.ceil(2.0 * length_m / landscape.cell_size_m) + 1)
        line = np.linspace(start, end, count)
        climbed_m = position[2] + gradient * (flown_m + np.linspace(0.0, length_m, count))
        ground_m = landscape.elevation_at(line[:, 0], line[:, 1])
        least_m = min(least_m, float(np.min(np.minimum(line[:, 2], climbed_m) - ground_m)))
        flown_m += length_m
        if position[2] + gradient * flown_m >= max(each[2] for each in path):
            break
    return least_m


def _places(position: Position, first: Position, radius_m: float) -> Iterator[Place]:
    """Yield candidate loiter places, the preferred one first."""
    yield first[:2]
    yield position[:2]
    for away_m in (radii * radius_m for radii in AWAY_RADII):
        for number in range(BEARINGS):
            bearing_rad = math.tau * number / BEARINGS
            yield (
                position[0] + away_m * math.sin(bearing_rad),
                position[1] + away_m * math.cos(bearing_rad),
            )


def _height_around_m(
    landscape: Landscape, section: VehicleSection, position: Position, centre: Place
) -> float:
    """Return the least height above ground on the way to a loiter at the current altitude."""
    reach_m = LOITER_RADIUS_FACTOR * section.loiter_radius_m
    ground_m = max(
        highest_ground_m(landscape, position[:2], centre, section.turn_radius_m),
        highest_ground_m(landscape, centre, centre, reach_m),
    )
    return position[2] - ground_m


def _altitude_m(
    landscape: Landscape,
    section: VehicleSection,
    position: Position,
    centre: Place,
    path: Sequence[Position],
    gradient: float,
) -> float:
    """Return the altitude at which the vehicle leaves the loiter, so that the path is clear."""
    ground_m = max(
        highest_ground_m(landscape, position[:2], centre, section.turn_radius_m),
        highest_ground_m(landscape, centre, path[0][:2], section.turn_radius_m),
    )
    least_m = round(max(ground_m + section.altitude_agl_m, path[0][2]), 1)
    higher_m = sorted(each[2] for each in path if each[2] > least_m)
    for altitude_m in (least_m, *higher_m):
        start = (*centre, altitude_m)
        if _least_height_m(landscape, start, path, gradient) >= CLEARANCE_M:
            return altitude_m
    return max((least_m, *higher_m))
