"""Raises a plane's hold if its circle would come too close to rising ground. Pure."""

from firemodel.landscape.landscape import Landscape
from mission_service.airspace.occupied_space import LOITER_RADIUS_FACTOR
from mission_service.commands import Hold, HoldAt
from mission_service.missions.orbits import Place, highest_ground_m
from mission_service.vehicles.vehicle_state import Vehicle

# Above the highest ground within the reach of a hold:
MIN_HOLD_AGL_M = 30.0  # a hold that is lower is raised
RAISED_HOLD_AGL_M = 40.0  # to this height


def raised_hold(command: Hold, vehicle: Vehicle, landscape: Landscape) -> Hold | HoldAt:
    """Return a hold at the vehicle's position, raised if its circle would be too low there.

    The circle of a hold extends up to two radii from the position where the hold begins.
    Multirotors hold in place, and ``backend = "mavsdk"`` cannot hold at another altitude. A hold
    that is repeated until the autopilot accepts it keeps its position.
    """
    fix, section = vehicle.availability.fix, vehicle.section
    flies = vehicle.availability.airborne and not vehicle.landing_state.active
    if fix is None or not flies or not section.winged or section.backend == "mavsdk":
        return command
    place_m = (fix.x_m, fix.y_m)
    if landscape.elevation_m is None or not landscape.contains(*place_m):
        return command
    reach_m = 2.0 * LOITER_RADIUS_FACTOR * section.loiter_radius_m
    ground_m = highest_ground_m(landscape, place_m, place_m, reach_m)
    if fix.altitude_m >= ground_m + MIN_HOLD_AGL_M:
        return command
    raised = hold_over(place_m, ground_m + RAISED_HOLD_AGL_M, vehicle.name, landscape)
    if vehicle.ordered == "hold":
        vehicle.hold_at = (raised.lat_deg, raised.lon_deg, raised.altitude_amsl_m)
    return raised


def hold_over(place_m: Place, altitude_amsl_m: float, name: str, landscape: Landscape) -> HoldAt:
    """Return the hold of a vehicle at a position (x, y), rounded to 1e-7 degrees and 0.1 m."""
    lat_deg, lon_deg = landscape.lat_lon_of(*place_m)
    place = (round(float(lat_deg), 7), round(float(lon_deg), 7))
    return HoldAt(name, *place, round(altitude_amsl_m, 1))


def circle_ground_m(vehicle: Vehicle, landscape: Landscape) -> float:
    """Return the highest ground within a circle around a vehicle's position."""
    fix = vehicle.availability.fix
    assert fix is not None
    reach_m = LOITER_RADIUS_FACTOR * vehicle.section.loiter_radius_m
    return highest_ground_m(landscape, (fix.x_m, fix.y_m), (fix.x_m, fix.y_m), reach_m)
