"""Corrects landings for the error of the altitude that PX4 uses as that of home. Pure.

PX4 takes the altitude of home from a single estimate at takeoff, and changes it in the first two
minutes of the flight. In its simulator it is then up to 2 m wrong, and 1 m moves the place where a
plane comes to rest by 13 m. The mean of the altitudes reported on the ground is nearer to the
truth.
"""

import math

from autopilot_bridge.items import RELATIVE_FRAMES, Items, at_altitudes
from mission_service.vehicles.vehicle_state import Vehicle

# A smaller error has little effect; a larger difference has another cause.
MIN_ERROR_M, MAX_ERROR_M = 0.3, 3.0
AT_HOME_M = 30.0  # the vehicle stood this near to home


def home_error_m(vehicle: Vehicle) -> float:
    """Return by how much a PX4 plane's altitude of home is too low; 0 if this is unknown.

    It is known in the air after the plane has stood at home: PX4 replaces its home at takeoff.
    """
    section, availability = vehicle.section, vehicle.availability
    fix, ground = availability.fix, availability.ground
    if (section.stack, section.kind) != ("px4", "plane") or fix is None:
        return 0.0
    ground_amsl_m = ground.settled_m
    if ground_amsl_m is None or not availability.airborne:
        return 0.0
    if math.dist(ground.place_m, vehicle.home_m) > AT_HOME_M:
        return 0.0
    error_m = ground_amsl_m - (fix.altitude_m - availability.height_m)
    return round(error_m, 1) if MIN_ERROR_M <= abs(error_m) <= MAX_ERROR_M else 0.0


def corrected(items: Items, vehicle: Vehicle) -> Items:
    """Return items at the intended heights above the ground, whatever PX4's altitude of home."""
    error_m = home_error_m(vehicle)
    if not error_m:
        return items
    return at_altitudes(items, RELATIVE_FRAMES, lambda z: z + error_m)


def landing_items(vehicle: Vehicle, at_s: float) -> Items:
    """Return the landing at the end of a vehicle's mission; () if none is needed."""
    return corrected(vehicle.landing.items_at(at_s), vehicle)
