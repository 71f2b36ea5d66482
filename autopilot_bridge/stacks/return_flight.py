"""Reads from an autopilot's parameters how it returns: speeds, height and destination. Pure.

Sources: ``mode_rtl.cpp`` of ArduPlane and ArduCopter 4.6.2; ``rtl.cpp``, ``rtl_direct.cpp`` and
``mission_base.cpp`` of PX4 1.17. Each return begins at the speeds set in the parameters and cancels
any speed that the mission commanded.
"""

from collections.abc import Mapping
from typing import NamedTuple

from autopilot_bridge.stacks.stacks import Stack

_PARAMETERS = {
    ("px4", "plane"): (
        *("FW_AIRSPD_TRIM", "FW_T_CLMB_R_SP", "FW_R_LIM", "RTL_RETURN_ALT", "RTL_TYPE"),
    ),
    ("px4", "copter"): ("MPC_XY_CRUISE", "MPC_Z_V_AUTO_UP", "MPC_ACC_HOR", "RTL_RETURN_ALT"),
    ("ardupilot", "plane"): ("AIRSPEED_CRUISE", "RTL_ALTITUDE"),
    ("ardupilot", "copter"): (
        *("RTL_SPEED", "WPNAV_SPEED", "WPNAV_SPEED_UP", "WPNAV_ACCEL", "RTL_ALT"),
    ),
}
# Time that a multirotor loses, besides stopping and accelerating, until its controllers settle on
# the heading home, measured in the simulators of PX4 1.17 (SIH) and ArduCopter 4.6.2.
MULTIROTOR_BEGIN_S = {"px4": 6.0, "ardupilot": 0.0}
# A PX4 1.17 plane that is more than NAV_FW_ALT_RAD below its return altitude begins its return by a
# climb in a circle of the radius NAV_LOITER_RAD about its position, clockwise. It leaves the circle
# on any heading, when it is within NAV_FW_ALT_RAD of the return altitude and within the radius plus
# NAV_ACC_RAD of the centre, and flies home at the altitude that it then has. Defaults of PX4:
PX4_CLIMB_ENDS_BELOW_M = 10.0
PX4_CLIMB_RADIUS_M, PX4_CLIMB_WITHIN_M = 80.0, 90.0
_TO_LANDING = (1, 2, 3, 4)  # values of RTL_TYPE that return to the mission's landing


class ReturnFlight(NamedTuple):
    """How a vehicle returns according to its parameters; values that were not read are None.

    ``speed_m_s`` is the ground speed of multirotors and the calibrated airspeed of planes.
    ``height_m`` is above home; it is also None if the autopilot returns at its current height, in
    which case ``at_current_height`` is true. ``bank_deg`` is the bank limit of PX4 planes, at which
    they turn; ArduPlane turns less sharply than its limit. ``to_landing`` is whether PX4 returns to
    the landing at the end of its mission, if there is one, instead of to home.
    """

    speed_m_s: float | None = None
    height_m: float | None = None
    climb_m_s: float | None = None
    acceleration_m_s2: float | None = None
    bank_deg: float | None = None
    to_landing: bool = False
    at_current_height: bool = False


UNREAD = ReturnFlight()


def parameters_of(stack: Stack) -> tuple[str, ...]:
    """Return the names of the parameters that ``return_flight_of`` uses."""
    return _PARAMETERS[stack.name, stack.vehicle]


def return_flight_of(stack: Stack, values: Mapping[str, float]) -> ReturnFlight:
    """Return how a vehicle returns.

    Args:
        stack: The autopilot and the kind of vehicle.
        values: The values of ``parameters_of(stack)`` by name; any may be absent.
    """
    height_m = return_height_m(stack, values)
    if stack.name == "px4" and stack.vehicle == "plane":
        to_landing = values.get("RTL_TYPE") in _TO_LANDING
        speed_m_s, climb_m_s = values.get("FW_AIRSPD_TRIM"), values.get("FW_T_CLMB_R_SP")
        bank_deg = values.get("FW_R_LIM")
        return ReturnFlight(speed_m_s, height_m, climb_m_s, None, bank_deg, to_landing)
    if stack.name == "px4":
        speed_m_s, climb_m_s = values.get("MPC_XY_CRUISE"), values.get("MPC_Z_V_AUTO_UP")
        return ReturnFlight(speed_m_s, height_m, climb_m_s, values.get("MPC_ACC_HOR"))
    if stack.vehicle == "plane":
        current = values.get("RTL_ALTITUDE", 0.0) < 0.0
        return ReturnFlight(values.get("AIRSPEED_CRUISE"), height_m, at_current_height=current)
    speed_cm_s = values.get("RTL_SPEED")
    if speed_cm_s == 0.0:
        speed_cm_s = values.get("WPNAV_SPEED")
    climb_cm_s, acceleration_cm_s2 = values.get("WPNAV_SPEED_UP"), values.get("WPNAV_ACCEL")
    return ReturnFlight(_m(speed_cm_s), height_m, _m(climb_cm_s), _m(acceleration_cm_s2))


def return_height_m(stack: Stack, values: Mapping[str, float]) -> float | None:
    """Return the height above home at which a vehicle returns.

    None if the autopilot returns at its current height, or the parameter is absent.
    """
    if stack.name == "px4":
        return values.get("RTL_RETURN_ALT")
    if stack.vehicle == "copter":
        return _m(values.get("RTL_ALT"))
    height_m = values.get("RTL_ALTITUDE")
    return None if height_m is None or height_m < 0.0 else height_m


def _m(centimetres: float | None) -> float | None:
    return None if centimetres is None else centimetres / 100.0


def true_airspeed_factor(altitude_amsl_m: float) -> float:
    """Return the ratio of true to calibrated airspeed in the standard atmosphere."""
    return float((1.0 - 2.25577e-5 * altitude_amsl_m) ** -2.12794)
