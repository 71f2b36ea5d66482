"""Decides when the remaining energy of a vehicle is needed for its flight home. Pure."""

import math
from typing import NamedTuple

from autopilot_bridge.stacks.return_flight import (
    MULTIROTOR_BEGIN_S,
    PX4_CLIMB_ENDS_BELOW_M,
    true_airspeed_factor,
)
from firemodel.landscape.landscape import Landscape
from mission_service.config.sections import VehicleSection
from mission_service.position_fix import PositionFix
from mission_service.vehicles.energy import EnergyEstimate, estimate, times_left
from mission_service.vehicles.landing_time import landing_s
from mission_service.vehicles.vehicle_state import Vehicle
from mission_service.vehicles.way_home import (
    Vector,
    circle_climb,
    copter_home_s,
    plane_home_s,
)

RETURN_HEIGHTS_M = {"px4": 60.0, "ardupilot": 15.0}  # RTL_RETURN_ALT, ArduCopter's RTL_ALT
ACCELERATION_M_S2 = 2.5  # of a copter whose parameters were not read
PX4_CLIMB_BEGINS_S = 2.5  # until PX4 planes climb at full rate, measured in the simulator (SIH)
GRAVITY_M_S2 = 9.80665
MIN_SPEED_M_S = 1.0  # the heading of a slower vehicle is unknown


def air_velocity_m_s(landscape: Landscape, speed_m_s: float, from_deg: float) -> Vector:
    """Return the velocity of the air (x, y) on the map; the wind blows from ``from_deg``."""
    toward_rad = math.radians(landscape.grid_deg(from_deg + 180.0))
    return speed_m_s * math.sin(toward_rad), speed_m_s * math.cos(toward_rad)


def must_return(vehicle: Vehicle) -> bool:
    """Return whether the remaining energy is needed for the flight home and the reserve."""
    if vehicle.sent_home or vehicle.going_home:
        return not vehicle.sent_home
    found = vehicle.energy.estimate
    return found is not None and found.time_on_task_s <= 0.0 and not vehicle.energy.flies_on


def usual_return_height_m(section: VehicleSection) -> float:
    """Return the height above home to which a vehicle climbs before it flies home."""
    given = section.return_height_m
    return RETURN_HEIGHTS_M[section.stack] if given is None else given


def climb_ends_below_m(section: VehicleSection) -> float:
    """Return how far below the return altitude the climb at the beginning of a return may end."""
    return PX4_CLIMB_ENDS_BELOW_M if section.stack == "px4" and section.winged else 0.0


class ReturnPerformance(NamedTuple):
    """The speeds, acceleration and turn radius of a return.

    ``speed_m_s`` is the ground speed of copters and the airspeed of planes.
    """

    speed_m_s: float
    climb_m_s: float
    acceleration_m_s2: float  # of copters
    turn_radius_m: float  # of planes


def planned_performance(section: VehicleSection) -> ReturnPerformance:
    """Return the performance in a return as given in the scenario."""
    speed_m_s = section.return_speed_m_s or section.airspeed_m_s
    return ReturnPerformance(speed_m_s, section.climb_m_s, ACCELERATION_M_S2, section.turn_radius_m)


def expected_performance(vehicle: Vehicle, altitude_amsl_m: float) -> ReturnPerformance:
    """Return the performance from the autopilot's parameters, or else from the scenario.

    The speed of a plane is its true airspeed at this altitude: as measured on this flight, or else
    computed for the standard atmosphere.
    """
    planned, read = planned_performance(vehicle.section), vehicle.return_flight
    speed_m_s, turn_radius_m = read.speed_m_s or planned.speed_m_s, planned.turn_radius_m
    if vehicle.section.winged:
        speed_m_s *= true_airspeed_factor(altitude_amsl_m)
        speed_m_s *= 1.0 if vehicle.air_data is None else vehicle.air_data.airspeed_factor
        if read.bank_deg:
            turn_radius_m = speed_m_s**2 / (GRAVITY_M_S2 * math.tan(math.radians(read.bank_deg)))
    return ReturnPerformance(
        speed_m_s,
        read.climb_m_s or planned.climb_m_s,
        read.acceleration_m_s2 or planned.acceleration_m_s2,
        turn_radius_m,
    )


def home_s(vehicle: Vehicle, fix: PositionFix, wind_m_s: Vector, return_amsl_m: float) -> float:
    """Return the seconds until the vehicle is over home; infinity if the wind prevents it.

    For a plane that returns to its landing, the flight ends at the loiter that begins the landing.
    ``wind_m_s`` is the velocity of the air (x, y). Copters, and planes with PX4, climb before they
    fly home, PX4 planes to ``PX4_CLIMB_ENDS_BELOW_M`` below ``return_amsl_m``, the others to this
    altitude; ArduPlane climbs on the way.
    """
    landing_m = _landing_of_return_m(vehicle, fix.at_s)
    goal_m = vehicle.home_m if landing_m is None else landing_m
    home_m = (goal_m[0] - fix.x_m, goal_m[1] - fix.y_m)
    climb_m = max(return_amsl_m - fix.altitude_m, 0.0)
    performance = expected_performance(vehicle, fix.altitude_m)
    over_ground_m_s = (fix.east_m_s, fix.north_m_s)
    return return_s(vehicle.section, performance, home_m, over_ground_m_s, wind_m_s, climb_m)


