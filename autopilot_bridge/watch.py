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

AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1
REBOOT_BACK_MS = 5_000
# Message rates asked for when it is heard (ArduCopter streams nothing unasked).
RATES_HZ = (
    (mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 4.0),
    (mavlink.MAVLINK_MSG_ID_MISSION_CURRENT, 1.0),
)


class Watch:
    """``current`` and ``total`` are MISSION_CURRENT's: wire numbers, or None before the first."""

    def __init__(self, heartbeat_timeout_us: int = 3_000_000) -> None:
        self.stack: Stack | None = None
        self.armed = False
        self.custom_mode = 0
        self.current: int | None = None
        self.total: int | None = None
        self._heartbeat_timeout_us = heartbeat_timeout_us
        self._heard_us: int | None = None
        self._lost = False
        self._boot_ms = 0
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
        match message.get_type():
            case "HEARTBEAT":
                return self._heartbeat(message, now_us)
            case "GLOBAL_POSITION_INT":
                return self._position(message, now_us)
            case "MISSION_CURRENT":
                self.total = message.total
                if message.seq != self.current:
                    self.current = message.seq
                    return [MissionProgress(now_us, message.seq - self.hidden_items)]
            case "MISSION_ITEM_REACHED":
                if message.seq != self._reached:
                    self._reached = message.seq
                    return [ItemReached(now_us, message.seq - self.hidden_items)]
            case "STATUSTEXT":
                return [Text(now_us, message.severity, message.text)]
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
        armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        if (armed, message.custom_mode) != (self.armed, self.custom_mode):
            self.armed, self.custom_mode = armed, message.custom_mode
            events.append(ModeChanged(now_us, message.custom_mode, armed))
        return events

    def _position(self, message: Message, now_us: int) -> list[ClientEvent]:
        events: list[ClientEvent] = []
        if message.time_boot_ms < self._boot_ms - REBOOT_BACK_MS:
            self.current = self._reached = None
            events.append(Rebooted(now_us))
        elif message.time_boot_ms <= self._boot_ms:
            return []  # late or doubled on the way
        self._boot_ms = message.time_boot_ms
        heading = message.hdg / 100.0 if message.hdg != 65535 else 0.0
        here = Position(
            now_us,
            message.time_boot_ms * 1000,
            message.lat / 1e7,
            message.lon / 1e7,
            message.alt / 1e3,
            message.relative_alt / 1e3,
            message.vx / 100.0,
            message.vy / 100.0,
            message.vz / 100.0,
            heading,
        )
        return [*events, here]


def rate_requests(target: tuple[int, int]) -> list[Message]:
    """What asks for ``RATES_HZ``; nobody waits for an answer."""
    command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
    return [
        mavlink.MAVLink_command_long_message(
            *target, command, 0, float(message_id), 1e6 / rate_hz, 0.0, 0.0, 0.0, 0.0, 0.0
        )
        for message_id, rate_hz in RATES_HZ
    ]
