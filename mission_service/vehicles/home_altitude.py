"""Corrects landings for the error of the altitude that PX4 uses as that of home. Pure.

PX4 takes the altitude of home from a single estimate at takeoff. In its simulator, this estimate is
up to 2 m wrong, and 1 m moves the place where a plane comes to rest by 13 m. The mean of the
altitudes reported on the ground is nearer to the truth.
"""

from dataclasses import replace

from autopilot_bridge.items import RELATIVE_FRAMES, Items, has_position
from mission_service.vehicles.vehicle_state import Vehicle

# A smaller error has little effect; a larger difference means that home is at another place.
MIN_ERROR_M, MAX_ERROR_M = 0.3, 5.0


def home_error_m(vehicle: Vehicle) -> float:
    """Return the height of the ground at home above the altitude that a PX4 plane uses for home."""
    section, availability = vehicle.section, vehicle.availability
    fix, ground_amsl_m = availability.fix, availability.ground.amsl_m
    if (section.stack, section.kind) != ("px4", "plane") or fix is None or ground_amsl_m is None:
        return 0.0
    error_m = ground_amsl_m - (fix.altitude_m - availability.height_m)
    return round(error_m, 1) if MIN_ERROR_M <= abs(error_m) <= MAX_ERROR_M else 0.0


def corrected(items: Items, vehicle: Vehicle) -> Items:
    """Return items with altitudes above home as they are above the ground at home."""
    error_m = home_error_m(vehicle)
    if not error_m:
        return items
    return tuple(
        replace(item, z=item.z + error_m)
        if item.frame in RELATIVE_FRAMES and has_position(item.command)
        else item
        for item in items
    )


def landing_items(vehicle: Vehicle, at_s: float) -> Items:
    """Return the landing at the end of a vehicle's mission; () if none is needed."""
    return corrected(vehicle.landing.items_at(at_s), vehicle)