def to_place_s(vehicle: Vehicle, fix: PositionFix, to_m: Vector, wind_m_s: Vector) -> float:
    """Return the duration (s) of a flight to a position at the vehicle's airspeed; may be infinite.

    ``wind_m_s`` is the velocity of the air, x, y.
    """
    section = vehicle.section
    place_m = (to_m[0] - fix.x_m, to_m[1] - fix.y_m)
    if section.kind == "copter":
        fastest_m_s = max(section.max_airspeed_m_s, section.airspeed_m_s)
        return copter_home_s(place_m, wind_m_s, section.airspeed_m_s, fastest_m_s)
    heading = (fix.east_m_s - wind_m_s[0], fix.north_m_s - wind_m_s[1])
    radius_m = section.turn_radius_m if math.hypot(*heading) > MIN_SPEED_M_S else 0.0
    return plane_home_s(place_m, heading, wind_m_s, section.airspeed_m_s, radius_m)


def _landing_of_return_m(vehicle: Vehicle, at_s: float) -> Vector | None:
    """Return the loiter (x, y) that begins the landing to which a return leads; None: home."""
    return vehicle.landing.start_at(at_s) if vehicle.return_flight.to_landing else None


def landing_after_return_s(
    vehicle: Vehicle, height_m: float, wind_m_s: Vector, at_s: float
) -> float:
    """Return the seconds from the end of a return to the touchdown.

    ``height_m`` is the height above home at the end of the return; ``wind_m_s`` is the velocity of
    the air (x, y).
    """
    home_m = vehicle.home_m if _landing_of_return_m(vehicle, at_s) is None else None
    approach = vehicle.landing.approach_at(at_s)
    return landing_s(vehicle.section, approach, home_m, height_m, wind_m_s)


def return_s(
    section: VehicleSection,
    performance: ReturnPerformance,
    home_m: Vector,
    over_ground_m_s: Vector,
    wind_m_s: Vector,
    climb_m: float,
) -> float:
    """Return the duration of a flight home in seconds; infinity if the wind prevents it.

    ``home_m`` is the position of home relative to the vehicle, ``over_ground_m_s`` the vehicle's
    velocity, and ``wind_m_s`` that of the air, each (x, y). ``climb_m`` is the return altitude
    above the vehicle. Copters stop and climb first, PX4 planes climb in a circle first, and
    ArduPlane climbs on the way.
    """
    speed_m_s = performance.speed_m_s
    if section.kind == "copter":
        fastest_m_s = max(section.max_airspeed_m_s, speed_m_s)
        stop_s = math.hypot(*over_ground_m_s) / performance.acceleration_m_s2
        from_stop_m = (
            home_m[0] - over_ground_m_s[0] * stop_s / 2.0,
            home_m[1] - over_ground_m_s[1] * stop_s / 2.0,
        )
        straight_s = copter_home_s(from_stop_m, wind_m_s, speed_m_s, fastest_m_s)
        both_ends_s = speed_m_s / performance.acceleration_m_s2  # half of it at either end
        begin_s = MULTIROTOR_BEGIN_S[section.stack]
        climb_s = climb_m / performance.climb_m_s
        return stop_s + begin_s + climb_s + straight_s + both_ends_s
    heading = (over_ground_m_s[0] - wind_m_s[0], over_ground_m_s[1] - wind_m_s[1])
    radius_m = performance.turn_radius_m if math.hypot(*heading) > MIN_SPEED_M_S else 0.0
    climb_m -= climb_ends_below_m(section)
    if section.stack != "px4" or climb_m <= 0.0:
        return plane_home_s(home_m, heading, wind_m_s, speed_m_s, radius_m)
    climb_s = PX4_CLIMB_BEGINS_S + climb_m / performance.climb_m_s
    end = circle_climb(heading, wind_m_s, speed_m_s, performance.turn_radius_m, climb_s)
    left_m = (home_m[0] - end.place_m[0], home_m[1] - end.place_m[1])
    rest_s = plane_home_s(left_m, end.through_air_m_s, wind_m_s, speed_m_s, radius_m)
    return end.after_s + rest_s


def outbound_s(section: VehicleSection, task_m: Vector, wind_m_s: Vector, climb_m: float) -> float:
    """Return the seconds from takeoff to a task; infinity if the wind prevents the flight.

    ``task_m`` is the position of the task relative to home, ``wind_m_s`` the velocity of the air,
    each (x, y). Copters climb ``climb_m`` first; planes climb on the way.
    """
    climb_s = climb_m / section.climb_m_s
    speed_m_s = section.airspeed_m_s
    if section.kind == "copter":
        fastest_m_s = max(section.max_airspeed_m_s, speed_m_s)
        return climb_s + copter_home_s(task_m, wind_m_s, speed_m_s, fastest_m_s)
    return max(climb_s, plane_home_s(task_m, task_m, wind_m_s, speed_m_s, 0.0))


def time_up_words(vehicle: Vehicle, at_s: float) -> str:
    """Return why a vehicle lacks the energy to fly on, or to start; "" if it has enough."""
    found: EnergyEstimate | None = vehicle.energy.estimate
    if not vehicle.availability.airborne:
        section = vehicle.section
        arrives_m = max(usual_return_height_m(section), section.altitude_agl_m)
        lands_s = landing_after_return_s(vehicle, arrives_m, (0.0, 0.0), at_s)
        times = times_left(section, vehicle.battery, 0.0, lands_s, at_s)
        found = estimate(times, 0.0, lands_s, at_s)
    return found.words if found is not None and found.time_on_task_s <= 0.0 else ""
