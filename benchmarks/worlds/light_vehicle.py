"""Vehicles of light worlds: the flight of the mock autopilot without MAVLink.

Commands of the core take effect after a delay, and are refused or lost in troubles. ``controlled``
is the truth for the checker: whether the service has control of the vehicle.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from autopilot_bridge.items import MissionItem, waypoint
from autopilot_bridge.mock.autopilot import LIMITS
from autopilot_bridge.mock.flight_model import FlightModel, Mode
from autopilot_bridge.mock.kinematics import Limits, Wind
from autopilot_bridge.mock.local_frame import LocalFrame
from autopilot_bridge.stacks.stacks import stack_named
from benchmarks.worlds.random_world import Trouble
from mission_service import events
from mission_service.commands import (
    ORDER_NAMES,
    AnyCommand,
    ChangeSpeed,
    ClimbAndHold,
    GoAround,
    Hold,
    HoldAt,
    Land,
    Orbit,
    Return,
    StartMission,
    UploadMission,
)
from mission_service.config.sections import VehicleSection

MODE_NAMES = {"rtl": "return", "idle": "hold"}
SILENT_S = 5.0  # the loss of the link is reported after this time
REACTS_S = 12.0  # until the autopilot reacts to the loss of the link
ANSWERS_WITHIN_S = 8.0  # commands and uploads fail after this time without a link
FAILSAFES: dict[str, Mode] = {"failsafe: return": "rtl", "failsafe: hold": "hold"}
LINK_LOST: dict[str, Mode | None] = {
    "link lost": None,
    "link lost, returns": "rtl",
    "link lost, holds": "hold",
}


@dataclass
class Sent:
    """A command under way, or an upload, which takes effect at ``due_s``."""

    command: AnyCommand
    due_s: float


@dataclass
class LightVehicle:
    """One vehicle, at first on the ground at its home."""

    section: VehicleSection
    home_amsl_m: float
    wind: Wind
    troubles: list[Trouble]
    random: np.random.Generator
    controlled: bool = True
    linked: bool = True
    failing: set[str] = field(default_factory=set)  # kinds of trouble that last
    _sent: list[Sent] = field(default_factory=list)
    _resumes: bool = False  # ArduPilot holds for an upload, and then flies on
    _reported: tuple[str, bool] = ("", False)
    _seq: int = 0
    _events: list[events.VehicleEvent] = field(default_factory=list)  # of the autopilot
    _station: list[events.VehicleEvent] = field(default_factory=list)  # of the service's client
    _loss_reported: bool = False
    _timed: list[tuple[float, str]] = field(default_factory=list)
    flight: FlightModel = field(init=False)

    def __post_init__(self) -> None:
        section = self.section
        stack = stack_named(section.stack, section.kind)
        limits = LIMITS.get((section.stack, section.kind), Limits())
        frame = LocalFrame(section.home_lat_deg, section.home_lon_deg, self.home_amsl_m)
        cruise = Limits(
            section.airspeed_m_s,
            max_airspeed_m_s=max(section.max_airspeed_m_s, section.airspeed_m_s),
            climb_m_s=limits.climb_m_s,
            sink_m_s=limits.sink_m_s,
        )
        self.flight = FlightModel(stack, frame, cruise, self.wind)
        for trouble in self.troubles:
            self._timed.append((trouble.from_s, f"+{trouble.kind}"))
            self._timed.append((trouble.until_s, f"-{trouble.kind}"))
            if LINK_LOST.get(trouble.kind) and trouble.until_s - trouble.from_s > REACTS_S:
                self._timed.append((trouble.from_s + REACTS_S, f"!{trouble.kind}"))
            if trouble.kind in LINK_LOST and trouble.until_s - trouble.from_s > SILENT_S:
                self._timed.append((trouble.from_s + SILENT_S, "silent"))
        self._timed.sort()

    @property
    def name(self) -> str:
        """The vehicle's name."""
        return self.section.name

    @property
    def _first(self) -> int:
        return 1 if self.flight.stack.item_0_is_home else 0

    def connected(self, now_us: int) -> events.VehicleConnected:
        """Return the event of the first heartbeat."""
        stack = self.flight.stack
        words = f"{stack.name} {stack.kind}"
        return events.VehicleConnected(now_us, self.name, words, stack.atomic_upload)

    def telemetry(self, now_us: int) -> events.Telemetry:
        """Return the report of the position."""
        motion, frame = self.flight.motion, self.flight.frame
        lat_deg, lon_deg = frame.global_position(motion)
        return events.Telemetry(
            now_us,
            self.name,
            round(lat_deg, 7),
            round(lon_deg, 7),
            round(motion.altitude_m, 3),
            round(motion.altitude_m - frame.altitude_m, 3),
            motion.speed_m_s * math.cos(motion.course_rad),
            motion.speed_m_s * math.sin(motion.course_rad),
            math.degrees(motion.heading_rad) % 360.0,
        )

    def execute(self, command: AnyCommand, now_s: float) -> None:
        """Send a command; its effect and its outcome follow."""
        if isinstance(command, UploadMission):
            for sent in [each for each in self._sent if isinstance(each.command, UploadMission)]:
                self._sent.remove(sent)
                self._upload_ended(sent.command, "superseded", "another mission", now_s)
            self._sent.append(Sent(command, now_s + float(self.random.uniform(0.7, 3.0))))
            self._pause(now_s)
        elif type(command) in ORDER_NAMES:
            self._sent.append(Sent(command, now_s + float(self.random.uniform(0.1, 0.6))))

    def step(self, now_s: float) -> Iterator[events.VehicleEvent]:
        """Compute one time step and yield the events that result."""
        while self._timed and self._timed[0][0] <= now_s:
            self._befall(self._timed.pop(0)[1], now_s)
        for sent in [each for each in self._sent if each.due_s <= now_s]:
            self._arrive(sent, now_s)
        self.flight.step(now_s)
        self.flight.reached.clear()
        self.flight.texts.clear()
        found, self._station = self._station, []
        yield from found
        if self.linked:
            self._report(now_s)
            found, self._events = self._events, []
            yield from found

    # Troubles ---------------------------------------------------------------------------------

    def _befall(self, what: str, now_s: float) -> None:
        flight, kind, at_us = self.flight, what[1:], round(now_s * 1e6)
        if what == "silent":
            if not (self.linked or self._loss_reported):
                self._loss_reported = True
                self._station.append(events.LinkLost(at_us, self.name, SILENT_S))
            return
        if what[0] == "-":
            self._end(kind, now_s)
            return
        if what[0] == "!":
            mode = LINK_LOST[kind]
            if not self.linked and flight.airborne and mode is not None:
                self._change(mode, now_s)
            return
        self.failing.add(kind)
        if kind in LINK_LOST:
            self.linked = False
        elif not flight.airborne:
            return
        elif kind in FAILSAFES:
            self._change(FAILSAFES[kind], now_s)
            self._events.append(events.SystemStateChanged(at_us, self.name, "critical"))
        elif kind == "pilot holds":
            self._change("hold", now_s)
        elif kind == "reboot":
            self._sent.clear()
            self._resumes = False
            self._reported = ("", False)
            self._events.append(events.VehicleRebooted(at_us, self.name))
            self._change("hold", now_s)
        elif kind == "no fix":
            self._events.append(events.GpsFixChanged(at_us, self.name, False, "no fix"))

    def _end(self, kind: str, now_s: float) -> None:
        self.failing.discard(kind)
        at_us = round(now_s * 1e6)
        if kind in LINK_LOST and not self.linked and not self.failing & LINK_LOST.keys():
            self.linked = True
            if self._loss_reported:
                self._station.append(events.LinkRestored(at_us, self.name))
                self._loss_reported = False
        elif kind in FAILSAFES:
            self._events.append(events.SystemStateChanged(at_us, self.name, "active"))
        elif kind == "no fix":
            self._events.append(events.GpsFixChanged(at_us, self.name, True, "3d"))

    def _change(self, mode: Mode, now_s: float) -> None:
        """Change the mode without a command of the service."""
        self.flight.set_mode(mode, now_s)
        self.controlled = False
        self._resumes = False

    @property
    def is_led(self) -> bool:
        """Whether the service can lead the vehicle: link, fix, and no mode chosen by others."""
        helpless = {"no fix", "refuses commands", "refuses uploads", *FAILSAFES} & self.failing
        return self.controlled and self.linked and not helpless

    # Commands ---------------------------------------------------------------------------------

    def _arrive(self, sent: Sent, now_s: float) -> None:
        command = sent.command
        is_upload = isinstance(command, UploadMission)
        if not self.linked:
            if now_s >= sent.due_s + ANSWERS_WITHIN_S:
                self._sent.remove(sent)
                self._finished(command, False, "no answer", now_s)
            return
        self._sent.remove(sent)
        if f"refuses {'uploads' if is_upload else 'commands'}" in self.failing:
            self._finished(command, False, "denied", now_s)
            if is_upload and self.flight.airborne and self.flight.mode == "mission":
                self.flight.set_mode("hold", now_s)  # PX4 loiters after a refused mission
            return
        if isinstance(command, UploadMission):
            self._take(command, now_s)
        else:
            refusal = self._obey(command, now_s)
            self._finished(command, not refusal, refusal, now_s)

    def _finished(self, command: AnyCommand, accepted: bool, reason: str, now_s: float) -> None:
        if isinstance(command, UploadMission):
            self._upload_ended(command, "accepted" if accepted else "rejected", reason, now_s)
            return
        name, at_us = ORDER_NAMES[type(command)], round(now_s * 1e6)
        self._station.append(events.CommandFinished(at_us, self.name, name, accepted, reason))

    def _upload_ended(self, command: AnyCommand, outcome: str, reason: str, now_s: float) -> None:
        assert isinstance(command, UploadMission)
        number, at_us = command.mission_id, round(now_s * 1e6)
        self._station.append(events.UploadFinished(at_us, self.name, number, outcome, reason))

    def _pause(self, now_s: float) -> None:
        """Hold for an upload, as ArduPilot does, because its list is overwritten."""
        flight = self.flight
        if self._first and flight.airborne and flight.mode == "mission" and self.linked:
            flight.set_mode("hold", now_s)
            self._resumes = True

    def _take(self, command: UploadMission, now_s: float) -> None:
        """Put a mission on board."""
        flight = self.flight
        home = waypoint(flight.frame.lat_deg, flight.frame.lon_deg, flight.frame.altitude_m)
        items: tuple[MissionItem, ...] = (home, *command.items) if self._first else command.items
        flight.items, flight.current = items, self._first
        if flight.mode == "mission":
            flight.make_current(self._first, now_s)
        elif self._resumes and flight.mode == "hold":
            flight.set_mode("mission", now_s)
        self._resumes = False
        self._finished(command, True, "", now_s)

    def _obey(self, command: AnyCommand, now_s: float) -> str:
        """Execute a command; return the reason for a refusal, or an empty text."""
        flight, motion = self.flight, self.flight.motion
        here = (motion.north_m, motion.east_m)
        guided: Mode = "hold" if flight.stack.name == "px4" else "guided"
        match command:
            case ChangeSpeed():
                flight.change_speed(0, command.airspeed_m_s)
                return ""
            case StartMission() | Land():
                if len(flight.items) <= self._first:
                    return "no mission"
                flight.armed = flight.armed or isinstance(command, StartMission)
                flight.set_mode("mission", now_s)
            case Hold():
                flight.set_mode("hold", now_s)
                flight.fly_around(here, motion.altitude_m, self.section.loiter_radius_m)
            case Return():
                flight.set_mode("rtl", now_s)
            case GoAround() if (flight.stack.name, flight.stack.vehicle) == ("ardupilot", "plane"):
                if not flight.go_around(now_s):
                    return "it is not landing"
            case GoAround() | ClimbAndHold() | HoldAt() | Orbit():
                if not flight.airborne:
                    return "on the ground"
                radius_m = self.section.loiter_radius_m
                radius_m = command.radius_m if isinstance(command, Orbit) else radius_m
                flight.set_mode(guided, now_s)
                place = flight.frame.local_of(command.lat_deg, command.lon_deg)
                flight.fly_around(place, command.altitude_amsl_m, radius_m)
            case _:
                return "unknown command"
        self.controlled, self._resumes = True, False
        return ""

    def _report(self, now_s: float) -> None:
        """Report changes of the mode and of the current item."""
        flight, at_us = self.flight, round(now_s * 1e6)
        mode = (MODE_NAMES.get(flight.mode, flight.mode), flight.armed)
        if mode != self._reported:
            self._reported = mode
            self._events.append(events.ModeChanged(at_us, self.name, 0, mode[1], mode[0]))
        seq = max(flight.current - self._first, 0)
        if seq != self._seq:
            self._seq = seq
            self._events.append(events.MissionProgress(at_us, self.name, seq))
