"""Stores a vehicle's kind and return from its parameters, and compares the return. Pure."""

from autopilot_bridge.stacks.return_flight import ReturnFlight, return_flight_of
from autopilot_bridge.stacks.stacks import kind_of, stack_named
from mission_service.commands import AnyCommand
from mission_service.events import ParametersReported
from mission_service.vehicles.vehicle_state import Vehicle, announce

SPEED_SHARE, HEIGHT_M = 0.1, 5.0  # larger deviations from the scenario are announced


def return_read(vehicle: Vehicle, event: ParametersReported) -> list[AnyCommand]:
    """Store the kind and the return, and announce where the return differs from the scenario.

    The estimates use the parameters; scenario values replace only those that were not read.
    """
    stack = stack_named(*event.stack.split())
    vehicle.reported_kind = kind_of(stack, event.values)
    read = return_flight_of(stack, event.values)
    if read == vehicle.return_flight:
        return []
    vehicle.return_flight = read
    words = _differences(vehicle, read)
    if not words:
        return []
    line = f"its parameters set its return: {', '.join(words)}"
    return [announce(vehicle, line)]


def _differences(vehicle: Vehicle, read: ReturnFlight) -> list[str]:
    """Return the differences, such as "22 m/s (return_speed_m_s = 15 in the scenario)"."""
    section, found = vehicle.section, []
    name = "airspeed_m_s" if section.return_speed_m_s is None else "return_speed_m_s"
    planned_m_s = section.return_speed_m_s or section.airspeed_m_s
    if read.speed_m_s and abs(read.speed_m_s - planned_m_s) > SPEED_SHARE * planned_m_s:
        found.append(f"{read.speed_m_s:g} m/s ({name} = {planned_m_s:g} in the scenario)")
    given_m, height_m = section.return_height_m, read.height_m
    if given_m is not None and height_m is not None and abs(height_m - given_m) > HEIGHT_M:
        found.append(f"{height_m:g} m above home (return_height_m = {given_m:g})")
    return found
