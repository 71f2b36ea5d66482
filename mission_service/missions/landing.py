"""Plans a fixed-wing vehicle's approach to home, and the landing at the end of its missions.

With PX4's default for planes (MIS_TKO_LAND_REQ = 2) a mission without a landing is rejected. The
landing follows the unlimited loiter, so it is flown only if an operator selects its items. A VTOL
flies home at approach height, stops there and descends vertically. ``landing_mission.py`` plans
missions that only land.
"""

import math
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from shapely.geometry.base import BaseGeometry

from autopilot_bridge.items import MissionItem
from firemodel.landscape.landscape import Landscape
from mission_service.airspace.occupied_space import LOITER_RADIUS_FACTOR
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.errors import ScenarioError
from mission_service.fire.scenario_fire import weather_of

Floats = NDArray[np.float64]

GLIDE_DEG = 4.5  # PX4 rejects glides steeper than FW_LND_ANG, by default 5 degrees
APPROACH_HEIGHTS_M = (50.0, 75.0, 100.0, 125.0, 150.0)
VTOL_HEIGHTS_M = (40.0, *APPROACH_HEIGHTS_M)  # heights of a VTOL's transitions
VTOL_DECELERATION_M_S2, VTOL_SETTLES_M = 1.0, 100.0  # PX4 and ArduPlane brake with 2 m/s2
CLEARANCE_M = 30.0
UNCHECKED_M = 300.0  # final part of the glide, which is always near the ground
# A PX4 plane glides above the line to NAV_LAND and comes to rest beyond it. By its default
# parameters its altitude follows a sinking setpoint 3.5 s late (FW_T_ALT_TC times 1 -
# FW_T_HRATE_FF). A plane that has to slow down for the approach remains too fast with the throttle
# at idle, and TECS then keeps it higher. The three factors, of the speed over the ground, of the
# reduction of the airspeed, and the constant for the rest (flare and rollout), were fitted to 16
# simulated landings of PX4 1.17 in winds of 0, 5 and 10 m/s, at an airspeed of 15 m/s. On the
# approach, the plane flies at its minimum airspeed, or faster, so that its speed over the ground is
# at least FW_GND_SPD_MIN.
PX4_BEYOND_S, PX4_BEYOND_M = 4.5, -9.0
PX4_SLOWING_S, PX4_MAX_SLOWING_M_S = 5.0, 5.0
PX4_MIN_GROUND_SPEED_M_S = 5.0
# In seven simulated landings in a wind of 10 m/s, ArduPlane 4.6.2 came to rest between 12 m short
# of its point and 5 m beyond it; the mean is this time multiplied by the headwind or tailwind.
ARDUPLANE_SHORT_S = 0.7
# Distances of two waypoints on the glide from its beginning. PX4 1.17 takes the setpoint before
# LOITER_TO_ALT as the beginning of the glide if its return leads to the mission's landing and the
# landing item follows the loiter: its plane then dives on another line, here 535 m short of home.
PX4_GLIDE_M = (100.0, 200.0)
LAND_START = MissionItem(mavlink.MAV_CMD_DO_LAND_START, mavlink.MAV_FRAME_MISSION, 0, 0, 0.0)
NOTHING: BaseGeometry = shapely.Polygon()
COURSES_DEG = [turn * side for turn in range(0, 181, 15) for side in (1, -1)]


def needs_landing(section: VehicleSection) -> bool:
    """Return whether missions of this vehicle must end with a landing."""
    return section.landing and section.stack == "px4" and section.winged


def hovers_on(section: VehicleSection) -> bool:
    """Return whether a hovering vehicle would fly its next mission in hover, like PX4's VTOL."""
    return section.kind == "vtol" and section.stack == "px4"


class Approach(NamedTuple):
    """A straight approach from a clockwise loiter to a landing item, both clear of the terrain.

    Attributes:
        course_deg: Course of the straight line.
        height_m: Height of the loiter above home.
        centre_m: Centre of the loiter (x, y).
        length_m: Length of the straight line.
        landing_m: Position (x, y) of the landing item, from which the vehicle comes to rest at
            home.
    """

    course_deg: float
    height_m: float
    centre_m: Floats
    length_m: float
    landing_m: Floats


