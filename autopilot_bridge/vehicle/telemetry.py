"""Converts telemetry messages to events, and discards late and repeated messages."""

import math
from collections.abc import Callable
from typing import get_args

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Message
from autopilot_bridge.vehicle.client_events import (
    Attitude,
    Battery,
    EstimatorStatus,
    FenceStatus,
    GpsFix,
    Health,
    LandedState,
    Position,
    Speed,
    SystemState,
    TelemetryEvent,
    Wind,
)
from autopilot_bridge.vehicle.failure_states import Estimator, fence_status, landed_state

NO_PLACE_DEG_E7 = 1_000_000  # around latitude 0, longitude 0: sea, 500 km from any land
UNKNOWN_VOLTAGE_MV = 65535
FIXES = ("no gps", "no fix", "2d", "3d", "dgps", "rtk float", "rtk fixed", "static", "ppp")


def position(message: Message, at_us: int) -> Position | None:
    """Decode a GLOBAL_POSITION_INT; return None near latitude 0, longitude 0.

    ArduPilot sends such positions before its first fix. These positions drift by dead reckoning: in
    one simulation by 35 m in the first seconds.
    """
    if max(abs(message.lat), abs(message.lon)) < NO_PLACE_DEG_E7:
        return None
    return Position(
        at_us,
        message.time_boot_ms * 1000,
        message.lat / 1e7,
        message.lon / 1e7,
        message.alt / 1e3,
        message.relative_alt / 1e3,
        message.vx / 100.0,
        message.vy / 100.0,
        message.vz / 100.0,
        message.hdg / 100.0 if message.hdg != 65535 else 0.0,
    )


def attitude(message: Message, at_us: int) -> Attitude:
    """Decode an ATTITUDE."""
    angles = (math.degrees(angle) for angle in (message.roll, message.pitch, message.yaw))
    roll_deg, pitch_deg, yaw_deg = angles
    return Attitude(at_us, message.time_boot_ms * 1000, roll_deg, pitch_deg, yaw_deg % 360.0)


def speed(message: Message, at_us: int) -> Speed:
    """Decode a VFR_HUD."""
    airspeed_m_s = None if math.isnan(message.airspeed) else message.airspeed  # PX4 multirotors
    return Speed(at_us, airspeed_m_s, message.groundspeed, message.climb, message.throttle)


def wind(message: Message, at_us: int) -> Wind | None:
    """Decode a WIND (ArduPilot); return None if the autopilot has no estimate.

    ArduCopter 4.6 always sends a wind of exactly 0 if its drag parameters are not set.
    """
    return Wind(at_us, message.direction % 360.0, message.speed) if message.speed else None


def wind_from_vector(message: Message, at_us: int) -> Wind | None:
    """Decode a WIND_COV (PX4); return None if the wind is unknown."""
    if math.isnan(message.wind_x) or math.isnan(message.wind_y):
        return None
    return wind_of_air(message.wind_x, message.wind_y, at_us)


def wind_of_air(north_m_s: float, east_m_s: float, at_us: int) -> Wind:
    """Return the wind for the given north and east components of the air's velocity in m/s."""
    from_deg = math.degrees(math.atan2(-east_m_s, -north_m_s)) % 360.0
    return Wind(at_us, from_deg, math.hypot(north_m_s, east_m_s))


def battery_of_system(message: Message, at_us: int) -> Battery:
    """Decode the state of the battery in a SYS_STATUS."""
    voltage_mv, current_ca = message.voltage_battery, message.current_battery
    return Battery(
        at_us,
        0,
        _percent(message.battery_remaining),
        voltage_mv / 1e3 if voltage_mv not in (0, UNKNOWN_VOLTAGE_MV) else None,
        current_ca / 100.0 if current_ca >= 0 else None,
    )


def battery(message: Message, at_us: int) -> Battery:
    """Decode a BATTERY_STATUS; the voltage is the sum of the cell voltages."""
    cells = [mv for mv in message.voltages if mv != UNKNOWN_VOLTAGE_MV]
    current_ca = message.current_battery
    return Battery(
        at_us,
        message.id,
        _percent(message.battery_remaining),
        sum(cells) / 1e3 if any(cells) else None,
        current_ca / 100.0 if current_ca >= 0 else None,
        message.current_consumed if message.current_consumed >= 0 else None,
        message.time_remaining if message.time_remaining > 0 else None,
    )


def _percent(remaining: int) -> int | None:
    return remaining if remaining >= 0 else None


def health(message: Message, at_us: int) -> Health:
    """Decode the enabled but unhealthy sensors in a SYS_STATUS."""
    bad = message.onboard_control_sensors_enabled & ~message.onboard_control_sensors_health
    return Health(at_us, tuple(word for bit, word in _SENSORS if bad & bit))


def _sensor_name(constant: str) -> str:
    name = constant.removeprefix("MAV_SYS_STATUS_").removeprefix("SENSOR_")
    return name.lower().replace("_", " ")


