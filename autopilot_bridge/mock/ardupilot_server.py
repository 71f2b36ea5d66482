"""Simulates ArduPilot's side of the mission protocol.

Each list has its own transfer. An upload truncates the mission to the new length at once and
overwrites the items one by one. A fence is applied when it is complete. The requests of an upload
are sent on the channel of its MISSION_COUNT.
"""

from collections import deque
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Message
from autopilot_bridge.missions.read_back import as_read_back
from autopilot_bridge.mock.ardupilot_items import fence_fault, judge
from autopilot_bridge.mock.mission_server import (
    ACCEPTED,
    ERROR,
    FENCE,
    MISSION,
    Client,
    MissionServer,
    ack,
    client_of,
    count_message,
    item_in,
    item_out,
    on_channel,
    text,
)
from autopilot_bridge.stacks.stacks import Stack

DENIED = int(mavlink.MAV_MISSION_DENIED)
INFO, WARNING, DEBUG = 6, 4, 7


@dataclass
class Receiving:
    """An active upload."""

    client: Client
    mission_type: int
    count: int
    received_us: int
    requested_us: int
    next_seq: int = 0
    fence: list[MissionItem] = field(default_factory=list)
    channel: int = 0


class ArduPilotServer(MissionServer):
    """ArduPilot's mission server, which processes messages at the next tick of the main loop."""

    _receiving: dict[int, Receiving]

    def __init__(self, stack: Stack, home: MissionItem) -> None:
        super().__init__(stack, home)
        self._receiving = {}
        self._queue: deque[Message] = deque()
        self._tick_us = 0
        self._sent_texts: set[str] = set()

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Queue the message for the next tick."""
        if not self._queue:
            self._tick_us = now_us + self.constants.tick_us
        self._queue.append(message)
        return []

    def next_timer(self) -> int | None:
        """Return the time of the next tick with a message, or of a timeout."""
        timers = [self._tick_us] if self._queue else []
        timers += [self._due_us(receiving) for receiving in self._receiving.values()]
        return min(timers, default=None)

    def handle_timer(self, now_us: int) -> list[Message]:
        """Process one message per tick, repeat unanswered requests, and end overdue transfers."""
        answers: list[Message] = []
        for receiving in list(self._receiving.values()):
            if now_us >= self._due_us(receiving):
                answers += on_channel(receiving.channel, self._overdue(receiving, now_us))
        if self._queue and now_us >= self._tick_us:
            message = self._queue.popleft()
            channel, before = getattr(message, "channel", 0), dict(self._receiving)
            replies = self._answer(message, now_us)
            if message.get_type() in ("MISSION_ITEM_INT", "MISSION_ITEM"):
                begun = before.get(message.mission_type)
                channel = channel if begun is None else begun.channel
            answers += on_channel(channel, replies)
        return self._limited(answers)

    def forget_transfers(self) -> None:
        """End all transfers, as a reboot does; no item is requested afterwards."""
        self._receiving.clear()
        self._queue.clear()

    def apply_file(self, mission_type: int, items: tuple[MissionItem, ...]) -> None:
        """Apply a file's items one by one, up to the first rejected item; no message is sent.

        A mission in flight is not cleared: if the file is shorter, the last old items remain. A
        fence is applied only if it is complete.
        """
        good = []
        for item in items[: self.constants.most[mission_type]]:
            jump = mission_type == MISSION and item.command == mavlink.MAV_CMD_DO_JUMP
            to_nowhere = jump and not 0 < item.param1 < len(items)
            if to_nowhere or judge(item, mission_type, self.stack) != ACCEPTED:
                break
            good.append(item)
        if mission_type == FENCE:
            fence = [as_read_back(item, self.stack, FENCE) for item in good]
            if len(good) == len(items) and fence_fault(fence) is None:
                self.lists[FENCE] = fence
            return
        if mission_type != MISSION or not self.flying_mission():
            self.lists[mission_type] = []
        self.changed |= mission_type == MISSION
        for seq, item in enumerate(good):
            self._put(mission_type, seq, item)

    def _due_us(self, receiving: Receiving) -> int:
        return min(
            receiving.requested_us + self.constants.rerequest_us,
            receiving.received_us + self.constants.gives_up_us,
        )

    def _overdue(self, receiving: Receiving, now_us: int) -> list[Message]:
        if now_us < receiving.received_us + self.constants.gives_up_us:
            return [self._request(receiving, now_us)]
        del self._receiving[receiving.mission_type]
        cancelled = int(mavlink.MAV_MISSION_OPERATION_CANCELLED)
        answers = [ack(receiving.client, cancelled, receiving.mission_type)]
        if receiving.mission_type == MISSION:
            answers.append(text(WARNING, "Mission upload timeout"))
        return answers

    def _answer(self, message: Message, now_us: int) -> list[Message]:
        kind = message.get_type()
        if kind == "MISSION_ACK":
            return []  # ArduPilot also ignores a cancellation
        client, mission_type = client_of(message), message.mission_type
        if mission_type not in self.lists:
            return [ack(client, int(mavlink.MAV_MISSION_UNSUPPORTED), mission_type)]
        match kind:
            case "MISSION_COUNT":
                return self._count(client, message, now_us)
            case "MISSION_ITEM_INT":
                return self._item(client, message, now_us)
            case "MISSION_ITEM":
                answers = self._item(client, message, now_us)
                return answers + self._text_once(
                    "got MISSION_ITEM; GCS should send MISSION_ITEM_INT"
                )
            case "MISSION_REQUEST_LIST":
                if mission_type in self._receiving:
                    return [ack(client, DENIED, mission_type)]
                return [count_message(client, len(self.lists[mission_type]), mission_type)]
            case "MISSION_REQUEST_INT":
                return self._requested(client, message, as_int=True)
            case "MISSION_REQUEST":
                answers = self._requested(client, message, as_int=False)
                return answers + self._text_once("got MISSION_REQUEST; use MISSION_REQUEST_INT!")
            case "MISSION_CLEAR_ALL":
                return self._clear(client, mission_type)
            case _:
                return []

    def _text_once(self, words: str) -> list[Message]:
        """Return a message with the text, or none if the text was sent before."""
        if words in self._sent_texts:
            return []
        self._sent_texts.add(words)
        return [text(WARNING, words)]

    def _count(self, client: Client, message: Message, now_us: int) -> list[Message]:
        mission_type = message.mission_type
        active = self._receiving.get(mission_type)
        if active is not None and active.client != client:
            return [ack(client, DENIED, mission_type)]
        most = self.constants.most[mission_type]
        if message.count > most:
            no_space = ack(client, int(mavlink.MAV_MISSION_NO_SPACE), mission_type)
            return [no_space, text(WARNING, f"Only {most} items are supported")]
        receiving = Receiving(client, mission_type, message.count, now_us, now_us)
        receiving.channel = getattr(message, "channel", 0)
        if mission_type != FENCE:
            self.cut |= mission_type == MISSION and message.count < len(self.items)
            del self.lists[mission_type][message.count :]
        if message.count == 0:
            return self._complete(receiving)
        self._receiving[mission_type] = receiving
        return [self._request(receiving, now_us)]

    def _request(self, receiving: Receiving, now_us: int) -> Message:
        receiving.requested_us = now_us
        return mavlink.MAVLink_mission_request_message(
            *receiving.client, receiving.next_seq, receiving.mission_type
        )

    def _item(self, client: Client, message: Message, now_us: int) -> list[Message]:
        mission_type = message.mission_type
        receiving = self._receiving.get(mission_type)
        if receiving is None:
            return [ack(client, ERROR, mission_type)]
        if receiving.client != client:
            return [ack(client, DENIED, mission_type)]
        if message.seq != receiving.next_seq:
            return [ack(client, int(mavlink.MAV_MISSION_INVALID_SEQUENCE), mission_type)]
        item = item_in(message)
        ordered = self.faults.refuse.get((mission_type, message.seq), ACCEPTED)
        code = ordered or judge(item, mission_type, self.stack)
        if code != ACCEPTED:
            del self._receiving[mission_type]
            return [ack(client, code, mission_type)]
        if mission_type == FENCE:
            receiving.fence.append(as_read_back(item, self.stack, FENCE))
        else:
            self._put(mission_type, message.seq, item)
        receiving.received_us = now_us
        receiving.next_seq += 1
        if receiving.next_seq < receiving.count:
            return [self._request(receiving, now_us)]
        del self._receiving[mission_type]
        return self._complete(receiving)

    def _put(self, mission_type: int, seq: int, item: MissionItem) -> None:
        """Replace an item or append it; item 0 of a mission is always home."""
        held = self.lists[mission_type]
        if mission_type == MISSION and seq == 0:
            kept = self.home
        else:
            kept = as_read_back(item, self.stack, mission_type)
        held[seq : seq + 1] = [kept]
        self.written |= mission_type == MISSION

    def _complete(self, receiving: Receiving) -> list[Message]:
        done = ack(receiving.client, ACCEPTED, receiving.mission_type)
        if receiving.mission_type == MISSION:
            self.changed = True
            return [done, text(INFO, "Flight plan received")]
        if receiving.mission_type != FENCE:
            return [done]
        fault = fence_fault(receiving.fence)
        if fault is not None:
            refused = ack(receiving.client, ERROR, FENCE)
            return [refused, text(*fault), text(WARNING, "Fence validation failed")]
        self.lists[FENCE] = receiving.fence
        return [done, text(DEBUG, "Fence Indexed OK")]

    def _requested(self, client: Client, message: Message, as_int: bool) -> list[Message]:
        mission_type, seq = message.mission_type, message.seq
        if mission_type in self._receiving:
            return [ack(client, DENIED, mission_type)]
        held = self.lists[mission_type]
        if seq < len(held):
            return [item_out(client, seq, held[seq], False, mission_type, as_int)]
        answers = [ack(client, ERROR, mission_type)]
        if mission_type == MISSION:
            answers.insert(0, count_message(client, len(held), mission_type))
        return answers

    def _clear(self, client: Client, mission_type: int) -> list[Message]:
        if mission_type in self._receiving:
            return [ack(client, DENIED, mission_type)]
        if mission_type == MISSION and self.flying_mission():
            return [ack(client, ERROR, mission_type)]
        self.lists[mission_type] = []
        answers = [ack(client, ACCEPTED, mission_type)]
        if mission_type == FENCE:
            answers.append(text(DEBUG, "Fence Indexed OK"))
        if mission_type == MISSION:
            self.changed = self.cleared = True
        return answers
