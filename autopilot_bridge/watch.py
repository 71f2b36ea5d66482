"""What is known of one vehicle, folded from the messages of its autopilot, sans-IO."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.client_events import (
    ClientEvent,
    Connected,
    ItemReached,
    LinkLost,
    LinkRestored,
    MissionProgress,
    ModeChanged,
    Position,
    Rebooted,
    Text,
)
from autopilot_bridge.codec import Message
from autopilot_bridge.stacks import Stack, stack_of
from autopilot_bridge.telemetry import Telemetry
from autopilot_bridge.vehicle_status import system_state

AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1
FAILSAFES = (
    *(mavlink.MAV_STATE_CRITICAL, mavlink.MAV_STATE_EMERGENCY),
    mavlink.MAV_STATE_FLIGHT_TERMINATION,
)


class Watch:
    """``current`` and ``total`` are MISSION_CURRENT's: wire numbers, or None before the first."""

    def __init__(self, heartbeat_timeout_us: int = 3_000_000) -> None:
        self.stack: Stack | None = None
        self.armed = False
        self.custom_mode = 0
        self.current: int | None = None
        self.total: int | None = None
        self.plan_id: int | None = None  # of the mission on board; ArduPilot has none
        self.unfit = False  # the mission on board is none to fly, or there is none
        self.critical = False  # in failsafe, by its heartbeat
        self._heartbeat_timeout_us = heartbeat_timeout_us
        self._heard_us: int | None = None
        self._lost = False
        self.position: Position | None = None
        self._telemetry = Telemetry()
        self._reached: int | None = None

    @property
    def hidden_items(self) -> int:
        """Items the user does not know of: ArduPilot's home."""
        return 1 if self.stack is not None and self.stack.item_0_is_home else 0

    @property
    def in_mission(self) -> bool:
        """Whether it flies its mission."""
        flies = self.stack is not None and self.custom_mode == self.stack.mission_mode
        return self.armed and flies

    def next_timer(self) -> int | None:
        """When its silence counts as a lost link."""
        if self._heard_us is None or self._lost:
            return None
        return self._heard_us + self._heartbeat_timeout_us

    def handle_timer(self, now_us: int) -> list[ClientEvent]:
        """Tell of a link that is lost."""
        due_us = self.next_timer()
        if due_us is None or self._heard_us is None or now_us < due_us:
            return []
        self._lost = True
        return [LinkLost(now_us, now_us - self._heard_us)]

    def receive(self, message: Message, now_us: int) -> list[ClientEvent]:
        """Take in a message of this vehicle's autopilot."""
        events: list[ClientEvent] = []
        if self._telemetry.rebooted(message):
            self._telemetry.forget()
            self.current = self._reached = None
            events.append(Rebooted(now_us))
        for event in self._telemetry.events(message, now_us):
            if isinstance(event, Position):
                self.position = event
            events.append(event)
        events += self._state(message, now_us)
        return events

    def _state(self, message: Message, now_us: int) -> list[ClientEvent]:
        match message.get_type():
            case "HEARTBEAT":
                return self._heartbeat(message, now_us)
            case "MISSION_CURRENT":
                self.total = message.total
                self.plan_id = getattr(message, "mission_id", 0) or None
                self.unfit = message.mission_state == mavlink.MISSION_STATE_NO_MISSION
                if message.seq != self.current:
                    self.current = message.seq
                    if message.seq < self.hidden_items:  # ArduPilot's home: nothing is flown yet
                        return []
                    return [MissionProgress(now_us, message.seq - self.hidden_items)]
            case "MISSION_ITEM_REACHED":
                # ArduPlane tells of item 0, its home, when it is where GUIDED sent it.
                if message.seq != self._reached and message.seq >= self.hidden_items:
                    self._reached = message.seq
                    return [ItemReached(now_us, message.seq - self.hidden_items)]
            case "STATUSTEXT":
                return [Text(now_us, message.severity, message.text.strip())]  # PX4 adds a tab
            case _:
                pass
        return []

    def _heartbeat(self, message: Message, now_us: int) -> list[ClientEvent]:
        self._heard_us = now_us
        events: list[ClientEvent] = []
        if self.stack is None:
            self.stack = stack_of(message.autopilot, message.type)
            if self.stack is None:
                return []
            events.append(Connected(now_us, self.stack))
        if self._lost:
            self._lost = False
            events.append(LinkRestored(now_us))
        self.critical = message.system_status in FAILSAFES
        armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        if (armed, message.custom_mode) != (self.armed, self.custom_mode):
            self.armed, self.custom_mode = armed, message.custom_mode
            name = self.stack.mode_name(message.custom_mode)
            events.append(ModeChanged(now_us, message.custom_mode, armed, name))
        return [*events, *self._telemetry.news(system_state(message, now_us))]