_SENSORS = tuple(
    (bit, _sensor_name(entry.name))
    for bit, entry in sorted(mavlink.enums["MAV_SYS_STATUS_SENSOR"].items())
    if bit.bit_count() == 1 and "ENUM_END" not in entry.name
)


def gps_fix(message: Message, at_us: int) -> GpsFix:
    """Decode a GPS_RAW_INT."""
    satellites = message.satellites_visible
    return GpsFix(at_us, fix_name(message.fix_type), satellites if satellites != 255 else None)


def fix_name(kind: int) -> str:
    """Return the name of a GPS_FIX_TYPE."""
    return FIXES[kind] if kind < len(FIXES) else f"fix {kind}"


_DECODERS: dict[str, tuple[Callable[[Message, int], TelemetryEvent | None], ...]] = {
    "GLOBAL_POSITION_INT": (position,),
    "ATTITUDE": (attitude,),
    "VFR_HUD": (speed,),
    "WIND": (wind,),
    "WIND_COV": (wind_from_vector,),
    "SYS_STATUS": (health, battery_of_system),
    "BATTERY_STATUS": (battery,),
    "GPS_RAW_INT": (gps_fix,),
    "EXTENDED_SYS_STATE": (landed_state,),
    "FENCE_STATUS": (fence_status,),
}
ESTIMATOR_MESSAGES = ("EKF_STATUS_REPORT", "ESTIMATOR_STATUS")
MESSAGES = frozenset((*_DECODERS, *ESTIMATOR_MESSAGES))
ReportedOnChange = (
    Battery | Health | GpsFix | SystemState | LandedState | FenceStatus | EstimatorStatus
)
REPORTED_ON_CHANGE = get_args(ReportedOnChange)
# Messages that contain the autopilot's time since boot on both stacks. In other messages the time
# may be 0 or the time since the boot of a gimbal.
BATTERY_EVERY_US = 10_000_000
TIMED = ("GLOBAL_POSITION_INT", "ATTITUDE", "SYSTEM_TIME")


class Changes:
    """The last value of each state that is reported only on change."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, int], ReportedOnChange] = {}

    def has(self, event: ReportedOnChange) -> bool:
        """Store a state; return whether it differs from the last reported one of its kind.

        The state of a battery is reported again every ``BATTERY_EVERY_US``: an unchanged charge
        shows that the battery does not discharge; missing reports do not show this.
        """
        number = event.battery_id if isinstance(event, Battery) else 0
        key = (type(event).__name__, number)
        before = self._last.get(key)
        changed = before is None or before.without_time() != event.without_time()
        if before is not None and isinstance(event, Battery):
            changed |= event.at_us - before.at_us >= BATTERY_EVERY_US
        if changed:
            self._last[key] = event
        return changed


class Telemetry:
    """The telemetry of one vehicle; late and repeated messages and unchanged states are dropped."""

    def __init__(self) -> None:
        self._boot_us: dict[str, int] = {}
        self._before_us = -1  # the time of the previous message of the same kind as the last one
        self._changes = Changes()
        self._estimator = Estimator()
        self._has_battery_status = False

    def reset(self) -> None:
        """Discard all times and states, because the autopilot has restarted."""
        self._boot_us.clear()
        self._changes = Changes()
        self._estimator = Estimator()

    def events(self, message: Message, at_us: int) -> list[TelemetryEvent]:
        """Return the events of a message; an unchanged state causes no event."""
        kind = message.get_type()
        if kind in ESTIMATOR_MESSAGES:
            return self.if_changed(self._estimator.receive(message, at_us))
        decoders = _DECODERS.get(kind, ())
        if not decoders or self._late(kind, message):
            return []
        self._has_battery_status |= kind == "BATTERY_STATUS"
        found = []
        for decode in decoders:
            if decode is battery_of_system and self._has_battery_status:
                continue
            event = decode(message, at_us)
            if event is None:
                continue
            if not isinstance(event, REPORTED_ON_CHANGE) or self._changes.has(event):
                found.append(event)
        return found

    def if_changed(self, event: ReportedOnChange) -> list[TelemetryEvent]:
        """Return a list with the state, or an empty list if the state has not changed."""
        return [event] if self._changes.has(event) else []

    def retract(self, kind: str) -> None:
        """Remove the time of an unused message, so that later messages do not count as late."""
        self._boot_us[kind] = self._before_us

    def _late(self, kind: str, message: Message) -> bool:
        boot_us = boot_time_us(message)
        if boot_us is None:
            return False
        if boot_us <= self._boot_us.get(kind, -1):
            return True
        self._before_us = self._boot_us.get(kind, -1)
        self._boot_us[kind] = boot_us
        return False


def boot_time_us(message: Message) -> int | None:
    """Return a message's time since boot in microseconds; None if the message has none."""
    return message.time_boot_ms * 1000 if message.get_type() in TIMED else None
