"""Compares a plane's airspeed with the airspeed commanded by its missions. Pure.

Autopilots accept commanded airspeeds that they do not fly. ArduPlane 4.6 silently skips a
DO_CHANGE_SPEED item whose airspeed lies outside the range from AIRSPEED_MIN to AIRSPEED_MAX. PX4
1.17 limits the airspeed to the range from FW_AIRSPD_MIN to FW_AIRSPD_MAX. Paths, endurance and
separation are planned with ``airspeed_m_s``.
"""

from mission_service.commands import AnyCommand, ClearAlarm, RaiseAlarm
from mission_service.vehicles.availability import MISSION
from mission_service.vehicles.vehicle_state import Vehicle

AIRSPEED = "airspeed"
DIFFERENCE_M_S, DIFFERENCE_SHARE = 2.0, 0.15  # tolerance: the larger of the two
LASTS_S = 90.0  # longer than deviations in climbs and turns last


def airspeed_compared(vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
    """Raise or clear the alarm about an airspeed that differs from the commanded one.

    The alarm is raised when the difference has lasted ``LASTS_S`` in the mission, and cleared when
    the difference or the mission has ended. Missions command the airspeed after takeoff.
    """
    commanded_m_s, measured_m_s = vehicle.section.airspeed_m_s, vehicle.airspeed_m_s
    availability = vehicle.availability
    led = availability.airborne and not (availability.on_ground or availability.taken_over)
    in_mission = led and (availability.mode == MISSION or availability.held_by_upload)
    in_mission &= not (vehicle.takes_off or vehicle.landing_state.active)
    if not vehicle.section.winged or measured_m_s is None or not in_mission:
        return _compared_equal(vehicle)
    if abs(measured_m_s - commanded_m_s) <= max(DIFFERENCE_M_S, DIFFERENCE_SHARE * commanded_m_s):
        return _compared_equal(vehicle)
    if vehicle.airspeed_differs_since_s is None:
        vehicle.airspeed_differs_since_s = at_s
    if vehicle.airspeed_alarm or at_s - vehicle.airspeed_differs_since_s < LASTS_S:
        return []
    vehicle.airspeed_alarm = True
    words = (
        f"its airspeed is {measured_m_s:.0f} m/s, but its missions command {commanded_m_s:g} m/s: "
        "correct its airspeed_m_s, or its autopilot's airspeed limits"
    )
    return [RaiseAlarm(vehicle.name, AIRSPEED, words, "warning")]


def _compared_equal(vehicle: Vehicle) -> list[AnyCommand]:
    vehicle.airspeed_differs_since_s = None
    if not vehicle.airspeed_alarm:
        return []
    vehicle.airspeed_alarm = False
    return [ClearAlarm(vehicle.name, AIRSPEED)]
