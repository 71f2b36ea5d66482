"""The mock autopilot, sans-IO: bytes in, datagrams out, one timer.

The time it is given is its simulation clock; ``time_boot_ms`` counts from the first time it sees.
"""

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.codec import Codec, Message
from autopilot_bridge.items import waypoint
from autopilot_bridge.mock import instruments
from autopilot_bridge.mock.ardupilot_server import ArduPilotServer
from autopilot_bridge.mock.commands import CommandServer, asked_of, custom_mode_of
from autopilot_bridge.mock.flight import Flight, LocalFrame
from autopilot_bridge.mock.ftp_server import FtpServer
from autopilot_bridge.mock.intervals import (
    ATTITUDE,
    BATTERY_STATUS,
    GPS,
    POSITION,
    SYS_STATUS,
    VFR_HUD,
    WIND,
    WIND_COV,
    Intervals,
)
from autopilot_bridge.mock.kinematics import STEP_US, Limits, wrap
from autopilot_bridge.mock.mission_server import MissionServer, client_of, text
from autopilot_bridge.mock.parameters import ParameterServer
from autopilot_bridge.mock.px4_server import Px4Server
from autopilot_bridge.mock.wire import with_extension
from autopilot_bridge.stacks import Stack

HEARTBEAT_EVERY_STEPS = 8  # 1 Hz
HOME_EVERY_STEPS = 80
COMPONENT = mavlink.MAV_COMP_ID_AUTOPILOT1
# A process that was held up does not try to make up for more than this at once.
MOST_STEPS_AT_ONCE = 4000


