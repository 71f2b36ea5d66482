"""Predicts when vehicles will have left a volume or landed one after the other. Pure."""

import math
from collections.abc import Sequence

import shapely

from mission_service.core.landings import FIELD_M
from mission_service.missions.landing import glide_m
from mission_service.missions.landing_mission import LandingMission
from mission_service.position_fix import PositionFix
from mission_service.vehicles.endurance import home_s, to_place_s
from mission_service.vehicles.landing_time import copter_descent_s, plane_descent_s
from mission_service.vehicles.vehicle_state import Vehicle
from mission_service.vehicles.way_home import Vector

FACTOR, MARGIN_S = 1.15, 30.0  # the stated time allows for this prediction error
TAKES_EFFECT_S = 5.0  # until a vehicle flies a mission sent now
DISARMS_S = 10.0  # from touchdown to disarm


def out_by_s(at_s: float, expected_at_s: float) -> float:
    """Return the time by which a vehicle should be out, from the predicted time."""
    return at_s + FACTOR * (expected_at_s - at_s) + MARGIN_S


def exit_s(
    vehicle: Vehicle,
    fix: PositionFix,
    line: shapely.LineString,
    area_m: shapely.Geometry,
    wind_m_s: Vector,
) -> float:
    """Return the seconds until a vehicle flying along a line has left an area."""
    beyond = shapely.difference(line, area_m)
    parts = [part for part in shapely.get_parts(beyond) if not part.is_empty]
    leaves_m = parts[-1].coords[0] if parts else line.coords[-1]
    return TAKES_EFFECT_S + to_place_s(vehicle, fix, (leaves_m[0], leaves_m[1]), wind_m_s)


def plane_landing_s(
    vehicle: Vehicle,
    fix: PositionFix,
    mission: LandingMission,
    centre_m: Vector,
    wind_m_s: Vector,
) -> float:
    """Return the seconds until a plane that begins its landing mission is disarmed.

    The plane flies to the approach loiter at ``centre_m``, circles down and glides into the wind. A
    VTOL flies home at approach height and descends vertically.
    """
    section, availability = vehicle.section, vehicle.availability
    to_approach_s = to_place_s(vehicle, fix, centre_m, wind_m_s)
    half_circle_s = math.pi * section.loiter_radius_m / section.airspeed_m_s
    along = (vehicle.home_m[0] - centre_m[0], vehicle.home_m[1] - centre_m[1])
    headwind_m_s = -(wind_m_s[0] * along[0] + wind_m_s[1] * along[1]) / max(math.hypot(*along), 1.0)
    line_m = math.hypot(*along) if section.kind == "vtol" else glide_m(mission.height_m)
    descent_s = plane_descent_s(
        section, availability.height_m, mission.height_m, line_m, headwind_m_s
    )
    return TAKES_EFFECT_S + to_approach_s + half_circle_s + descent_s + DISARMS_S


def copter_landing_s(
    vehicle: Vehicle, fix: PositionFix, wind_m_s: Vector, return_height_m: float
) -> float:
    """Return the seconds until a multirotor that returns home is disarmed."""
    height_m = vehicle.availability.height_m
    return_amsl_m = fix.altitude_m - height_m + return_height_m
    down_s = copter_descent_s(max(height_m, return_height_m))
    return home_s(vehicle, fix, wind_m_s, return_amsl_m) + down_s + DISARMS_S


def queued(flights: Sequence[tuple[Vector, float | None, float]], at_s: float) -> list[float]:
    """Return the predicted ends of landings, one after the other at each field.

    Args:
        flights: For each vehicle, in the order of the landings: the position of its field, the
            predicted end of its landing if it has begun (None: it waits), and the duration of its
            landing in seconds.
        at_s: The current time.
    """
    ends_s: list[float] = []
    for number, (field_m, until_s, flight_s) in enumerate(flights):
        before_s = [
            end_s
            for (other_m, *_), end_s in zip(flights[:number], ends_s, strict=True)
            if math.dist(other_m, field_m) <= FIELD_M
        ]
        begins_s = max([at_s, *before_s])
        ends_s.append(begins_s + flight_s if until_s is None else max(until_s, at_s))
    return ends_s
