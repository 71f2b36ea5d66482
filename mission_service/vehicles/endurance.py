"""Decides when the remaining endurance of a vehicle is needed for its flight home. Pure."""

import math

from mission_service.position_fix import PositionFix
from mission_service.vehicles.vehicle_state import Vehicle


def must_return(vehicle: Vehicle, fix: PositionFix) -> bool:
    """Return whether the remaining endurance is needed for the flight home and the reserve."""
    section = vehicle.section
    if vehicle.sent_home or vehicle.going_home:
        return not vehicle.sent_home
    if section.endurance_s is None:
        return False
    against_m_s = max(
        section.airspeed_m_s - vehicle.availability.wind_m_s, section.airspeed_m_s / 3
    )
    home_s = math.dist((fix.x_m, fix.y_m), vehicle.home_m) / against_m_s
    flown_s = fix.at_s - vehicle.availability.took_off_at_s
    return flown_s + home_s + section.endurance_reserve_s >= section.endurance_s