class MockAutopilot:
    """One vehicle standing at its home, disarmed."""

    def __init__(
        self,
        stack: Stack,
        *,
        system_id: int = 1,
        home_lat_deg: float,
        home_lon_deg: float,
        home_altitude_amsl_m: float,
        airspeed_m_s: float = 18.0,
    ) -> None:
        self.stack = stack
        frame = LocalFrame(home_lat_deg, home_lon_deg, home_altitude_amsl_m)
        self.flight = Flight(stack, frame, Limits(airspeed_m_s=airspeed_m_s))
        home = waypoint(home_lat_deg, home_lon_deg, home_altitude_amsl_m)
        server = ArduPilotServer if stack.item_0_is_home else Px4Server
        self.missions: MissionServer = server(stack, home)
        self.missions.flying_mission = self._flying_mission
        self.missions.current_seq = lambda: self.flight.current
        self.flight.items = tuple(self.missions.items)
        self.ftp = FtpServer(self.missions, self._flying_mission)
        self.positions = True  # False: GPS is lost, no position is told
        self.battery_percent: int | None = None  # 100 if not given
        self.unhealthy = 0  # bits of SYS_STATUS
        self.wind_from_deg = self.wind_m_s = 0.0
        self.intervals = Intervals(stack)
        self.parameters = ParameterServer(stack)
        self._commands = CommandServer(
            stack, self.missions, self.intervals, self.parameters, self._send
        )
        self._course_rad = 0.0
        self._codec = Codec(system_id, COMPONENT)
        self._system_id = system_id
        self._outgoing: list[bytes] = []
        self._boot_us: int | None = None
        self._steps = 0
        self._told_current: object = None
        self._reached = self._reached_again = 0

    # Bytes and time -----------------------------------------------------------------------------

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Take in a datagram from any ground station."""
        for message in self._codec.decode(data):
            target = getattr(message, "target_system", self._system_id)
            broadcast = target == 0 and self.stack.name == "ardupilot"
            if target == self._system_id or broadcast:
                self._receive(message, now_us)

    def data_to_send(self) -> list[bytes]:
        """Datagrams to send, each handed out once."""
        outgoing, self._outgoing = self._outgoing, []
        return outgoing

    def next_timer(self) -> int:
        """When the next step or re-request is due."""
        step_us = 0 if self._boot_us is None else self._boot_us + (self._steps + 1) * STEP_US
        timers = (step_us, self.missions.next_timer(), self.ftp.next_timer())
        return min(timer for timer in timers if timer is not None)

    def handle_timer(self, now_us: int) -> None:
        """Fly up to now and say what is due."""
        if self._boot_us is None:
            self._boot_us = now_us
        while (due_us := self.missions.next_timer()) is not None and due_us <= now_us:
            self._send(*self.missions.handle_timer(now_us))
            self._take_over()
        replies = self.ftp.handle_timer(now_us)
        if replies:
            self._send(*replies)
            self._take_over()
        due = (now_us - self._boot_us) // STEP_US - self._steps
        for _ in range(min(due, MOST_STEPS_AT_ONCE)):
            self._steps += 1
            self.flight.step(self._now_s())
            self._report()
            self._tell_instruments()

    def say(self, message: Message) -> None:
        """Send any message, such as an acknowledgement nobody waits for."""
        self._send(message)

    def reboot(self, now_us: int) -> None:
        """Start anew where the vehicle is, disarmed; the lists survive, transfers do not."""
        fresh = Flight(self.stack, self.flight.frame, self.flight.limits)
        fresh.motion = self.flight.motion
        fresh.items = tuple(self.missions.items)
        self.flight = fresh
        self.intervals.reset()
        self.missions.forget_transfers()
        self._boot_us, self._steps, self._reached_again = now_us, 0, 0

    def _flying_mission(self) -> bool:
        return self.flight.armed and self.flight.mode == "mission"

    def _now_s(self) -> float:
        return self._steps * STEP_US / 1e6

    # Messages -----------------------------------------------------------------------------------

    def _receive(self, message: Message, now_us: int) -> None:
        kind = message.get_type()
        if kind in ("COMMAND_LONG", "COMMAND_INT"):
            self._command(message)
        elif kind.startswith("PARAM_"):
            self._send(*self.parameters.receive(message))
        elif kind == "MISSION_SET_CURRENT":
            self._set_current(message)
        elif kind == "FILE_TRANSFER_PROTOCOL":
            self.ftp.receive(message, now_us)
        elif kind.startswith("MISSION_"):
            self._send(*self.missions.receive(message, now_us))
            self._take_over()

    def _take_over(self) -> None:
        """What the vehicle flies after its list of items has changed."""
        flight, missions = self.flight, self.missions
        flight.items = tuple(missions.items)
        if self.stack.keeps_target and self.stack.vehicle == "copter" and self._flying_mission():
            self._restart_item()
        missions.cut = missions.written = False
        if not missions.changed:
            return
        missions.changed = False
        if missions.cleared:
            missions.cleared = False
            flight.current = 0
        if not self.stack.keeps_target:
            self._begin_anew()
        self._tell_current()

    def _begin_anew(self) -> None:
        """PX4 flies a new mission at once; without one it loiters."""
        flight = self.flight
        self._reached_again = 0
        if flight.mode == "mission" and not flight.items:
            self._send(text(2, "No valid mission available, loitering\t"))
            flight.set_mode("hold", self._now_s())
        flight.make_current(self.missions.start_at, self._now_s())

    def _restart_item(self) -> None:
        """ArduCopter begins its item again at every change of the mission."""
        flight, missions = self.flight, self.missions
        if flight.current < len(flight.items) and (missions.cut or missions.written):
            flight.go_to(flight.current, self._now_s())
            self._tell_begun()
            self._send(text(2, "Auto mission changed, restarted command"))
        elif missions.cut:
            self._send(text(2, "Auto mission changed but failed to restart command"))

    def _set_current(self, message: Message) -> None:
        if self.missions.busy_with(client_of(message)):
            self._send(text(2, "WPM: IGN WP CURR CMD: Busy\t"))
        elif message.seq < len(self.flight.items):
            self._make_current(message.seq)
        elif self.stack.name == "px4":
            self._send(text(2, "WPM: WP CURR CMD: Not in list\t"))

    def _make_current(self, seq: int) -> None:
        asked = max(seq, 1 if self.stack.item_0_is_home else 0)
        self.flight.make_current(asked, self._now_s())
        self._tell_current(asked)
        self._tell_begun()

    def _command(self, message: Message) -> None:
        asked = asked_of(message)
        result = self._commands.obey(asked, self.flight, self._now_s())
        if asked.command == mavlink.MAV_CMD_DO_SET_MISSION_CURRENT and result == 0:
            self._make_current(int(asked.params[0]))
        asker = (message.get_srcSystem(), message.get_srcComponent())
        self._send(mavlink.MAVLink_command_ack_message(asked.command, result, 0, 0, *asker))

    # Telemetry ----------------------------------------------------------------------------------

    def _report(self) -> None:
        flight = self.flight
        self._tell_reached()
        self._tell_begun()
        if self._steps % HEARTBEAT_EVERY_STEPS == 1:
            self._heartbeat()
            self._tell_current()
        elif self._told_current != (flight.current, *self.missions.progress()):
            self._tell_current()
        if self.positions and self.intervals.due(POSITION, self._steps):
            self._position()
        if self._steps % HOME_EVERY_STEPS == 1:
            self._home()

    def _tell_reached(self) -> None:
        """MISSION_ITEM_REACHED; PX4 tells it ten more times, once a second."""
        for seq in self.flight.reached:
            self._send(mavlink.MAVLink_mission_item_reached_message(seq))
            self._reached, self._reached_again = seq, 10 if self.stack.name == "px4" else 0
        again = self._reached_again and self._steps % HEARTBEAT_EVERY_STEPS == 1
        if again and not self.flight.reached:
            self._send(mavlink.MAVLink_mission_item_reached_message(self._reached))
            self._reached_again -= 1
        self.flight.reached.clear()

    def _tell_begun(self) -> None:
        """ArduPilot tells of each item it begins in AUTO, by name."""
        flight, names = self.flight, self.missions.habits.mission_names
        if names and flight.mode == "mission":
            for seq, command in flight.begun:
                self._send(text(6, f"Mission: {seq} {names.get(command, command)}"))
        flight.begun.clear()

    def _heartbeat(self) -> None:
        custom_mode = custom_mode_of(self.stack, self.flight.mode)
        base_mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        if self.flight.armed:
            base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        active = mavlink.MAV_STATE_ACTIVE if self.flight.armed else mavlink.MAV_STATE_STANDBY
        self._send(
            mavlink.MAVLink_heartbeat_message(
                self.stack.mav_type, self.stack.autopilot, base_mode, custom_mode, active, 3
            )
        )

    def _tell_current(self, asked: int | None = None) -> None:
        """MISSION_CURRENT; ``asked`` is the item just asked for, though it be passed over."""
        flight = self.flight
        total, ids = self.missions.progress()
        self._told_current = (flight.current, total, ids)
        px4 = self.stack.name == "px4"
        active = flight.mode == "mission" and flight.armed
        if not flight.items or self.missions.infeasible() is not None:
            state = mavlink.MISSION_STATE_NO_MISSION
        elif active:
            state = mavlink.MISSION_STATE_ACTIVE
        else:
            state = mavlink.MISSION_STATE_NOT_STARTED
        mode = 1 if active else 2 if px4 else 0
        current = mavlink.MAVLink_mission_current_message(
            flight.current if asked is None else asked, total, state, mode
        )
        self._send(with_extension(current, *ids))

    def _position(self) -> None:
        motion, frame = self.flight.motion, self.flight.frame
        lat_deg, lon_deg = frame.global_position(motion)
        self._send(
            mavlink.MAVLink_global_position_int_message(
                self._steps * STEP_US // 1000,
                round(lat_deg * 1e7),
                round(lon_deg * 1e7),
                round(motion.altitude_m * 1e3),
                round((motion.altitude_m - frame.altitude_m) * 1e3),
                round(motion.speed_m_s * math.cos(motion.course_rad) * 100),
                round(motion.speed_m_s * math.sin(motion.course_rad) * 100),
                round(-motion.climb_m_s * 100),
                round(math.degrees(motion.course_rad) * 100) % 36000,
            )
        )

    def _tell_instruments(self) -> None:
        flight, motion, step = self.flight, self.flight.motion, self._steps
        boot_us = step * STEP_US
        due = self.intervals.due
        if due(ATTITUDE, step):
            turn = wrap(motion.course_rad - self._course_rad) * 1e6 / STEP_US
            roll_rad = instruments.bank_rad(turn, motion.speed_m_s)
            pitch_rad = math.atan2(motion.climb_m_s, max(motion.speed_m_s, 1.0))
            told = instruments.attitude(boot_us // 1000, roll_rad, pitch_rad, motion.course_rad)
            self._send(told)
        self._course_rad = motion.course_rad
        if due(VFR_HUD, step):
            speeds = (motion.speed_m_s, motion.speed_m_s, motion.course_rad)
            throttle = 60 if flight.armed else 0
            climb = (motion.altitude_m, motion.climb_m_s)
            self._send(instruments.vfr_hud(*speeds, throttle, *climb))
        if due(WIND, step):
            self._send(instruments.wind(self.wind_from_deg, self.wind_m_s))
        if due(WIND_COV, step) and flight.airborne:
            wind = (self.wind_from_deg, self.wind_m_s)
            self._send(instruments.wind_cov(boot_us, *wind, motion.altitude_m))
        percent = 100 if self.battery_percent is None else self.battery_percent
        voltage_v = 14.0 + 2.8 * percent / 100.0
        if due(SYS_STATUS, step):
            self._send(instruments.sys_status(percent, voltage_v, self.unhealthy))
        if due(BATTERY_STATUS, step):
            self._send(instruments.battery_status(percent, voltage_v))
        if due(GPS, step):
            place = flight.frame.global_position(motion)
            fix = (3, 10) if self.positions else (1, 0)
            self._send(instruments.gps_raw(boot_us, *place, motion.altitude_m, *fix))

    def _home(self) -> None:
        frame = self.flight.frame
        self._send(
            mavlink.MAVLink_home_position_message(
                round(frame.lat_deg * 1e7),
                round(frame.lon_deg * 1e7),
                round(frame.altitude_m * 1e3),
                *(0.0, 0.0, 0.0),
                (1.0, 0.0, 0.0, 0.0),
                *(0.0, 0.0, 0.0),
            )
        )

    def _send(self, *messages: Message) -> None:
        self._outgoing.extend(self._codec.encode(message) for message in messages)
