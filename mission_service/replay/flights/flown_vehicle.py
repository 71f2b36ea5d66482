"""Computes the figures of logged flights, such as distances, speeds and mission times."""

import math
from collections.abc import Callable
from typing import Any

from autopilot_bridge.items import Items
from autopilot_bridge.logs.entries import (
    GripperMoved,
    Log,
    LogEvent,
    MissionLoaded,
    MissionReplaced,
    Outputs,
)
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.client_events import (
    Connected,
    ItemReached,
    LinkLost,
    MissionProgress,
    ModeChanged,
    Position,
)
from mission_service.ground_distance import distance_m
from mission_service.replay.flights.drop_comparison import planned_in
from mission_service.replay.flights.utc_time import utc
from mission_service.runtime.track import Track

MOVES_M_S = 1.0  # a slower vehicle counts as stationary, with a drifting position
SETTLES_US = 3_000_000
FIRST_AUXILIARY, STEP_US = 5, 300  # servos 1 to 4 control the flight


class Flown:
    """The flight of one vehicle in a log, with its figures."""

    def __init__(self, name: str, system_id: int, offset_us: int | None) -> None:
        self.name = name
        self.system_id = system_id
        self.stack: Stack | None = None
        self.track = Track()
        self.missions: list[tuple[int, Items]] = []
        # Times at which a mission was replaced by one whose items are not in the log.
        self.replaced_us: list[int] = []
        self.home: tuple[float, float, float] | None = None
        self.offset_us = offset_us or 0
        self.dated = offset_us is not None
        self._begin_us: int | None = None
        self._end_us = 0
        self._fix: Position | None = None
        self._fix_us: int | None = None
        self.longest_gap_s = 0.0
        self.flown_m = self._max_m_s = 0.0
        self.highest_m: float | None = None  # maximum height above the start
        self.modes: list[tuple[int, str, bool]] = []  # at_us, name, armed
        self.turned_back_us: list[int] = []  # times of jumps to an earlier item of the same mission
        self._current: int | None = None
        self.positions = self.items_reached = 0
        self._pulses: tuple[int, ...] = ()
        self.servo_steps: list[tuple[int, int, int]] = []  # at_us, servo, pulse_us
        self._dropping: set[int] = set()
        self.releases_us: list[int] = []  # times of releases by a gripper
        self.silences: list[tuple[int, int]] = []  # at_us, silent_us

    def apply(self, event: LogEvent, at_us: int) -> None:
        """Process the next event; ``at_us`` is on the flight's clock."""
        self._begin_us = at_us if self._begin_us is None else min(self._begin_us, at_us)
        self._end_us = max(self._end_us, at_us)
        match event:
            case Connected():
                self.stack = event.stack
            case Position():
                self._moved(event, at_us)
            case ModeChanged():
                self.modes.append((at_us, event.name, event.armed))
            case MissionLoaded():
                self.missions.append((at_us, event.items))
                self._dropping |= {drop.output for drop in planned_in(event.items)}
                self._begin_mission(at_us)
            case MissionReplaced():
                self.replaced_us.append(at_us)
                self._begin_mission(at_us)
            case MissionProgress():
                if self._current is not None and event.current_seq < self._current:
                    self.turned_back_us.append(at_us)
                self._current = event.current_seq
            case ItemReached():
                self.items_reached += 1
            case GripperMoved() if event.releases:
                self.releases_us.append(at_us)
            case Outputs():
                self._note_outputs(event, at_us)
            case LinkLost():
                self.silences.append((at_us, event.silent_us))
            case _:
                pass

    def _begin_mission(self, at_us: int) -> None:
        """Begin a new mission; a jump to an earlier item shortly before is part of this change."""
        self._current = None
        if self.turned_back_us and at_us - self.turned_back_us[-1] <= SETTLES_US:
            self.turned_back_us.pop()

    def _note_outputs(self, now: Outputs, at_us: int) -> None:
        """Record the steps of auxiliary servos, and of servos that a mission uses for drops."""
        steps = zip(self._pulses, now.pulse_us, strict=False)
        for number, (before, after) in enumerate(steps, 1):
            if number < FIRST_AUXILIARY and number not in self._dropping:
                continue
            if abs(after - before) >= STEP_US:
                self.servo_steps.append((at_us, number, after))
        self._pulses = now.pulse_us

    def _moved(self, fix: Position, at_us: int) -> None:
        self.positions += 1
        self.track.append_point((at_us, fix.lat_deg, fix.lon_deg, fix.altitude_amsl_m))
        down_m_s = 0.0 if math.isnan(fix.velocity_down_m_s) else fix.velocity_down_m_s
        speed_m_s = math.hypot(fix.velocity_north_m_s, fix.velocity_east_m_s, down_m_s)
        self._max_m_s = max(self._max_m_s, speed_m_s)
        if self.home is None or self._max_m_s < MOVES_M_S:
            # The last position on the ground, because the first positions may lack the altitude.
            self.home = (fix.lat_deg, fix.lon_deg, fix.altitude_amsl_m)
            self.highest_m = None
        above_m = fix.altitude_amsl_m - self.home[2]
        self.highest_m = above_m if self.highest_m is None else max(self.highest_m, above_m)
        before, self._fix = self._fix, fix
        if self._fix_us is not None:
            self.longest_gap_s = max(self.longest_gap_s, (at_us - self._fix_us) / 1e6)
        self._fix_us = at_us
        if before is not None and speed_m_s >= MOVES_M_S:
            self.flown_m += distance_m((before.lat_deg, before.lon_deg), (fix.lat_deg, fix.lon_deg))

    def _since_s(self, at_us: int) -> float:
        return round((at_us - (self._begin_us or 0)) / 1e6, 3)

    def figures(self) -> dict[str, Any]:
        """Return the figures; times are in seconds since the vehicle's first entry in the log."""
        begin_us = self._begin_us or 0
        stack = self.stack
        return {
            "vehicle": self.system_id,
            "name": self.name,
            "autopilot": "unknown" if stack is None else f"{stack.name} {stack.kind}",
            "begin_utc": utc(begin_us + self.offset_us) if self.dated else None,
            "duration_s": round((self._end_us - begin_us) / 1e6, 1),
            "positions": self.positions,
            "flown_m": round(self.flown_m),
            "highest_above_start_m": None if self.highest_m is None else round(self.highest_m, 1),
            "max_speed_m_s": round(self._max_m_s, 1),
            "missions": [
                {"at_s": self._since_s(at_us), "items": len(items)}
                for at_us, items in self.missions
            ],
            "missions_replaced": len(self.replaced_us),
            "items_reached": self.items_reached,
            "turned_back_at_s": [self._since_s(at_us) for at_us in self.turned_back_us],
            "servo_steps": [
                {"at_s": self._since_s(at_us), "servo": servo, "pulse_us": pulse_us}
                for at_us, servo, pulse_us in self.servo_steps
            ],
            "gripper_releases": len(self.releases_us),
            "links_lost": len(self.silences),
            "longest_silence_s": round(max((us for _, us in self.silences), default=0) / 1e6, 1),
            "longest_gap_s": round(self.longest_gap_s, 2),
            "modes": [
                {"at_s": self._since_s(at_us), "mode": name, "armed": armed}
                for at_us, name, armed in self.modes
            ],
        }


