"""Plans the landing-only missions of fixed-wing vehicles: to the approach, then down into the wind.

The approach is that of ``landing.py``. The mission also determines where the vehicle holds after a
go-around: straight ahead if that is clear of terrain, otherwise above the approach loiter.
ArduPlane flies there by the items after the landing, PX4 by a command. After a go-around, PX4's
VTOL hovers above home; ArduPlane's climbs there and circles in the approach loiter.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from shapely.geometry.base import BaseGeometry

from autopilot_bridge.items import (
    MissionItem,
    camera_trigger,
    change_speed,
    fly_as_plane,
    speed_type,
    waypoint,
)
from firemodel.landscape.landscape import Landscape
from mission_service.config.sections import VehicleSection
from mission_service.missions.from_path import LeastAltitude, leg_altitudes_m, no_least
from mission_service.missions.landing import (
    LAND_START,
    NOTHING,
    UNCHECKED_M,
    Approach,
    clears,
    forward_of,
    hovers_on,
    landing_in_wind,
    loiter_beside,
    place_e7,
    with_rings,
)

Floats = NDArray[np.float64]

VTOL_FINAL_M = 30.0  # a VTOL this close to home and below the approach is on its final leg
CLIMB_SLOPE = 0.08  # assumed climb gradient after a go-around, less than planes achieve
CLIMBS_WITH_CONTINUE = 1.0  # param 1 of CONTINUE_AND_CHANGE_ALT: continue once at the altitude


class LandingMission(NamedTuple):
    """A mission that only lands.

    ``final_seq`` is the index of its final leg, the landing. A go-around leads to ``height_m``
    above home at the position ``around`` (latitude, longitude). The final leg begins within
    ``final_m`` of home.
    """

    items: tuple[MissionItem, ...]
    final_seq: int
    course_deg: float
    height_m: float
    final_m: float
    around: tuple[float, float]


def landing_mission(
    section: VehicleSection,
    landscape: Landscape,
    wind: tuple[float, float],
    start_m: tuple[float, float],
    min_at: LeastAltitude = no_least,
    closed: BaseGeometry = NOTHING,
) -> LandingMission:
    """Return the mission that lands a plane at home.

    Args:
        section: The vehicle.
        landscape: The terrain.
        wind: Speed in m/s, and the direction in degrees from which the wind blows.
        start_m: The vehicle's position; x, y in metres.
        min_at: The minimum altitude on the way to the approach, in addition to the terrain
            clearance.
        closed: The area that the approach avoids if possible; x, y in metres.

    Raises:
        ScenarioError: No approach is clear of the terrain.
    """
    vtol = section.kind == "vtol"
    approach, landing = landing_in_wind(section, landscape, wind, closed)
    home_m = np.array(landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg))
    around_m = _around(section, landscape, approach, home_m)
    items = [
        *([fly_as_plane()] if hovers_on(section) else []),
        change_speed(speed_type(section.kind), section.airspeed_m_s),
        *([] if section.camera_trigger_m is None else [camera_trigger(0.0)]),
        _to_approach(section, landscape, approach, start_m, min_at),
    ]
    if section.stack == "px4":
        items += [LAND_START, *landing]
    elif vtol:
        items += [*landing, *_around_items(section, landscape, around_m, approach.height_m)[1:]]
    else:  # DO_LAND_START would keep ArduPlane from arming later, if RTL_AUTOLAND is 0
        items += [*landing, *_around_items(section, landscape, around_m, approach.height_m)]
    lat_deg, lon_deg = landscape.lat_lon_of(float(around_m[0]), float(around_m[1]))
    return LandingMission(
        tuple(items),
        items.index(landing[-1]),
        approach.course_deg,
        approach.height_m,
        VTOL_FINAL_M if vtol else approach.length_m + 3.0 * section.loiter_radius_m,
        (float(lat_deg), float(lon_deg)),
    )


def _to_approach(
    section: VehicleSection,
    landscape: Landscape,
    approach: Approach,
    start_m: tuple[float, float],
    min_at: LeastAltitude,
) -> MissionItem:
    """Return the waypoint over the approach loiter, at an altitude that clears the way there."""
    points = np.array([start_m, approach.centre_m])
    around_m = 1.5 * section.loiter_radius_m
    altitude_m = leg_altitudes_m(points, landscape, section.altitude_agl_m, around_m, min_at)[-1]
    lat_deg, lon_deg = landscape.lat_lon_of(*approach.centre_m)
    return waypoint(float(lat_deg), float(lon_deg), altitude_m)


def _around(
    section: VehicleSection, landscape: Landscape, approach: Approach, home_m: Floats
) -> Floats:
    """Return the centre of the loiter after a go-around; PX4's VTOL hovers at this place."""
    if section.kind == "vtol":
        return home_m if section.stack == "px4" else approach.centre_m
    ahead = forward_of(approach.course_deg)
    length_m = approach.height_m / CLIMB_SLOPE
    centre_m = loiter_beside(home_m, approach.course_deg, length_m, section.loiter_radius_m)
    along_m = np.arange(UNCHECKED_M, length_m, landscape.cell_size_m / 2.0)
    climb = home_m + along_m[:, None] * ahead
    points_m, heights_m = with_rings(
        climb, CLIMB_SLOPE * along_m, centre_m, approach.height_m, section
    )
    clear = clears(points_m, heights_m, home_m, landscape)
    return centre_m if clear else approach.centre_m


def _around_items(
    section: VehicleSection, landscape: Landscape, around_m: Floats, height_m: float
) -> list[MissionItem]:
    """Return the items after the landing, by which ArduPlane climbs straight ahead and holds."""
    relative = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    place = place_e7(landscape, around_m)
    radius_m = section.loiter_radius_m
    climb, hold = mavlink.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT, mavlink.MAV_CMD_NAV_LOITER_UNLIM
    return [
        MissionItem(climb, relative, 0, 0, height_m, param1=CLIMBS_WITH_CONTINUE),
        MissionItem(hold, relative, *place, height_m, param3=radius_m),
    ]
