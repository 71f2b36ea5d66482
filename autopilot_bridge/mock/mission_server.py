"""Contains the part of the autopilot's mission protocol that both stacks share.

``ardupilot_server.py`` and ``px4_server.py`` add the behaviour of each stack.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import asdict, replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import NO_POSITION, MissionItem
from autopilot_bridge.links.codec import Message, item_message, item_of
from autopilot_bridge.mock.fault_kinds import Faults
from autopilot_bridge.mock.stack_constants import stack_constants_of
from autopilot_bridge.stacks.stacks import Stack

MISSION = int(mavlink.MAV_MISSION_TYPE_MISSION)
FENCE = int(mavlink.MAV_MISSION_TYPE_FENCE)
RALLY = int(mavlink.MAV_MISSION_TYPE_RALLY)
ALL = int(mavlink.MAV_MISSION_TYPE_ALL)
ACCEPTED = int(mavlink.MAV_MISSION_ACCEPTED)
ERROR = int(mavlink.MAV_MISSION_ERROR)
VERTICES = (5001, 5002)
INCLUSIONS = (5001, 5003)
CIRCLES = (5003, 5004)

Client = tuple[int, int]
Lists = dict[int, list[MissionItem]]


class MissionServer(ABC):
    """The three lists of a vehicle; ``changed`` is set when the vehicle has a new mission."""

    def __init__(self, stack: Stack, home: MissionItem) -> None:
        self.stack = stack
        self.constants = stack_constants_of(stack)
        self.lists: Lists = {MISSION: [], FENCE: [], RALLY: []}
        self.changed = False
        self.cleared = False  # whether MISSION_CLEAR_ALL removed the mission
        self.cut = self.written = False  # mission truncated; item written
        self.start_at = 0  # the item with which a changed mission begins
        self.faults = Faults()
        self.flying_mission: Callable[[], bool] = lambda: False
        self.current_seq: Callable[[], int] = lambda: 0
        self.home = home

    @property
    def items(self) -> list[MissionItem]:
        """The mission."""
        return self.lists[MISSION]

    @items.setter
    def items(self, items: list[MissionItem]) -> None:
        self.lists[MISSION] = items

    @abstractmethod
    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Process a message of the mission protocol, and return the immediate replies."""

    @abstractmethod
    def next_timer(self) -> int | None:
        """Return the time of the next ``handle_timer`` call."""

    @abstractmethod
    def handle_timer(self, now_us: int) -> list[Message]:
        """Return delayed replies and repeated requests."""

    @abstractmethod
    def forget_transfers(self) -> None:
        """End all transfers, as a reboot does."""

    @abstractmethod
    def apply_file(self, mission_type: int, items: tuple[MissionItem, ...]) -> None:
        """Apply the items of a file of this type."""

    def progress(self) -> tuple[int, tuple[int, ...]]:
        """Return MISSION_CURRENT's total, and the lists' opaque ids if the stack has ids."""
        return max(len(self.items) - 1, 0), ()

    def infeasible(self) -> str | None:
        """Return the reason why an accepted mission cannot be flown, or None."""
        return None

    def busy_with(self, client: Client) -> bool:
        """Return whether a transfer with this client is open, so other messages are rejected."""
        del client
        return False

    def _limited(self, messages: list[Message]) -> list[Message]:
        """Return the messages that the fault ``silent_after`` does not suppress."""
        if self.faults.silent_after is None:
            return messages
        sent = messages[: self.faults.silent_after]
        self.faults.silent_after -= len(sent)
        return sent


def on_channel(channel: int, messages: list[Message]) -> list[Message]:
    """Return the messages; those to a ground station are sent on one channel."""
    for message in messages:
        if hasattr(message, "target_system"):
            message.channel = channel
    return messages


def client_of(message: Message) -> Client:
    """Return the sender of a message."""
    return message.get_srcSystem(), message.get_srcComponent()


def ack(client: Client, code: int, mission_type: int) -> Message:
    """Return a MISSION_ACK."""
    return mavlink.MAVLink_mission_ack_message(*client, code, mission_type)


def count_message(client: Client, count: int, mission_type: int) -> Message:
    """Return a MISSION_COUNT."""
    return mavlink.MAVLink_mission_count_message(*client, count, mission_type)


def text(severity: int, words: str) -> Message:
    """Return a STATUSTEXT."""
    return mavlink.MAVLink_statustext_message(severity, words.encode())


def item_in(message: Message) -> MissionItem:
    """Return the item in a MISSION_ITEM_INT or in an old MISSION_ITEM (position in degrees)."""
    item = item_of(message)
    as_is = message.get_type() == "MISSION_ITEM_INT" or item.frame == mavlink.MAV_FRAME_MISSION
    unit = 1.0 if as_is else 1e7
    return replace(item, x=_whole(message.x * unit), y=_whole(message.y * unit))


def _whole(value: float) -> int:
    """Return a value as an integer for a MISSION_ITEM_INT; NO_POSITION if it is not in range."""
    return round(value) if abs(value) < NO_POSITION else NO_POSITION


def item_out(
    client: Client, seq: int, item: MissionItem, current: bool, mission_type: int, as_int: bool
) -> Message:
    """Return a MISSION_ITEM_INT, or the old MISSION_ITEM."""
    message = item_message(client, seq, item, int(current), mission_type)
    if as_int:
        return message
    scale = 1.0 if item.frame == mavlink.MAV_FRAME_MISSION else 1e-7
    fields = asdict(item) | {"x": item.x * scale, "y": item.y * scale}
    return mavlink.MAVLink_mission_item_message(
        *client, seq, current=int(current), mission_type=mission_type, **fields
    )
