"""Adds the climb that a plane in the air needs before its mission. Pure."""

from autopilot_bridge.items import Items
from firemodel.landscape.landscape import Landscape
from mission_service.missions.climb import with_climb
from mission_service.position_fix import PositionFix
from mission_service.vehicles.vehicle_state import Vehicle


def with_first_climb(
    items: Items, vehicle: Vehicle, landscape: Landscape, fix: PositionFix
) -> Items:
    """Return a mission that first climbs in a loiter, if a plane in the air is too low for it.

    Multirotors climb vertically: their missions are unchanged, as are missions that begin on the
    ground. Altitudes are in metres above mean sea level.
    """
    if not (vehicle.availability.airborne and vehicle.section.winged):
        return items
    position = (fix.x_m, fix.y_m, fix.altitude_m)
    return with_climb(items, vehicle.section, landscape, position, fastest_m_s(vehicle))


def fastest_m_s(vehicle: Vehicle) -> float:
    """Return the maximum ground speed: the sum of the airspeed and the measured wind speed."""
    wind = vehicle.availability.measured_wind
    return vehicle.section.airspeed_m_s + (0.0 if wind is None else wind.speed_m_s)
