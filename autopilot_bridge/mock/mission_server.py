"""The autopilot's side of the mission protocol, with the habits of each stack.

PX4 keeps the old mission until the new one is whole; ArduPilot cuts the list to the new length at
once and overwrites it item by item.
"""

import math
from dataclasses import dataclass, field, replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.codec import Message, item_message, item_of
from autopilot_bridge.items import MissionItem
from autopilot_bridge.stacks import Stack

SUPPORTED = (16, 17, 18, 19, 20, 21, 22, 112, 177, 178, 201, 206, 211)
ONLY_ARDUPILOT = (181, 183)
ONLY_PX4 = (187,)
PX4_GIVES_UP_US = 5_000_000
PX4_REFUSES = (18, 177)


@dataclass
class Receiving:
    """An upload under way."""

    client: tuple[int, int]
    mission_type: int
    count: int
    heard_us: int
    asked_us: int
    next_seq: int = 0
    items: list[MissionItem] = field(default_factory=list)


class MissionServer:
    """Holds the mission; ``changed`` is set when a new one has become the vehicle's."""

    def __init__(self, stack: Stack, home: MissionItem) -> None:
        self.stack = stack
        self.items: list[MissionItem] = [home] if stack.item_0_is_home else []
        self.changed = False
        self._home = home
        self._receiving: Receiving | None = None

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Answer a message of the mission protocol."""
        client = (message.get_srcSystem(), message.get_srcComponent())
        match message.get_type():
            case "MISSION_COUNT":
                return self._count(client, message, now_us)
            case "MISSION_ITEM_INT":
                return self._item(client, message, now_us)
            case "MISSION_REQUEST_LIST":
                count = len(self._list(message.mission_type))
                return [mavlink.MAVLink_mission_count_message(*client, count, message.mission_type)]
            case "MISSION_REQUEST_INT" | "MISSION_REQUEST":
                return self._asked(client, message)
            case "MISSION_CLEAR_ALL":
                return self._clear(client, message)
            case "MISSION_ACK" if self._receiving and not self.stack.item_0_is_home:
                if message.type == mavlink.MAV_MISSION_OPERATION_CANCELLED:
                    self._receiving = None  # ArduPilot ignores it
                return []
            case _:
                return []

    def next_timer(self) -> int | None:
        """When to call ``handle_timer``."""
        if self._receiving is None:
            return None
        return self._receiving.asked_us + self.stack.rerequest_us

    def handle_timer(self, now_us: int) -> list[Message]:
        """Ask a silent uploader again, or give up on it."""
        receiving = self._receiving
        if receiving is None or now_us < receiving.asked_us + self.stack.rerequest_us:
            return []
        silent_us = now_us - receiving.heard_us
        if silent_us >= (self.stack.cancels_after_us or PX4_GIVES_UP_US):
            self._receiving = None
            if self.stack.cancels_after_us:
                return [self._ack(receiving, mavlink.MAV_MISSION_OPERATION_CANCELLED)]
            return [mavlink.MAVLink_statustext_message(4, b"Operation timeout")]
        return [self._request(receiving, now_us)]

    def _list(self, mission_type: int) -> list[MissionItem]:
        return self.items if mission_type == mavlink.MAV_MISSION_TYPE_MISSION else []

    def _count(self, client: tuple[int, int], message: Message, now_us: int) -> list[Message]:
        offered = Receiving(client, message.mission_type, message.count, now_us, now_us)
        if message.mission_type != mavlink.MAV_MISSION_TYPE_MISSION:
            return [self._ack(offered, mavlink.MAV_MISSION_UNSUPPORTED)]
        if self._receiving is not None and self._receiving.client != client:
            return [self._ack(offered, mavlink.MAV_MISSION_DENIED)]
        if message.count > self.stack.most_items:
            return [self._ack(offered, mavlink.MAV_MISSION_NO_SPACE)]
        if message.count == 0:
            self._become([])
            return [self._ack(offered, mavlink.MAV_MISSION_ACCEPTED)]
        self._receiving = offered
        if not self.stack.atomic_upload:
            del self.items[message.count :]
        return [self._request(offered, now_us)]

    def _request(self, receiving: Receiving, now_us: int) -> Message:
        receiving.asked_us = now_us
        build = (
            mavlink.MAVLink_mission_request_message
            if self.stack.request_message == "MISSION_REQUEST"
            else mavlink.MAVLink_mission_request_int_message
        )
        return build(*receiving.client, receiving.next_seq, receiving.mission_type)

    def _ack(self, receiving: Receiving, code: int) -> Message:
        return mavlink.MAVLink_mission_ack_message(*receiving.client, code, receiving.mission_type)

    def _item(self, client: tuple[int, int], message: Message, now_us: int) -> list[Message]:
        receiving = self._receiving
        if receiving is None or receiving.client != client:
            if not self.stack.item_0_is_home:
                return []
            stray = Receiving(client, message.mission_type, 0, now_us, now_us)
            return [self._ack(stray, mavlink.MAV_MISSION_ERROR)]
        if message.mission_type != receiving.mission_type:
            return []
        receiving.heard_us = now_us
        if message.seq != receiving.next_seq:
            if self.stack.item_0_is_home:
                return [self._ack(receiving, mavlink.MAV_MISSION_INVALID_SEQUENCE)]
            return [self._request(receiving, now_us)]
        item = item_of(message)
        code = self._judge(item)
        if code != mavlink.MAV_MISSION_ACCEPTED:
            self._receiving = None
            return [self._ack(receiving, code)]
        self._store(receiving, item)
        receiving.next_seq += 1
        if receiving.next_seq < receiving.count:
            return [self._request(receiving, now_us)]
        self._receiving = None
        if self.stack.atomic_upload:
            self._become(receiving.items)
        else:
            self.changed = True
        return [self._ack(receiving, mavlink.MAV_MISSION_ACCEPTED)]

    def _judge(self, item: MissionItem) -> int:
        """Whether the stack takes an item: a MAV_MISSION_RESULT."""
        px4 = self.stack.name == "px4"
        known = (*SUPPORTED, *(ONLY_PX4 if px4 else ONLY_ARDUPILOT))
        if item.command not in known or (px4 and item.command in PX4_REFUSES):
            return int(mavlink.MAV_MISSION_UNSUPPORTED)
        if px4:
            return int(mavlink.MAV_MISSION_ACCEPTED)
        if item.frame in (1, 7):
            return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
        for bad, code in (
            (abs(item.x) > 900_000_000, mavlink.MAV_MISSION_INVALID_PARAM5_X),
            (abs(item.y) > 1_800_000_000, mavlink.MAV_MISSION_INVALID_PARAM6_Y),
            (math.isnan(item.z), mavlink.MAV_MISSION_INVALID_PARAM7),
        ):
            if bad:
                return int(code)
        return int(mavlink.MAV_MISSION_ACCEPTED)

    def _store(self, receiving: Receiving, item: MissionItem) -> None:
        if self.stack.atomic_upload:
            receiving.items.append(item)
            return
        if receiving.next_seq == 0:
            item = self._home
        else:
            item = replace(item, frame={5: 0, 6: 3, 11: 10}.get(item.frame, item.frame))
        if receiving.next_seq < len(self.items):
            self.items[receiving.next_seq] = item
        else:
            self.items.append(item)

    def _become(self, items: list[MissionItem]) -> None:
        self.changed |= items != self.items
        self.items = list(items)

    def apply_file(self, items: tuple[MissionItem, ...], may_clear: bool) -> None:
        """Take over a file's items one by one, up to the first refused; nobody is told.

        A mission being flown is not cleared: a shorter file leaves the old items behind its own.
        """
        if may_clear:
            self.items = []
        self.changed = True
        file = Receiving((0, 0), 0, len(items), 0, 0)
        for item in items[: self.stack.most_items]:
            if self._judge(item) != mavlink.MAV_MISSION_ACCEPTED:
                return
            self._store(file, item)
            file.next_seq += 1

    def _asked(self, client: tuple[int, int], message: Message) -> list[Message]:
        items = self._list(message.mission_type)
        if 0 <= message.seq < len(items):
            item = items[message.seq]
            return [item_message(client, message.seq, item, 0, message.mission_type)]
        bad = Receiving(client, message.mission_type, 0, 0, 0)
        return [self._ack(bad, mavlink.MAV_MISSION_INVALID_SEQUENCE)]

    def _clear(self, client: tuple[int, int], message: Message) -> list[Message]:
        done = Receiving(client, message.mission_type, 0, 0, 0)
        if message.mission_type == mavlink.MAV_MISSION_TYPE_MISSION:
            self._become([self._home] if self.stack.item_0_is_home else [])
        return [self._ack(done, mavlink.MAV_MISSION_ACCEPTED)]