class Landing:
    """A vehicle's approach into the scenario's wind, and the landing at the end of its missions.

    Only missions of some vehicles end with a landing (``needs_landing``).
    """

    def __init__(self, scenario: Scenario, section: VehicleSection, landscape: Landscape) -> None:
        """Plan the landing at the scenario's start. Raises ScenarioError if none is possible."""
        self._section = section
        self._landscape = landscape
        self._needed = needs_landing(section)
        self._weather = weather_of(scenario) if section.winged else None
        self._items: tuple[MissionItem, ...] = ()
        self._approach: Approach | None = None
        self._wind: tuple[float, float] | None = None  # for which the items were planned
        self.closed = NOTHING
        self.items_at(scenario.start_s)

    def keep_clear_of(self, closed: BaseGeometry) -> None:
        """Replan the landing if the area that the approach should not enter has changed."""
        if not closed.equals(self.closed):
            self.closed, self._wind = closed, None

    def items_at(self, at_s: float) -> tuple[MissionItem, ...]:
        """Return the items of a landing into the wind at a given time; () if none is needed.

        If no approach into that wind clears the terrain, the landing is the one planned before.
        """
        if self._needed:
            self._plan(at_s)
        return self._items

    def approach_at(self, at_s: float) -> Approach | None:
        """Return the approach into the wind at a given time, or the one planned before.

        None for a multirotor. None also if no approach has been clear of the terrain, and missions
        need no landing.
        """
        self._plan(at_s)
        return self._approach

    def _plan(self, at_s: float) -> None:
        """Plan for a new wind. Raises ScenarioError if the first needed landing is impossible."""
        if self._weather is None or (wind := self.wind_at(at_s)) == self._wind:
            return
        self._wind = wind
        try:
            approach, items = landing_in_wind(self._section, self._landscape, wind, self.closed)
        except ScenarioError:
            if self._needed and not self._items:
                raise
            return
        self._approach = approach
        self._items = (LAND_START, *items) if self._needed else ()

    def start_at(self, at_s: float) -> tuple[float, float] | None:
        """Return the centre (x, y) of the loiter that begins the landing; None if there is none."""
        approach = self.approach_at(at_s) if self._needed else None
        return (
            None if approach is None else (float(approach.centre_m[0]), float(approach.centre_m[1]))
        )

    def wind_at(self, at_s: float) -> tuple[float, float]:
        """Return the scenario's wind at a given time: speed (m/s) and direction (from, degrees)."""
        assert self._weather is not None, "multirotors land without a mission"
        weather = self._weather.weather_at(at_s)
        return weather.wind_speed_m_s, weather.wind_from_deg


def landing_in_wind(
    section: VehicleSection,
    landscape: Landscape,
    wind: tuple[float, float],
    closed: BaseGeometry,
) -> tuple[Approach, tuple[MissionItem, ...]]:
    """Return the approach, and its items, from which a plane comes to rest at home.

    The items are a loiter down to approach height and a landing at home. Their altitudes are above
    home, as required for touchdown. ``wind`` is the speed in m/s, and the direction in degrees from
    which the wind blows. Raises ScenarioError if no approach is clear.
    """
    approach = approach_of(section, landscape, wind, closed)
    return approach, approach_items(
        section, landscape, approach, place_e7(landscape, approach.landing_m)
    )


def _beyond_m(section: VehicleSection, headwind_m_s: float, crosswind_m_s: float) -> float:
    """Return how far beyond the NAV_LAND point a plane comes to rest; negative if short of it."""
    if section.kind == "vtol":
        return 0.0
    if section.stack != "px4":
        return -ARDUPLANE_SHORT_S * abs(headwind_m_s)
    speeds = px4_approach_speeds(section, headwind_m_s, crosswind_m_s)
    slows_by_m_s = max(section.airspeed_m_s - speeds.airspeed_m_s, 0.0)
    slowing_m = PX4_SLOWING_S * min(slows_by_m_s, PX4_MAX_SLOWING_M_S)
    return max(PX4_BEYOND_S * speeds.ground_speed_m_s + slowing_m + PX4_BEYOND_M, 0.0)


class ApproachSpeeds(NamedTuple):
    """The airspeed and the ground speed of an approach."""

    airspeed_m_s: float
    ground_speed_m_s: float


