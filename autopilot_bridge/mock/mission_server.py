"""The autopilot's side of the mission protocol: the common part of both stacks.

``ardupilot_server.py`` and ``px4_server.py`` have the habits of each.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace

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
    """Holds the three lists; ``changed`` is set when the vehicle has a new mission to fly."""

    def __init__(self, stack: Stack, home: MissionItem) -> None:
        self.stack = stack
        self.constants = stack_constants_of(stack)
        self.lists: Lists = {MISSION: [], FENCE: [], RALLY: []}
        self.changed = False
        self.cleared = False  # by MISSION_CLEAR_ALL
        self.cut = self.written = False  # the mission was shortened, an item was put into it
        self.start_at = 0  # the item to begin a changed mission with
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
        """Answer a message of the mission protocol; answers may also come later."""

    @abstractmethod
    def next_timer(self) -> int | None:
        """Return when to call ``handle_timer``."""

    @abstractmethod
    def handle_timer(self, now_us: int) -> list[Message]:
        """Late answers and repeated requests."""

    @abstractmethod
    def forget_transfers(self) -> None:
        """End all transfers, as a reboot does."""

    @abstractmethod
    def apply_file(self, mission_type: int, items: tuple[MissionItem, ...]) -> None:
        """Take over the items of a file of this type."""

    def progress(self) -> tuple[int, tuple[int, ...]]:
        """MISSION_CURRENT's total, and the opaque ids of the three lists where there are any."""
        return max(len(self.items) - 1, 0), ()

    def infeasible(self) -> str | None:
        """Why the mission cannot be flown though it was accepted."""
        return None

    def busy_with(self, client: Client) -> bool:
        """Return whether a transfer with this client stops others of its messages."""
        del client
        return False

    def _heard(self, messages: list[Message]) -> list[Message]:
        """Return the answers that are sent before the fault ``silent_after`` suppresses the rest."""
        if self.faults.silent_after is None:
            return messages
        told = messages[: self.faults.silent_after]
        self.faults.silent_after -= len(told)
        return told


def client_of(message: Message) -> Client:
    """Return the sender of a message."""
    return message.get_srcSystem(), message.get_srcComponent()


def ack(client: Client, code: int, mission_type: int) -> Message:
    """MISSION_ACK."""
    return mavlink.MAVLink_mission_ack_message(*client, code, mission_type)


def count_message(client: Client, count: int, mission_type: int) -> Message:
    """MISSION_COUNT."""
    return mavlink.MAVLink_mission_count_message(*client, count, mission_type)


def text(severity: int, words: str) -> Message:
    """STATUSTEXT."""
    return mavlink.MAVLink_statustext_message(severity, words.encode())


def item_in(message: Message) -> MissionItem:
    """Return the item of a MISSION_ITEM_INT or of the old MISSION_ITEM (with its position in degrees)."""
    item = item_of(message)
    as_is = message.get_type() == "MISSION_ITEM_INT" or item.frame == mavlink.MAV_FRAME_MISSION
    unit = 1.0 if as_is else 1e7
    return replace(item, x=_whole(message.x * unit), y=_whole(message.y * unit))


def _whole(value: float) -> int:
    """Return a value as MISSION_ITEM_INT's integer; NaN and values out of range are no place."""
    return round(value) if abs(value) < NO_POSITION else NO_POSITION


def item_out(
    client: Client, seq: int, item: MissionItem, current: bool, mission_type: int, as_int: bool
) -> Message:
    """MISSION_ITEM_INT, or the old MISSION_ITEM."""
    message = item_message(client, seq, item, int(current), mission_type)
    if as_int:
        return message
    scale = 1.0 if item.frame == mavlink.MAV_FRAME_MISSION else 1e-7
    return mavlink.MAVLink_mission_item_message(
        *client,
        seq,
        item.frame,
        item.command,
        int(current),
        item.autocontinue,
        item.param1,
        item.param2,
        item.param3,
        item.param4,
        item.x * scale,
        item.y * scale,
        item.z,
        mission_type,
    )
