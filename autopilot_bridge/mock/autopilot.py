"""Simulates one autopilot, which receives bytes, returns datagrams and needs one timer.

The mock has no clock of its own: the times that are passed to it are those of the simulation.
``time_boot_ms`` counts from the first of these times.

A mock has one or more *channels* (telemetry ports), each with its own sequence numbers. Telemetry
and texts are sent on all channels, and a reply on the channel of its request. All channels have the
same message rates.
"""

from collections.abc import Callable
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import waypoint
from autopilot_bridge.links.codec import Codec, Message
from autopilot_bridge.mock.ardupilot_server import ArduPilotServer
from autopilot_bridge.mock.command_server import CommandServer, command_request_of
from autopilot_bridge.mock.failsafe_causes import Battery, GroundStationLink
from autopilot_bridge.mock.flight_model import FlightModel
from autopilot_bridge.mock.ftp_server import FtpServer
from autopilot_bridge.mock.kinematics import CALM, STEP_US, Limits, Wind
from autopilot_bridge.mock.local_frame import LocalFrame, Terrain
from autopilot_bridge.mock.message_intervals import Intervals
from autopilot_bridge.mock.mission_server import MissionServer, client_of, text
from autopilot_bridge.mock.mock_camera import CapturedImage, MockCamera, image_report
from autopilot_bridge.mock.parameter_server import ParameterServer
from autopilot_bridge.mock.payload import Answer, Output, Px4Gripper
from autopilot_bridge.mock.px4_server import Px4Server
from autopilot_bridge.mock.telemetry_sender import TelemetrySender
from autopilot_bridge.stacks.stacks import Stack

COMPONENT = mavlink.MAV_COMP_ID_AUTOPILOT1
# Default values of WPNAV_SPEED_UP and _DN; MPC_Z_V_AUTO_UP and _DN.
LIMITS = {
    ("ardupilot", "copter"): Limits(climb_m_s=2.5, sink_m_s=1.5),
    ("px4", "copter"): Limits(climb_m_s=3.0, sink_m_s=1.5),
}
# After a delay of the process, at most this number of steps is computed at once.
MAX_STEPS_AT_ONCE = 4000


