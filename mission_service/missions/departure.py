"""Plans the takeoff of vehicles up to the altitude of their missions.

A plane climbs straight ahead. A VTOL climbs vertically, transitions on a straight line away from
home, and continues its climb in a loiter at the end of this line. The line and the loiter clear the
terrain.
"""

import math

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem, takeoff, vtol_takeoff
from firemodel.landscape.landscape import Landscape
from mission_service.config.sections import VehicleSection
from mission_service.errors import ScenarioError
from mission_service.missions.landing import (
    CLEARANCE_M,
    COURSES_DEG,
    VTOL_HEIGHTS_M,
    clears,
    forward_of,
    loiter_beside,
    place_e7,
    vtol_leg_m,
    with_rings,
)

Floats = NDArray[np.float64]


def takeoff_items(
    section: VehicleSection,
    landscape: Landscape,
    altitude_amsl_m: float,
    toward_m: tuple[float, float],
) -> tuple[MissionItem, ...]:
    """Return the items of a takeoff.

    Args:
        section: The vehicle.
        landscape: The terrain.
        altitude_amsl_m: The altitude at the end of the climb.
        toward_m: The x, y that the mission leads to; a VTOL departs in this direction if terrain
            permits.

    Raises:
        ScenarioError: A VTOL has no departure that clears the terrain.
    """
    if section.kind != "vtol":
        return (takeoff(section.home_lat_deg, section.home_lon_deg, altitude_amsl_m),)
    home_m = np.array(landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg))
    bearing_deg = math.degrees(math.atan2(toward_m[0] - home_m[0], toward_m[1] - home_m[1]))
    course_deg, height_m = _departure(section, landscape, home_m, bearing_deg)
    leg_m = vtol_leg_m(section)
    leaves_e7 = place_e7(landscape, home_m + leg_m * forward_of(course_deg))
    centre_m = loiter_beside(home_m, course_deg, leg_m, section.loiter_radius_m)
    ground_m = float(landscape.elevation_at(*home_m))
    climb = MissionItem(
        mavlink.MAV_CMD_NAV_LOITER_TO_ALT,
        mavlink.MAV_FRAME_GLOBAL,
        *place_e7(landscape, centre_m),
        max(altitude_amsl_m, ground_m + height_m),
        param2=section.loiter_radius_m,
    )
    return (vtol_takeoff(leaves_e7[0] / 1e7, leaves_e7[1] / 1e7, height_m), climb)


def _departure(
    section: VehicleSection, landscape: Landscape, home_m: Floats, bearing_deg: float
) -> tuple[float, float]:
    """Return the course and the height above home of a VTOL's departure."""
    leg_m = vtol_leg_m(section)
    along_m = np.arange(0.0, leg_m + landscape.cell_size_m, landscape.cell_size_m / 2.0)
    for turn_deg in COURSES_DEG:
        course_deg = bearing_deg + turn_deg
        line = home_m + along_m[:, None] * forward_of(course_deg)
        centre_m = loiter_beside(home_m, course_deg, leg_m, section.loiter_radius_m)
        for height_m in VTOL_HEIGHTS_M:
            heights = np.full(len(line), height_m)
            if clears(*with_rings(line, heights, centre_m, height_m, section), home_m, landscape):
                return course_deg, height_m
    raise ScenarioError(
        f"{section.name}: no departure from home in any direction clears the terrain by "
        f"{CLEARANCE_M:g} m: move its home"
    )
