"""Creates the mock's telemetry messages, with values as the stacks send them."""

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Message
from autopilot_bridge.mock.flight_model import FlightModel
from autopilot_bridge.stacks.stacks import Stack

# Enabled sensors: gyro, accelerometer, compass, barometer, GPS, motors, AHRS.
SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_GPS
    | mavlink.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    | mavlink.MAV_SYS_STATUS_AHRS
)


def attitude(boot_ms: int, roll_rad: float, pitch_rad: float, yaw_rad: float) -> Message:
    """Return an ATTITUDE with the yaw from -pi to pi."""
    yaw_rad = (yaw_rad + math.pi) % math.tau - math.pi
    return mavlink.MAVLink_attitude_message(boot_ms, roll_rad, pitch_rad, yaw_rad, 0.0, 0.0, 0.0)


def vfr_hud(
    airspeed_m_s: float,
    groundspeed_m_s: float,
    heading_rad: float,
    throttle_percent: int,
    altitude_amsl_m: float,
    climb_m_s: float,
) -> Message:
    """Return a VFR_HUD."""
    heading_deg = round(math.degrees(heading_rad)) % 360
    return mavlink.MAVLink_vfr_hud_message(
        airspeed_m_s, groundspeed_m_s, heading_deg, throttle_percent, altitude_amsl_m, climb_m_s
    )


def wind(from_deg: float, speed_m_s: float) -> Message:
    """Return ArduPilot's WIND with the direction (-180 to 180) from which the wind blows."""
    return mavlink.MAVLink_wind_message((from_deg + 180.0) % 360.0 - 180.0, speed_m_s, 0.0)


def wind_cov(boot_us: int, from_deg: float, speed_m_s: float, altitude_amsl_m: float) -> Message:
    """Return PX4's WIND_COV with the north and east components of the velocity of the air."""
    toward_rad = math.radians(from_deg + 180.0)
    north_m_s, east_m_s = speed_m_s * math.cos(toward_rad), speed_m_s * math.sin(toward_rad)
    rest = (0.0, 0.08, 0.0, altitude_amsl_m, 0.0, 0.0)
    return mavlink.MAVLink_wind_cov_message(boot_us, north_m_s, east_m_s, *rest)


def sys_status(percent: int, voltage_v: float, unhealthy: int = 0) -> Message:
    """Return a SYS_STATUS; ``unhealthy`` is the bit mask of unhealthy sensors."""
    return mavlink.MAVLink_sys_status_message(
        *(SENSORS, SENSORS, SENSORS & ~unhealthy, 300),
        *(round(voltage_v * 1e3), 0, percent),
        *(0, 0, 0, 0, 0, 0),
    )


def battery_status(
    percent: int,
    voltage_v: float,
    current_a: float | None = None,
    consumed_mah: float = 0.0,
    remaining_s: float = 0.0,
) -> Message:
    """Return a BATTERY_STATUS; cell 1 has the total voltage, as without cell sensors.

    ``remaining_s`` is PX4's own estimate; 0 means that there is none, as with ArduPilot.
    """
    voltages = [round(voltage_v * 1e3)] + [65535] * 9
    current_ca = -1 if current_a is None else round(current_a * 100.0)
    used = (current_ca, round(consumed_mah), -1)
    message = mavlink.MAVLink_battery_status_message(0, 0, 0, 32767, voltages, *used, percent)
    message.time_remaining = round(remaining_s)
    return message


def landed_state(stack: Stack, flight: FlightModel) -> Message:
    """Return an EXTENDED_SYS_STATE; ArduPlane reports only "on the ground" and "in the air"."""
    state = mavlink.MAV_LANDED_STATE_IN_AIR
    if not flight.airborne:
        state = mavlink.MAV_LANDED_STATE_ON_GROUND
    elif (stack.name, stack.vehicle) == ("ardupilot", "plane"):
        pass
    elif flight.mode == "land" or flight.lands:
        state = mavlink.MAV_LANDED_STATE_LANDING
    elif flight.mode == "takeoff":
        state = mavlink.MAV_LANDED_STATE_TAKEOFF
    vtol_state = mavlink.MAV_VTOL_STATE_UNDEFINED
    if stack.vtol:
        vtol_state = mavlink.MAV_VTOL_STATE_MC if flight.hovers else mavlink.MAV_VTOL_STATE_FW
    return mavlink.MAVLink_extended_sys_state_message(vtol_state, state)


def system_status(stack: Stack, flight: FlightModel) -> int:
    """Return the heartbeat's MAV_STATE; PX4 is active when armed, ArduPilot when in the air."""
    if flight.failsafe:
        return int(mavlink.MAV_STATE_CRITICAL)
    active = flight.armed if stack.name == "px4" else flight.airborne
    return int(mavlink.MAV_STATE_ACTIVE if active else mavlink.MAV_STATE_STANDBY)


def fence_status(breached: bool, boot_ms: int) -> Message:
    """Return the FENCE_STATUS of a polygon fence."""
    kind = mavlink.FENCE_BREACH_BOUNDARY if breached else mavlink.FENCE_BREACH_NONE
    return mavlink.MAVLink_fence_status_message(breached, int(breached), kind, boot_ms)


ESTIMATE_VALID = 0x033F  # flags for attitude, velocities, positions and predicted positions
POSITION_HOLDS_S = 7.0  # the position remains valid for this time without satellites


def estimator_flags(stack: Stack, blind_s: float) -> int:
    """Return the flags of the position estimate, ``blind_s`` seconds after the last fix."""
    flags = ESTIMATE_VALID
    if blind_s > POSITION_HOLDS_S:
        flags &= ~(mavlink.ESTIMATOR_POS_HORIZ_ABS | mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS)
    elif blind_s > 0.5 and stack.name == "px4":
        flags &= ~mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS
    return flags


def ekf_status(flags: int) -> Message:
    """Return ArduPilot's EKF_STATUS_REPORT."""
    return mavlink.MAVLink_ekf_status_report_message(flags, 0.05, 0.05, 0.05, 0.05, 0.0)


def estimator_status(flags: int, boot_us: int) -> Message:
    """Return PX4's ESTIMATOR_STATUS."""
    ratios = (0.1, 0.1, 0.1, 0.1, 0.0, 0.0)
    return mavlink.MAVLink_estimator_status_message(boot_us, flags, *ratios, 0.5, 0.8)


def gps_raw(
    boot_us: int, lat_deg: float, lon_deg: float, altitude_amsl_m: float, fix: int, satellites: int
) -> Message:
    """Return a GPS_RAW_INT."""
    place = (round(lat_deg * 1e7), round(lon_deg * 1e7), round(altitude_amsl_m * 1e3))
    return mavlink.MAVLink_gps_raw_int_message(boot_us, fix, *place, 121, 200, 0, 0, satellites)


def remote_id(error: str) -> Message:
    """Return an OPEN_DRONE_ID_ARM_STATUS; an empty error means that the module is ready."""
    status = mavlink.MAV_ODID_ARM_STATUS_PRE_ARM_FAIL_GENERIC
    if not error:
        status = mavlink.MAV_ODID_ARM_STATUS_GOOD_TO_ARM
    return mavlink.MAVLink_open_drone_id_arm_status_message(status, error.encode()[:50])