def px4_approach_speeds(
    section: VehicleSection, headwind_m_s: float, crosswind_m_s: float = 0.0
) -> ApproachSpeeds:
    """Return the speeds at which a PX4 plane flies its approach."""
    ahead_m_s = max(PX4_MIN_GROUND_SPEED_M_S + headwind_m_s, 0.0)
    needed_m_s = max(section.min_airspeed_m_s, math.hypot(ahead_m_s, crosswind_m_s))
    airspeed_m_s = min(needed_m_s, section.max_airspeed_m_s)
    along_m_s = math.sqrt(max(airspeed_m_s**2 - crosswind_m_s**2, 0.0))
    return ApproachSpeeds(airspeed_m_s, max(along_m_s - headwind_m_s, 0.0))


def approach_of(
    section: VehicleSection,
    landscape: Landscape,
    wind: tuple[float, float],
    closed: BaseGeometry = NOTHING,
) -> Approach:
    """Return the approach from which a vehicle comes to rest at home.

    The course is ``landing_course_deg`` if this is set. Otherwise, the course is as close to the
    wind direction as a terrain clearance of ``CLEARANCE_M`` along the approach and the loiter
    permits, and the approach avoids the area ``closed`` if possible. ``wind`` is the speed in m/s,
    and the direction in degrees from which the wind blows. Raises ScenarioError if no approach is
    clear of the terrain.
    """
    wind_m_s, wind_from_deg = wind
    home_m = np.array(landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg))
    if closed.intersects(shapely.Point(home_m)):
        closed = NOTHING  # no approach can avoid it
    given = section.landing_course_deg
    courses = [wind_from_deg + turn for turn in COURSES_DEG] if given is None else [given]
    vtol = section.kind == "vtol"
    entering: Approach | None = None
    for course_deg in courses:
        off_wind_rad = math.radians(course_deg - wind_from_deg)
        ahead_m_s, across_m_s = wind_m_s * math.cos(off_wind_rad), wind_m_s * math.sin(off_wind_rad)
        landing_m = home_m - _beyond_m(section, ahead_m_s, across_m_s) * forward_of(course_deg)
        for height_m in VTOL_HEIGHTS_M if vtol else APPROACH_HEIGHTS_M:
            length_m = vtol_leg_m(section) if vtol else glide_m(height_m)
            centre_m = loiter_beside(landing_m, course_deg, -length_m, section.loiter_radius_m)
            approach = Approach(course_deg % 360.0, height_m, centre_m, length_m, landing_m)
            if not _is_clear(home_m, approach, section, landscape):
                continue
            if not _space_of(home_m, approach, section).intersects(closed):
                return approach
            entering = entering or approach
    if entering is not None:
        return entering
    where = "in any direction" if given is None else f"on landing_course_deg = {given:g}"
    raise ScenarioError(
        f"{section.name}: no landing approach to home {where} clears the terrain by "
        f"{CLEARANCE_M:g} m; move its home, or set landing = false here and MIS_TKO_LAND_REQ = 0 "
        "on the vehicle"
    )


def _space_of(home_m: Floats, approach: Approach, section: VehicleSection) -> BaseGeometry:
    """Return the area below a loiter, a glide and the way from its end to home."""
    reach_m = LOITER_RADIUS_FACTOR * section.loiter_radius_m
    ends = shapely.MultiPoint([approach.landing_m, home_m])
    return shapely.union(shapely.Point(approach.centre_m).buffer(reach_m), ends).convex_hull


def forward_of(course_deg: float) -> Floats:
    """Return the unit vector (x, y) of a course."""
    course = math.radians(course_deg)
    return np.array([math.sin(course), math.cos(course)])


def glide_m(height_m: float) -> float:
    """Return the horizontal length in metres of a glide from a height above ground."""
    return height_m / math.tan(math.radians(GLIDE_DEG))


def vtol_leg_m(section: VehicleSection) -> float:
    """Return the length of a VTOL's straight flight between home and a loiter, in metres.

    The transition between hover and forward flight takes place on this line.
    """
    return VTOL_SETTLES_M + section.airspeed_m_s**2 / (2.0 * VTOL_DECELERATION_M_S2)


def loiter_beside(home_m: Floats, course_deg: float, ahead_m: float, radius_m: float) -> Floats:
    """Return the centre of a clockwise loiter that touches a line through home.

    ``ahead_m`` is the distance of the tangent point from home along the course.
    """
    ahead = forward_of(course_deg)
    right = np.array([ahead[1], -ahead[0]])
    return np.asarray(home_m + ahead_m * ahead + radius_m * right)


