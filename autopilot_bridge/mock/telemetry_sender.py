"""Sends the unsolicited messages of the mock: telemetry, texts and progress."""

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.extension_fields import with_extension
from autopilot_bridge.mock import telemetry_source
from autopilot_bridge.mock.command_server import custom_mode_of
from autopilot_bridge.mock.flight_model import FlightModel
from autopilot_bridge.mock.kinematics import STEP_US
from autopilot_bridge.mock.message_intervals import (
    ATTITUDE,
    BATTERY_STATUS,
    EKF,
    ESTIMATOR,
    FENCE,
    GIMBAL,
    GPS,
    LANDED,
    POSITION,
    SERVOS,
    SYS_STATUS,
    VFR_HUD,
    WIND,
    WIND_COV,
    Intervals,
)
from autopilot_bridge.mock.mission_server import MissionServer, text
from autopilot_bridge.mock.mock_camera import gimbal_status
from autopilot_bridge.stacks.stacks import Stack

HEARTBEAT_EVERY_STEPS = 8  # 1 Hz
HOME_EVERY_STEPS = 80


class TelemetrySender:
    """The sender of the messages that are due after each step; ``send`` sends one message."""

    def __init__(
        self,
        stack: Stack,
        missions: MissionServer,
        intervals: Intervals,
        send: Callable[..., None],
    ) -> None:
        self.unhealthy = 0  # bits of the unhealthy sensors in SYS_STATUS
        # The error of a Remote ID module on CAN, which the autopilot reports; None: no module.
        self.remote_id_error: str | None = None
        self._stack = stack
        self._missions = missions
        self._intervals = intervals
        self._send = send
        self._sent_current: object = None
        self._reached = self._reached_again = 0

    def stop_repeats(self) -> None:
        """Stop repeating MISSION_ITEM_REACHED, after a new mission or a reboot."""
        self._reached_again = 0

    def report(self, flight: FlightModel, steps: int) -> None:
        """Send all messages due after a step."""
        self._send_reached(flight, steps)
        self.send_texts(flight)
        if steps % HEARTBEAT_EVERY_STEPS == 1:
            self._heartbeat(flight)
            self._send_remote_id()
            self.send_current(flight)
        elif self._sent_current != (flight.current, *self._missions.progress()):
            self.send_current(flight)
        due = self._intervals.due_in(steps)
        if flight.gps and POSITION in due:
            self._position(flight, steps)
        if due and due != [POSITION]:
            self._instruments(flight, steps, due)
        if steps % HOME_EVERY_STEPS == 1:
            self._home(flight)

    def send_texts(self, flight: FlightModel) -> None:
        """Send the texts about started items, switched outputs and failures."""
        for severity, words in flight.texts:
            self._send(text(severity, words))
        flight.texts.clear()

    def expect_current(self, seq: int, flight: FlightModel) -> None:
        """Send MISSION_CURRENT at once unless item ``seq`` of a new list is current."""
        self._sent_current = (seq, *self._missions.progress())
        if flight.current != seq:
            self.send_current(flight)

    def send_current(self, flight: FlightModel, requested: int | None = None) -> None:
        """Send MISSION_CURRENT for the current item, or for ``requested`` even if skipped."""
        total, ids = self._missions.progress()
        self._sent_current = (flight.current, total, ids)
        px4 = self._stack.name == "px4"
        active = flight.mode == "mission" and flight.armed
        if not flight.items or self._missions.infeasible() is not None:
            state = mavlink.MISSION_STATE_NO_MISSION
        elif active:
            state = mavlink.MISSION_STATE_ACTIVE
        else:
            state = mavlink.MISSION_STATE_NOT_STARTED
        mode = 1 if active else 2 if px4 else 0
        current = mavlink.MAVLink_mission_current_message(
            flight.current if requested is None else requested, total, state, mode
        )
        self._send(with_extension(current, *ids))

    def _send_reached(self, flight: FlightModel, steps: int) -> None:
        """Send MISSION_ITEM_REACHED; PX4 repeats the message ten times, once a second."""
        for seq in flight.reached:
            self._send(mavlink.MAVLink_mission_item_reached_message(seq))
            self._reached, self._reached_again = seq, 10 if self._stack.name == "px4" else 0
        again = self._reached_again and steps % HEARTBEAT_EVERY_STEPS == 1
        if again and not flight.reached:
            self._send(mavlink.MAVLink_mission_item_reached_message(self._reached))
            self._reached_again -= 1
        flight.reached.clear()

    def _heartbeat(self, flight: FlightModel) -> None:
        custom_mode = custom_mode_of(self._stack, flight.mode)
        base_mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        if flight.armed:
            base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        state = telemetry_source.system_status(self._stack, flight)
        self._send(
            mavlink.MAVLink_heartbeat_message(
                self._stack.mav_type, self._stack.autopilot, base_mode, custom_mode, state, 3
            )
        )

    def _send_remote_id(self) -> None:
        if self.remote_id_error is not None:
            self._send(telemetry_source.remote_id(self.remote_id_error))

    def _position(self, flight: FlightModel, steps: int) -> None:
        motion, frame = flight.motion, flight.frame
        lat_deg, lon_deg = frame.global_position(motion)
        self._send(
            mavlink.MAVLink_global_position_int_message(
                steps * STEP_US // 1000,
                round(lat_deg * 1e7),
                round(lon_deg * 1e7),
                round(motion.altitude_m * 1e3),
                round((motion.altitude_m - frame.altitude_m) * 1e3),
                round(motion.speed_m_s * math.cos(motion.course_rad) * 100),
                round(motion.speed_m_s * math.sin(motion.course_rad) * 100),
                round(-motion.climb_m_s * 100),
                round(math.degrees(motion.heading_rad) * 100) % 36000,
            )
        )

    def _instruments(self, flight: FlightModel, steps: int, due: list[int]) -> None:
        boot_us, motion = steps * STEP_US, flight.motion
        if ATTITUDE in due:
            pitch_rad = math.atan2(motion.climb_m_s, max(motion.airspeed_m_s, 1.0))
            angles = (motion.roll_rad, pitch_rad, motion.heading_rad)
            self._send(telemetry_source.attitude(boot_us // 1000, *angles))
        if VFR_HUD in due:
            speeds = (motion.airspeed_m_s, motion.speed_m_s, motion.heading_rad)
            climb = (motion.altitude_m, motion.climb_m_s)
            self._send(telemetry_source.vfr_hud(*speeds, flight.throttle_percent, *climb))
        wind = (flight.wind.from_deg, flight.wind.speed_m_s)
        if WIND in due:
            self._send(telemetry_source.wind(*wind))
        if WIND_COV in due and flight.airborne:
            self._send(telemetry_source.wind_cov(boot_us, *wind, motion.altitude_m))
        charge = flight.battery.percent
        percent = 100 if charge is None else math.ceil(charge)
        if SYS_STATUS in due:
            self._send(telemetry_source.sys_status(percent, flight.battery.volts, self.unhealthy))
        if BATTERY_STATUS in due:
            battery = flight.battery
            used = (battery.current_a(flight.airborne), battery.consumed_mah)
            own_s = battery.remaining_s(flight.airborne) if self._stack.name == "px4" else 0.0
            self._send(telemetry_source.battery_status(percent, battery.volts, *used, own_s))
        if GPS in due:
            place = flight.frame.global_position(motion)
            fix = (3, 10) if flight.gps else (1, 0)
            self._send(telemetry_source.gps_raw(boot_us, *place, motion.altitude_m, *fix))
        if SERVOS in due:
            self._servos(flight, steps)
        if GIMBAL in due and flight.payload.camera is not None:
            self._send(gimbal_status(boot_us // 1000, flight.payload.camera.pitch_deg))
        self._states(flight, steps, due)

    def _states(self, flight: FlightModel, steps: int, due: list[int]) -> None:
        """Send the messages that report failures."""
        boot_us = steps * STEP_US
        if LANDED in due:
            self._send(telemetry_source.landed_state(self._stack, flight))
        if FENCE in due and flight.fence is not None:
            self._send(telemetry_source.fence_status(flight.fence, boot_us // 1000))
        if EKF in due or ESTIMATOR in due:
            flags = telemetry_source.estimator_flags(self._stack, flight.blind_s(boot_us / 1e6))
            if self._stack.name == "px4":
                self._send(telemetry_source.estimator_status(flags, boot_us))
            else:
                self._send(telemetry_source.ekf_status(flags))

    def _servos(self, flight: FlightModel, steps: int) -> None:
        servos = flight.payload.servos_us
        self._send(
            mavlink.MAVLink_servo_output_raw_message(
                steps * STEP_US % 2**32, 0, *servos[:8], *servos[8:]
            )
        )

    def _home(self, flight: FlightModel) -> None:
        frame = flight.frame
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
