"""Plans the landing that PX4 requires at the end of every mission of a fixed-wing vehicle.

With PX4's default for planes (MIS_TKO_LAND_REQ = 2) a mission without a landing is rejected. The
landing follows the unlimited loiter, so the landing is flown only if an operator selects its items.
"""

import math

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.errors import ScenarioError
from mission_service.fire.scenario_fire import weather_of

Floats = NDArray[np.float64]

GLIDE_DEG = 4.5  # PX4 rejects glides steeper than FW_LND_ANG, by default 5 degrees
APPROACH_HEIGHTS_M = (50.0, 75.0, 100.0, 125.0, 150.0)
CLEARANCE_M = 30.0
UNCHECKED_M = 300.0  # last part of the glide, which is always near the ground
COURSES_DEG = [turn * side for turn in range(0, 181, 15) for side in (1, -1)]


def needs_landing(section: VehicleSection) -> bool:
    """Return whether missions of this vehicle must end with a landing."""
    return section.landing and (section.stack, section.kind) == ("px4", "plane")


class Landing:
    """The landing at the end of a vehicle's missions, if required, into the scenario's wind."""

    def __init__(self, scenario: Scenario, section: VehicleSection, landscape: Landscape) -> None:
        """Plan the landing at the scenario's start. Raises ScenarioError if none is possible."""
        self._section = section
        self._landscape = landscape
        self._weather = weather_of(scenario) if needs_landing(section) else None
        self._items: tuple[MissionItem, ...] = ()
        self._wind_from_deg = math.nan  # wind direction for which the items are planned
        self.items_at(scenario.start_s)

    def items_at(self, at_s: float) -> tuple[MissionItem, ...]:
        """Return the items of a landing into the wind at a mission time; () if none is needed."""
        if self._weather is None:
            return ()
        wind_from_deg = self._weather.weather_at(at_s).wind_from_deg
        if wind_from_deg != self._wind_from_deg:
            self._items = landing_of(self._section, self._landscape, wind_from_deg)
            self._wind_from_deg = wind_from_deg
        return self._items


def landing_of(
    section: VehicleSection, landscape: Landscape, wind_from_deg: float
) -> tuple[MissionItem, ...]:
    """Return DO_LAND_START, a loiter down to the approach height, and a landing at home.

    The course is ``landing_course_deg`` if this is set. Otherwise the course is as close to the
    wind direction as a terrain clearance of ``CLEARANCE_M`` under approach and loiter permits.
    Altitudes are above home, as required for touchdown. Raises ScenarioError if no approach is
    clear.
    """
    home_m = np.array(landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg))
    given = section.landing_course_deg
    courses = [wind_from_deg + turn for turn in COURSES_DEG] if given is None else [given]
    for course_deg in courses:
        for height_m in APPROACH_HEIGHTS_M:
            centre_m = _centre(home_m, course_deg, height_m, section.loiter_radius_m)
            if _is_clear(home_m, course_deg, height_m, centre_m, section, landscape):
                return _items(section, landscape, centre_m, height_m)
    where = "in any direction" if given is None else f"on landing_course_deg = {given:g}"
    raise ScenarioError(
        f"{section.name}: no landing approach to home {where} clears the terrain by "
        f"{CLEARANCE_M:g} m; move its home, or set landing = false here and MIS_TKO_LAND_REQ = 0 "
        "on the vehicle"
    )


def _forward(course_deg: float) -> Floats:
    course = math.radians(course_deg)
    return np.array([math.sin(course), math.cos(course)])


def _glide_m(height_m: float) -> float:
    return height_m / math.tan(math.radians(GLIDE_DEG))


def _centre(home_m: Floats, course_deg: float, height_m: float, radius_m: float) -> Floats:
    """Return the centre of a clockwise loiter that the vehicle leaves at the top of the glide."""
    ahead = _forward(course_deg)
    right = np.array([ahead[1], -ahead[0]])
    return np.asarray(home_m - _glide_m(height_m) * ahead + radius_m * right)


def _is_clear(
    home_m: Floats,
    course_deg: float,
    height_m: float,
    centre_m: Floats,
    section: VehicleSection,
    landscape: Landscape,
) -> bool:
    """Return whether the loiter and the glide are clear of the terrain."""
    if landscape.elevation_m is None:
        return True
    home_altitude_m = float(landscape.elevation_at(*home_m))
    spacing_m = landscape.cell_size_m / 2.0
    back_m = np.arange(UNCHECKED_M, _glide_m(height_m) + spacing_m, spacing_m)
    glide = home_m - back_m[:, None] * _forward(course_deg)
    heights = back_m * math.tan(math.radians(GLIDE_DEG))
    turns = np.linspace(0.0, math.tau, 72, endpoint=False)
    rings = [
        centre_m + share * section.loiter_radius_m * np.column_stack([np.cos(turns), np.sin(turns)])
        for share in (1.0, 1.3)
    ]
    points = np.vstack([glide, *rings])
    if not all(landscape.contains(float(x), float(y)) for x, y in points):
        return False
    needed = np.concatenate([heights, np.full(2 * len(turns), height_m)]) - CLEARANCE_M
    # The last part of the glide is lower than the clearance.
    ground = landscape.elevation_at(points[:, 0], points[:, 1]) - home_altitude_m
    return bool(np.all(ground <= np.maximum(needed, 0.0)))


def _items(
    section: VehicleSection, landscape: Landscape, centre_m: Floats, height_m: float
) -> tuple[MissionItem, ...]:
    lat_deg, lon_deg = landscape.lat_lon_of(*centre_m)
    relative = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    return (
        MissionItem(mavlink.MAV_CMD_DO_LAND_START, mavlink.MAV_FRAME_MISSION, 0, 0, 0.0),
        MissionItem(
            mavlink.MAV_CMD_NAV_LOITER_TO_ALT,
            relative,
            round(float(lat_deg) * 1e7),
            round(float(lon_deg) * 1e7),
            height_m,
            param1=1.0,  # exit on the course to the landing
            param2=section.loiter_radius_m,
            param4=1.0,  # along the tangent
        ),
        MissionItem(
            mavlink.MAV_CMD_NAV_LAND,
            relative,
            round(section.home_lat_deg * 1e7),
            round(section.home_lon_deg * 1e7),
            0.0,
        ),
    )