class MockAutopilot:
    """One vehicle, at first disarmed at home; the peer of a ``Connection`` or a ``MemoryLink``.

    Args:
        stack: The autopilot and the kind of vehicle to simulate.
        home: The start position of the vehicle.
        system_id: MAVLink system id, 1 to 255.
        airspeed_m_s: Cruise speed in m/s.
        wind: The speed in m/s, and the direction from which the wind blows.
        terrain: Returns the altitude of the ground (m AMSL) at a latitude and longitude; None means
            flat ground at the altitude of home.
        battery_minutes: Endurance of a full battery in the air; None means that no battery is
            reported.
    """

    def __init__(
        self,
        stack: Stack,
        home: LocalFrame,
        *,
        system_id: int = 1,
        airspeed_m_s: float = 18.0,
        wind: Wind = CALM,
        terrain: Terrain | None = None,
        battery_minutes: float | None = None,
    ) -> None:
        self.stack = stack
        limits = replace(
            LIMITS.get((stack.name, stack.vehicle), Limits()), airspeed_m_s=airspeed_m_s
        )
        self.flight = FlightModel(stack, home, limits, wind, terrain)
        if battery_minutes is not None:
            self.flight.battery = Battery(100.0, battery_minutes * 60.0)
        server = ArduPilotServer if stack.item_0_is_home else Px4Server
        self.missions: MissionServer = server(
            stack, waypoint(home.lat_deg, home.lon_deg, home.altitude_m)
        )
        self.missions.flying_mission = self._flying_mission
        self.missions.current_seq = lambda: self.flight.current
        self.flight.items = tuple(self.missions.items)
        self.ftp = FtpServer(self.missions)
        self._codecs = [Codec(system_id, COMPONENT)]  # of each channel
        self._channel = 0  # of the datagram being received
        self._replying_on = 0  # the channel of the last message with a target
        self._ftp_channel = 0
        self.system_id = system_id
        self._outgoing: list[Message] = []
        self._boot_us: int | None = None
        self._steps = 0
        self.intervals = Intervals(stack)
        self.parameters = ParameterServer(stack, limits)
        self._station = GroundStationLink(stack, self.parameters.value)
        self.flight.returns = self.parameters.return_flight
        self.telemetry = TelemetrySender(stack, self.missions, self.intervals, self._send)
        self._commands = CommandServer(
            stack, self.missions, self.intervals, self.parameters, self._send
        )
        self._gripper = Px4Gripper(self._move_gripper) if stack.name == "px4" else None
        if isinstance(self.missions, Px4Server):
            self.missions.required = lambda: int(self.parameters.value("MIS_TKO_LAND_REQ"))

    @property
    def positions(self) -> bool:
        """Whether the mock has a GPS position to report."""
        return self.flight.gps

    @positions.setter
    def positions(self, available: bool) -> None:
        self.flight.gps = available

    @property
    def outputs(self) -> list[Output]:
        """The switched outputs, each as (time since boot in us, kind, number, value)."""
        return self.flight.payload.outputs

    @property
    def battery_percent(self) -> float | None:
        """The remaining charge in percent; None if no battery is reported."""
        return self.flight.battery.percent

    @battery_percent.setter
    def battery_percent(self, percent: float | None) -> None:
        self.flight.battery.percent = percent

    def replace_battery(self) -> None:
        """Replace the battery with a full one. Raises RuntimeError while the vehicle is armed."""
        if self.flight.armed or self.flight.airborne:
            raise RuntimeError("the battery can be replaced only on the ground and while disarmed")
        self.flight.battery.replace()

    def breach_fence(self, breached: bool) -> None:
        """Set whether the vehicle's fence is breached."""
        self.flight.breach(breached, self._now_s())

    # Data and timers ----------------------------------------------------------------------------

    def open_channels(self, number: int) -> None:
        """Set the number of channels, before the first datagram is sent."""
        self._codecs = [Codec(self.system_id, COMPONENT) for _ in range(number)]

    def receive_on_channel(self, channel: int, data: bytes, now_us: int) -> None:
        """Process a datagram that arrived on a channel."""
        self._channel = channel
        self.receive_data(data, now_us)
        self._channel = 0

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Process a datagram from any ground station."""
        for message in self._codecs[0].decode(data):
            target = getattr(message, "target_system", self.system_id)
            message.channel = self._channel
            broadcast = target == 0 and self.stack.name == "ardupilot"
            if target == self.system_id or broadcast:
                self._receive(message, now_us)

    def data_to_send(self) -> list[bytes]:
        """Remove and return the datagrams to send on a mock's only channel."""
        return [datagram for _, datagram in self.channel_data_to_send()]

    def channel_data_to_send(self) -> list[tuple[int, bytes]]:
        """Remove and return the datagrams to send, each with its channel."""
        if not self._outgoing:
            return []
        outgoing, self._outgoing = self._outgoing, []
        every = range(len(self._codecs))
        return [
            (channel, self._codecs[channel].encode(message))
            for message in outgoing
            for channel in (every if message.channel is None else (message.channel,))
        ]

    def next_timer(self) -> int:
        """Return the time of the next step or of the next repeated request."""
        step_us = 0 if self._boot_us is None else self._boot_us + (self._steps + 1) * STEP_US
        due_us = step_us
        for timer_us in (self.missions.next_timer(), self.ftp.next_timer()):
            if timer_us is not None and timer_us < due_us:
                due_us = timer_us
        return due_us

    def handle_timer(self, now_us: int) -> None:
        """Simulate the flight until now and send the messages that are due."""
        if self._boot_us is None:
            self._boot_us = now_us
        while (due_us := self.missions.next_timer()) is not None and due_us <= now_us:
            self._send(*self.missions.handle_timer(now_us))
            self._apply_mission()
        replies = self.ftp.handle_timer(now_us)
        if replies:
            self._replying_on = self._ftp_channel
            self._send(*replies)
            self._apply_mission()
        due = (now_us - self._boot_us) // STEP_US - self._steps
        for _ in range(min(due, MAX_STEPS_AT_ONCE)):
            self._steps += 1
            self._watch_station()
            self.flight.step(self._now_s())
            if self._gripper is not None:
                self._answer(mavlink.MAV_CMD_DO_GRIPPER, self._gripper.ended(self._now_us()))
            self._photograph()
            self.telemetry.report(self.flight, self._steps)

    def _watch_station(self) -> None:
        """React to the loss of the ground station as the stack's parameters specify."""
        flight, now_s = self.flight, self._now_s()
        reaction = self._station.reaction(
            flight.mode, flight.armed, flight.airborne, flight.lands, flight.failsafe, now_s
        )
        if reaction is not None:
            flight.react(reaction, now_s)

    def fit_camera(self, on_image: Callable[[CapturedImage], None]) -> None:
        """Give the vehicle a camera on a gimbal; ``on_image`` receives each image."""
        self.flight.payload.camera = MockCamera(self.stack, on_image)

    def _photograph(self) -> None:
        """Take an image and report it, if one is due."""
        flight, camera = self.flight, self.flight.payload.camera
        if camera is not None and camera.wants_image(flight.motion, self._now_us()):
            place = flight.frame.global_position(flight.motion)
            image = camera.capture(place, flight.motion, self._now_us())
            self._send(image_report(self.stack, image, flight.motion, flight.frame.altitude_m))

    def send_message(self, message: Message) -> None:
        """Send a message that no station requested, such as a stray acknowledgement."""
        self._send(message)

    def reboot(self, now_us: int) -> None:
        """Restart the autopilot at the current position, disarmed; lists remain, transfers end."""
        self.flight = self.flight.rebooted()
        self.flight.returns = self.parameters.return_flight
        self._station = GroundStationLink(self.stack, self.parameters.value)
        self.missions.forget_transfers()
        self.telemetry.stop_repeats()
        self.intervals.reset()
        self._boot_us, self._steps = now_us, 0

    def _flying_mission(self) -> bool:
        return self.flight.armed and self.flight.mode == "mission"

    def _now_us(self) -> int:
        return self._steps * STEP_US

    def _now_s(self) -> float:
        return self._now_us() / 1e6

    # Messages -----------------------------------------------------------------------------------

    def _receive(self, message: Message, now_us: int) -> None:
        kind = message.get_type()
        self._replying_on = message.channel
        if kind in ("COMMAND_LONG", "COMMAND_INT"):
            self._command(message)
        elif kind == "HEARTBEAT" and message.type == mavlink.MAV_TYPE_GCS:
            self._station.receive_heartbeat(message.get_srcSystem(), self._now_s())
        elif kind == "MISSION_SET_CURRENT":
            self._set_current(message)
        elif kind == "FILE_TRANSFER_PROTOCOL":
            self._ftp_channel = message.channel
            self.ftp.receive(message, now_us)
        elif kind.startswith("PARAM_"):
            self._send(*self.parameters.receive(message))
            self.flight.returns = self.parameters.return_flight
        elif kind.startswith("MISSION_") and hasattr(message, "target_component"):
            self._send(*self.missions.receive(message, now_us))
            self._apply_mission()

    def _apply_mission(self) -> None:
        """Pass a changed list of items to the flight model."""
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
            self._restart()
        if not self.stack.keeps_target and self._flying_mission():
            # PX4 reports the item within a second, or at once if the current item has changed.
            self.telemetry.expect_current(self.missions.start_at, self.flight)
        else:
            self.telemetry.send_current(self.flight)

    def _restart(self) -> None:
        """Start a new mission at once, as PX4 does; loiter if there is no mission."""
        flight = self.flight
        self.telemetry.stop_repeats()
        if flight.mode == "mission" and not flight.items:
            self._send(text(2, "No valid mission available, loitering\t"))
            flight.set_mode("hold", self._now_s())
        flight.make_current(self.missions.start_at, self._now_s())

    def _restart_item(self) -> None:
        """Restart the current item, as ArduCopter does after every change of the mission."""
        flight, missions = self.flight, self.missions
        if flight.current < len(flight.items) and (missions.cut or missions.written):
            flight.go_to(flight.current, self._now_s())
            self.telemetry.send_texts(self.flight)
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
        """Set the current item, which ends a return of PX4.

        PX4 1.17 then flies the mission, but still reports its return; the mock reports the mission.
        """
        requested = max(seq, 1 if self.stack.item_0_is_home else 0)
        self.flight.make_current(requested, self._now_s())
        if self.stack.name == "px4" and self.flight.mode == "rtl":
            self.flight.set_mode("mission", self._now_s())
        self.telemetry.send_current(self.flight, requested)
        self.telemetry.send_texts(self.flight)

    def _command(self, message: Message) -> None:
        request = command_request_of(message)
        requester = (message.get_srcSystem(), message.get_srcComponent())
        if self._gripper is not None and request.command == mavlink.MAV_CMD_DO_GRIPPER:
            action = round(request.params[1])
            self._answer(request.command, self._gripper.operate(action, requester, self._now_us()))
            return
        if self.stack.acks_of(request.command) > 1:  # the first one confirms the receipt
            self._answer(request.command, [(requester, int(mavlink.MAV_RESULT_ACCEPTED))])
        result = self._commands.execute(request, self.flight, self._now_s())
        if request.command == mavlink.MAV_CMD_DO_SET_MISSION_CURRENT and result == 0:
            self._make_current(int(request.params[0]))
        self._answer(request.command, [(requester, result)])

    def _answer(self, command: int, answers: list[Answer]) -> None:
        for requester, result in answers:
            self._send(mavlink.MAVLink_command_ack_message(command, result, 0, 0, *requester))

    def _move_gripper(self, action: int, at_us: int) -> None:
        self.flight.payload.execute(mavlink.MAV_CMD_DO_GRIPPER, (1.0, float(action)), at_us)

    def _send(self, *messages: Message) -> None:
        """Send messages; one with neither a target nor a channel tag is sent on all channels."""
        for message in messages:
            if not hasattr(message, "channel"):
                is_reply = getattr(message, "target_system", 0) != 0
                message.channel = self._replying_on if is_reply else None
        self._outgoing += messages