def file_of(log: Log) -> str:
    """Return a log's file name; for a journal, the name contains the folder."""
    return f"{log.path.resolve().parent.name}/{log.path.name}" if log.names else log.path.name


def name_of(log: Log, system_id: int) -> str:
    """Return the name of a vehicle in a log."""
    return log.names.get(system_id) or f"{log.path.stem}-{system_id}"


def flown_in(
    log: Log, on_event: Callable[[int, LogEvent], None] = lambda system_id, event: None
) -> dict[int, Flown]:
    """Return all vehicles of a log by system id. Raises BridgeError for an unreadable log.

    ``on_event`` receives the system id and the event of each entry.
    """
    found: dict[int, Flown] = {}
    offset_us = log.unix_offset_us()
    for system_id, event in log.entries():
        if system_id not in found:
            found[system_id] = Flown(name_of(log, system_id), system_id, offset_us)
        found[system_id].apply(event, event.at_us)
        on_event(system_id, event)
    return found


def info_of(log: Log) -> dict[str, Any]:
    """Return the figures of a log, and its damaged parts."""
    flown = flown_in(log)
    return {
        "log": str(log.path),
        "messages": log.messages,
        "damage": [str(each) for each in log.damage],
        "vehicles": [each.figures() for _, each in sorted(flown.items())],
    }
