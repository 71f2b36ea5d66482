"""Executes commands on the mock according to the rules of each stack.

Sources: source code and simulations of PX4 1.17 and ArduPilot 4.6.2.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import RELATIVE_FRAMES
from autopilot_bridge.links.codec import Message
from autopilot_bridge.mock.flight_model import FlightModel, Mode
from autopilot_bridge.mock.message_intervals import Intervals
from autopilot_bridge.mock.mission_sequencer import DEFAULT_RADIUS_M
from autopilot_bridge.mock.mission_server import MissionServer, text
from autopilot_bridge.mock.parameter_server import ParameterServer
from autopilot_bridge.mock.payload import ACCEPTED, DENIED, REJECTED
from autopilot_bridge.stacks.item_treatment import rules_of
from autopilot_bridge.stacks.stacks import Stack

UNSUPPORTED = int(mavlink.MAV_RESULT_UNSUPPORTED)
FAILED = int(mavlink.MAV_RESULT_FAILED)
_MODES: dict[str, Mode] = {
    "mission": "mission",
    "hold": "hold",
    "return": "rtl",
    "takeoff": "takeoff",
    "land": "land",
    "guided": "guided",
    "orbit": "orbit",
}
_NAMES: dict[Mode, str] = {
    **{mode: name for name, mode in _MODES.items()},
    "glide": "fly by wire a",
    "termination": "termination",
}
NO_PLACE = 2**31 - 1
_ARDUPILOT_FRAMES = (0, 3, 5, 6, 10, 11)


def custom_mode_of(stack: Stack, mode: Mode) -> int:
    """Return the ``custom_mode`` that a heartbeat contains for a mode."""
    return 0 if mode == "idle" else stack.mode_number(_NAMES[mode])


@dataclass(frozen=True, slots=True)
class CommandRequest:
    """The request in a COMMAND_LONG or a COMMAND_INT; ``frame`` is None for a COMMAND_LONG."""

    command: int
    params: tuple[float, float, float, float]
    lat_deg: float
    lon_deg: float
    z: float
    frame: int | None

    @property
    def x_is_none(self) -> bool:
        """Whether a COMMAND_INT has no position."""
        return self.frame is not None and round(self.lat_deg * 1e7) == NO_PLACE


def command_request_of(message: Message) -> CommandRequest:
    """Return the request in a COMMAND_LONG or a COMMAND_INT."""
    params = (message.param1, message.param2, message.param3, message.param4)
    if message.get_type() == "COMMAND_LONG":
        place = (message.param5, message.param6, message.param7)
        return CommandRequest(message.command, params, *place, None)
    return CommandRequest(
        message.command, params, message.x / 1e7, message.y / 1e7, message.z, message.frame
    )


Handler = Callable[[CommandRequest, FlightModel, float], int]  # returns the MAV_RESULT


class CommandServer:
    """The executor of commands; messages that are not acknowledgements are passed to ``send``."""

    def __init__(
        self,
        stack: Stack,
        missions: MissionServer,
        intervals: Intervals,
        parameters: ParameterServer,
        send: Callable[[Message], None],
    ) -> None:
        self._stack = stack
        self._missions = missions
        self._intervals = intervals
        self._parameters = parameters
        self._send = send
        self._px4 = stack.name == "px4"
        self._plane = stack.vehicle == "plane"
        self._handlers = self._handlers_of_stack()

    def execute(self, request: CommandRequest, flight: FlightModel, now_s: float) -> int:
        """Execute a command and return its MAV_RESULT. A commanded mode ends PX4's failsafe."""
        before = flight.mode
        result = self._execute(request, flight, now_s)
        if self._px4 and flight.mode != before:
            flight.failsafe = False
        return result

    def _execute(self, request: CommandRequest, flight: FlightModel, now_s: float) -> int:
        handler = self._handlers.get(request.command)
        if handler is not None:
            return handler(request, flight, now_s)
        if request.command not in rules_of(self._stack).bare:
            return UNSUPPORTED
        params = (*request.params, request.lat_deg, request.lon_deg, request.z)
        done = flight.payload.execute(request.command, params, round(now_s * 1e6))
        servo = request.command == mavlink.MAV_CMD_DO_SET_SERVO
        return ACCEPTED if done else FAILED if servo else UNSUPPORTED

    def _handlers_of_stack(self) -> dict[int, Handler]:
        """Return the handler of each MAV_CMD except those that only switch an output."""
        handlers: dict[int, Handler] = {
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
            mavlink.MAV_CMD_DO_SET_MODE: self._set_mode,
            mavlink.MAV_CMD_MISSION_START: self._change_to("mission"),
            mavlink.MAV_CMD_NAV_TAKEOFF: self._takeoff,
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: self._change_to("rtl"),
            mavlink.MAV_CMD_DO_REPOSITION: self._reposition,
            mavlink.MAV_CMD_DO_CHANGE_SPEED: self._change_speed,
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mavlink.MAV_CMD_REQUEST_MESSAGE: lambda request, flight, now_s: ACCEPTED,
        }
        if self._px4:
            handlers[mavlink.MAV_CMD_DO_ORBIT] = self._orbit
        else:
            handlers[mavlink.MAV_CMD_DO_SET_MISSION_CURRENT] = self._set_current
            handlers[mavlink.MAV_CMD_DO_LAND_START] = self._land_start
        if self._plane and not self._px4:
            handlers[mavlink.MAV_CMD_DO_GO_AROUND] = self._go_around
        if self._px4 or not self._plane:
            handlers[mavlink.MAV_CMD_NAV_LAND] = self._change_to("land")
        return handlers

    def _change_to(self, mode: Mode) -> Handler:
        return lambda request, flight, now_s: self._change(flight, mode, now_s)

    def _set_current(self, request: CommandRequest, flight: FlightModel, now_s: float) -> int:
        return ACCEPTED if 0 <= request.params[0] < len(flight.items) else DENIED

    def _arm(self, request: CommandRequest, flight: FlightModel, now_s: float) -> int:
        arm = request.params[0] > 0.5
        if not arm and flight.airborne:
            return DENIED
        not_armable = "rtl" if self._plane else "mission"  # ArduPilot's RTL and AUTO
        if arm and not flight.armed and not self._px4 and flight.mode == not_armable:
            name = "RTL" if self._plane else "AUTO"
            self._send(text(2, f"Arm: {name} mode not armable"))
            return FAILED
        flight.armed = arm
        return ACCEPTED

    def _set_mode(self, request: CommandRequest, flight: FlightModel, now_s: float) -> int:
        number = int(request.params[1])
        if self._px4:
            number = number << 16 | int(request.params[2]) << 24
        mode = _MODES.get(self._stack.mode_name(number))
        if mode is None:
            return DENIED
        result = self._change(flight, mode, now_s)
        if result == ACCEPTED and mode == "takeoff":  # ArduPlane climbs as soon as it is armed
            ground_m = flight.motion.altitude_m
            height_m = self._parameters.value("TKOFF_ALT") if not self._px4 else 20.0
            flight.fly_around(_position(flight), ground_m + height_m, DEFAULT_RADIUS_M)
        return result

    def _without_position(self, mode: Mode) -> int:
        """Reject a mode that requires a position, and return the MAV_RESULT."""
        if self._px4:
            self._send(text(2, f"Switching to {mode.title()} is currently not available\t"))
            return REJECTED
        self._send(text(4, f"Mode change to {mode.upper()} failed: requires position"))
        return FAILED

    def _change(self, flight: FlightModel, mode: Mode, now_s: float) -> int:
        if flight.blind and mode != "land":
            return self._without_position(mode)
        if mode == "mission":
            if len(self._missions.items) <= (1 if self._stack.item_0_is_home else 0):
                return DENIED
            reason = self._missions.infeasible()
            if reason is not None:
                self._send(text(2, reason + "\t"))
                return REJECTED
        flight.set_mode(mode, now_s)
        return ACCEPTED

    def _takeoff(self, request: CommandRequest, flight: FlightModel, now_s: float) -> int:
        if self._px4:
            flight.set_mode("takeoff", now_s)
            flight.fly_around(_position(flight), request.z, DEFAULT_RADIUS_M)
            return ACCEPTED
        frame_taken = request.frame in (None, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT)
        if not self._plane and not frame_taken:
            return DENIED
        cannot = self._plane and not self._stack.vtol
        if cannot or flight.mode != "guided" or not flight.armed or flight.airborne:
            return FAILED
        flight.fly_around(_position(flight), flight.frame.altitude_m + request.z, DEFAULT_RADIUS_M)
        return ACCEPTED

    def _land_start(self, request: CommandRequest, flight: FlightModel, now_s: float) -> int:
        commands = [item.command for item in flight.items]
        if not self._plane or mavlink.MAV_CMD_DO_LAND_START not in commands:
            self._send(text(4, "Unable to start landing sequence"))
            return FAILED
        flight.set_mode("mission", now_s)
        flight.go_to(commands.index(mavlink.MAV_CMD_DO_LAND_START), now_s)
        return ACCEPTED

    def _go_around(self, request: CommandRequest, flight: FlightModel, now_s: float) -> int:
        return ACCEPTED if flight.go_around(now_s) else FAILED

    def _reposition(self, request: CommandRequest, flight: FlightModel, now_s: float) -> int:
        _, flags, radius_m, direction = request.params
        place = flight.frame.local_of(request.lat_deg, request.lon_deg)
        if flight.blind:
            return self._without_position("hold" if self._px4 else "guided")
        if self._px4:
            if int(flags) != mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE:
                return UNSUPPORTED
            flight.set_mode("hold", now_s)
            if request.x_is_none and math.isnan(request.z):
                flight.fly_around(_position(flight), flight.motion.altitude_m, DEFAULT_RADIUS_M)
            elif flight.armed:
                flight.fly_around(place, request.z, DEFAULT_RADIUS_M)
            return ACCEPTED
        valid = abs(request.lat_deg) <= 90.0 and abs(request.lon_deg) <= 180.0
        if not valid or request.frame not in (None, *_ARDUPILOT_FRAMES):
            return DENIED
        if not int(flags) & 1 and flight.mode != "guided":
            return FAILED if self._plane else DENIED
        altitude_m = request.z
        if request.frame in RELATIVE_FRAMES:
            altitude_m += flight.frame.altitude_m
        flight.set_mode("guided", now_s)
        keeps = math.isnan(radius_m) or radius_m <= 0.0
        signed_m = -radius_m if direction else radius_m
        flight.fly_around(place, altitude_m, flight.radius_m if keeps else signed_m)
        return ACCEPTED

    def _orbit(self, request: CommandRequest, flight: FlightModel, now_s: float) -> int:
        radius_m, speed_m_s, _, _ = request.params
        nowhere = request.x_is_none or math.isnan(request.lat_deg + request.lon_deg)
        place = (
            _position(flight)
            if nowhere
            else flight.frame.local_of(request.lat_deg, request.lon_deg)
        )
        altitude_m = flight.motion.altitude_m if math.isnan(request.z) else request.z
        if self._plane:
            flight.set_mode("hold", now_s)
        else:
            if flight.mode != "orbit":
                flight.orbit_m_s = 1.0
            if not math.isnan(speed_m_s):
                flight.orbit_m_s = speed_m_s
            keeps = flight.mode == "orbit" and request.x_is_none and math.isnan(radius_m)
            flight.set_mode("orbit", now_s)
            if keeps:
                return ACCEPTED
        if flight.armed:
            signed_m = DEFAULT_RADIUS_M if math.isnan(radius_m) else radius_m
            flight.fly_around(place, altitude_m, signed_m)
        return ACCEPTED

    def _change_speed(self, request: CommandRequest, flight: FlightModel, now_s: float) -> int:
        kind, speed_m_s = request.params[:2]
        if self._px4:
            if speed_m_s > 0.0:
                self._set_speed(flight, speed_m_s)  # an orbiting multirotor keeps its own speed
            return ACCEPTED
        if flight.mode not in ("guided", "mission"):
            return FAILED
        if self._plane:
            minimum, maximum = map(self._parameters.value, ("AIRSPEED_MIN", "AIRSPEED_MAX"))
            if kind != 0.0 or not minimum <= speed_m_s <= maximum:
                return FAILED
            self._send(text(6, f"Set airspeed {int(speed_m_s)} m/s"))
        elif speed_m_s <= 0.0:
            return FAILED
        self._set_speed(flight, speed_m_s)
        return ACCEPTED

    def _set_speed(self, flight: FlightModel, speed_m_s: float) -> None:
        flight.limits = replace(flight.limits, airspeed_m_s=speed_m_s)

    def _set_interval(self, request: CommandRequest, flight: FlightModel, now_s: float) -> int:
        message_id, interval_us = int(request.params[0]), request.params[1]
        if not self._intervals.has_message(message_id):
            return ACCEPTED if message_id in mavlink.mavlink_map else FAILED
        self._intervals.set(message_id, interval_us)
        return ACCEPTED


def _position(flight: FlightModel) -> tuple[float, float]:
    return flight.motion.north_m, flight.motion.east_m