def _is_clear(
    home_m: Floats, approach: Approach, section: VehicleSection, landscape: Landscape
) -> bool:
    """Return whether the loiter and the line to the landing item clear the terrain."""
    spacing_m = landscape.cell_size_m / 2.0
    first_m = 0.0 if section.kind == "vtol" else UNCHECKED_M
    back_m = np.arange(first_m, approach.length_m + spacing_m, spacing_m)
    line = approach.landing_m - back_m[:, None] * forward_of(approach.course_deg)
    heights = back_m * approach.height_m / approach.length_m
    if section.kind == "vtol":
        heights = np.full(len(back_m), approach.height_m)
    points, heights_m = with_rings(line, heights, approach.centre_m, approach.height_m, section)
    return clears(points, heights_m, home_m, landscape)


def with_rings(
    line_m: Floats,
    line_heights_m: Floats,
    centre_m: Floats,
    height_m: float,
    section: VehicleSection,
) -> tuple[Floats, Floats]:
    """Return the points (n, 2) of a line and a loiter around a place, and their heights (n,)."""
    turns = np.linspace(0.0, math.tau, 72, endpoint=False)
    rings = [
        centre_m + share * section.loiter_radius_m * np.column_stack([np.cos(turns), np.sin(turns)])
        for share in (1.0, LOITER_RADIUS_FACTOR)
    ]
    heights_m = np.concatenate([line_heights_m, np.full(2 * len(turns), height_m)])
    return np.vstack([line_m, *rings]), heights_m


def clears(points_m: Floats, heights_m: Floats, home_m: Floats, landscape: Landscape) -> bool:
    """Return whether points (n, 2) at heights above home (n,) clear the terrain.

    Under points lower than the clearance, the terrain may be as high as that at home.
    """
    if landscape.elevation_m is None:
        return True
    corners = (points_m.min(axis=0), points_m.max(axis=0))
    if not all(landscape.contains(*corner.tolist()) for corner in corners):
        return False
    ground_m = landscape.elevation_at(points_m[:, 0], points_m[:, 1])
    above_home_m = ground_m - float(landscape.elevation_at(*home_m))
    return bool(np.all(above_home_m <= np.maximum(heights_m - CLEARANCE_M, 0.0)))


def approach_items(
    section: VehicleSection, landscape: Landscape, approach: Approach, touchdown: tuple[int, int]
) -> tuple[MissionItem, ...]:
    """Return the loiter down to approach height, and the landing at a place in 1e-7 degrees.

    For a PX4 plane there are two waypoints on the glide between them.
    """
    relative = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    return (
        MissionItem(
            mavlink.MAV_CMD_NAV_LOITER_TO_ALT,
            relative,
            *place_e7(landscape, approach.centre_m),
            approach.height_m,
            param1=1.0,  # exit on course for the landing
            param2=section.loiter_radius_m,
            param4=1.0,  # along the tangent
        ),
        *(_glide_items(section, landscape, approach) if _needs_glide(section) else ()),
        MissionItem(
            mavlink.MAV_CMD_NAV_VTOL_LAND if section.kind == "vtol" else mavlink.MAV_CMD_NAV_LAND,
            relative,
            *touchdown,
            0.0,
        ),
    )


def _needs_glide(section: VehicleSection) -> bool:
    """Return whether waypoints on the glide precede the landing item."""
    return section.stack == "px4" and section.kind == "plane"


def _glide_items(
    section: VehicleSection, landscape: Landscape, approach: Approach
) -> tuple[MissionItem, ...]:
    ahead = forward_of(approach.course_deg)
    left = np.array([-ahead[1], ahead[0]])
    begins_m = approach.centre_m + section.loiter_radius_m * left
    return tuple(
        MissionItem(
            mavlink.MAV_CMD_NAV_WAYPOINT,
            mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
            *place_e7(landscape, begins_m + along_m * ahead),
            approach.height_m * (1.0 - along_m / approach.length_m),
        )
        for along_m in PX4_GLIDE_M
    )


def place_e7(landscape: Landscape, place_m: Floats) -> tuple[int, int]:
    """Return the latitude and the longitude of a place (x, y) in 1e-7 degrees."""
    lat_deg, lon_deg = landscape.lat_lon_of(float(place_m[0]), float(place_m[1]))
    return round(float(lat_deg) * 1e7), round(float(lon_deg) * 1e7)
