"""Simulates PX4's side of the mission protocol.

The old list remains until the new list is complete. Each link (in the mock, each client on each
channel) has its own state machine, and only one of the machines may receive a list at a time.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Message
from autopilot_bridge.links.extension_fields import with_extension
from autopilot_bridge.missions.read_back import as_read_back
from autopilot_bridge.mock.mission_server import (
    ACCEPTED,
    ALL,
    ERROR,
    FENCE,
    MISSION,
    RALLY,
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
from autopilot_bridge.mock.px4_items import (
    FLOAT_FRAMES,
    checksum,
    first_outside,
    judge,
    missing_item,
    shapes_of,
    usable_shapes,
)
from autopilot_bridge.stacks.stacks import Stack

COMPONENTS = (0, 1, 190)  # all components, the autopilot, the "mission planner"
CRITICAL = 2
FENCE_CHECK_US = 480_000  # the fence is checked about half a second after a change


@dataclass
class Manager:
    """The state machine of one link."""

    client: Client
    state: Literal["idle", "getting", "sending"] = "idle"
    mission_type: int = MISSION
    as_int: bool = True
    seq: int = 0  # the item expected next, or to be requested next
    count: int = 0
    received_us: int = 0
    requested_us: int = 0
    checksum: int = 0
    start_at: int = 0
    items: list[MissionItem] = field(default_factory=list)
    channel: int = 0


def critical(words: str) -> Message:
    """Return a text with the tab that PX4 appends to texts that are also sent as events."""
    return text(CRITICAL, words + "\t")


class Px4Server(MissionServer):
    """PX4's mission server; ``required`` returns the value of MIS_TKO_LAND_REQ."""

    def __init__(self, stack: Stack, home: MissionItem) -> None:
        super().__init__(stack, home)
        self.required: Callable[[], int] = lambda: 0
        self.ids = {MISSION: 0, FENCE: 0, RALLY: 0}
        self._managers: dict[tuple[Client, int], Manager] = {}  # by client and channel
        self._check_us: int | None = None
        self._reason: str | None = None

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Process a message, and return the replies."""
        if message.target_component not in COMPONENTS:
            return []
        client, channel = client_of(message), getattr(message, "channel", 0)
        manager = self._managers.setdefault((client, channel), Manager(client, channel=channel))
        return self._limited(on_channel(channel, self._answer(manager, message, now_us)))

    def next_timer(self) -> int | None:
        """Return the time of the next action: a repeated request, a timeout or a fence check."""
        due_us = self._check_us
        for manager in self._managers.values():
            if manager.state != "idle":
                manager_us = self._due_us(manager)
                due_us = manager_us if due_us is None else min(due_us, manager_us)
        return due_us

    def handle_timer(self, now_us: int) -> list[Message]:
        """Repeat unanswered requests, end overdue transfers, and check a new fence."""
        answers: list[Message] = []
        for manager in self._managers.values():
            if manager.state == "idle" or now_us < self._due_us(manager):
                continue
            if now_us >= manager.received_us + self.constants.gives_up_us:
                manager.state = "idle"
                answers.append(critical("Operation timeout"))
            else:
                answers += on_channel(manager.channel, [self._request(manager, now_us)])
        if self._check_us is not None and now_us >= self._check_us:
            self._check_us = None
            answers += self._check_fence()
        return self._limited(answers)

    def forget_transfers(self) -> None:
        """End all transfers, as a reboot does; no item is requested afterwards."""
        self._managers.clear()

    def apply_file(self, mission_type: int, items: tuple[MissionItem, ...]) -> None:
        """Raise NotImplementedError: PX4 has no mission files."""
        raise NotImplementedError

    def progress(self) -> tuple[int, tuple[int, ...]]:
        """Return the number of items (65535 without a mission) and the ids of the lists."""
        return len(self.items) or 65535, tuple(self.ids.values())

    def infeasible(self) -> str | None:
        """Return the reason why an accepted mission cannot be flown, or None."""
        return missing_item(self.items, self.required()) or self._reason

    def busy_with(self, client: Client) -> bool:
        """Return whether a transfer with this client is open."""
        managers = self._managers.values()
        return any(each.client == client and each.state != "idle" for each in managers)

    def _due_us(self, manager: Manager) -> int:
        gives_up_us = manager.received_us + self.constants.gives_up_us
        if manager.state == "sending":
            return gives_up_us
        return min(gives_up_us, manager.requested_us + self.constants.rerequest_us)

    def _answer(self, manager: Manager, message: Message, now_us: int) -> list[Message]:
        match message.get_type():
            case "MISSION_COUNT":
                return self._count(manager, message, now_us)
            case "MISSION_ITEM_INT" | "MISSION_ITEM":
                manager.as_int = message.get_type() == "MISSION_ITEM_INT"
                return self._item(manager, message, now_us)
            case "MISSION_REQUEST_LIST":
                return self._listed(manager, message, now_us)
            case "MISSION_REQUEST_INT" | "MISSION_REQUEST":
                manager.as_int = message.get_type() == "MISSION_REQUEST_INT"
                return self._requested(manager, message, now_us)
            case "MISSION_CLEAR_ALL":
                return self._clear(manager, message.mission_type, now_us)
            case "MISSION_ACK":
                return self._acknowledged(manager, message, now_us)
            case _:
                return []

    # Uploads ------------------------------------------------------------------------------------

    def _count(self, manager: Manager, message: Message, now_us: int) -> list[Message]:
        client, mission_type = manager.client, message.mission_type
        if manager.state == "sending":
            busy = critical("WPM: IGN MISSION_COUNT: Busy")
            return [ack(client, ERROR, manager.mission_type), busy]
        if manager.state == "getting":
            manager.received_us = now_us
            if manager.seq > 0:
                return [ack(client, ERROR, manager.mission_type), critical("WPM: REJ. CMD: Busy")]
            return [self._request(manager, now_us)]
        if any(other.state == "getting" for other in self._managers.values()):
            return [ack(client, ERROR, mission_type)]
        manager.mission_type = mission_type
        most = self.constants.most[mission_type] if mission_type in self.lists else 0
        if message.count > most:
            return [ack(client, int(mavlink.MAV_MISSION_NO_SPACE), mission_type)]
        if message.count == 0:
            if mission_type in self.lists:
                self._replace(mission_type, [], 0, 0, now_us)
            return [ack(client, ACCEPTED, mission_type)]
        fresh = Manager(client, "getting", mission_type, manager.as_int, 0, message.count, now_us)
        fresh.channel = manager.channel
        self._managers[client, manager.channel] = fresh
        return [self._request(fresh, now_us)]

    def _request(self, manager: Manager, now_us: int) -> Message:
        manager.requested_us = now_us
        build = (
            mavlink.MAVLink_mission_request_int_message
            if manager.as_int
            else mavlink.MAVLink_mission_request_message
        )
        return build(*manager.client, manager.seq, manager.mission_type)

    def _item(self, manager: Manager, message: Message, now_us: int) -> list[Message]:
        client, mission_type = manager.client, manager.mission_type
        if message.mission_type != mission_type:
            return [ack(client, ERROR, mission_type)]
        if manager.state == "sending":
            return [ack(client, ERROR, mission_type), critical("IGN MISSION_ITEM: Busy")]
        if manager.state == "idle":
            if manager.seq == message.seq + 1:  # the last item came again, because its ACK was lost
                return [with_extension(ack(client, ACCEPTED, mission_type), manager.checksum)]
            return [ack(client, ERROR, mission_type), critical("IGN MISSION_ITEM: No transfer")]
        manager.received_us = now_us
        if message.seq != manager.seq:
            return []
        item = item_in(message)
        ordered = self.faults.refuse.get((mission_type, message.seq), ACCEPTED)
        code = ordered or judge(item, mission_type, self.stack)
        if code != ACCEPTED:
            manager.state = "idle"
            texts = [] if code == ERROR else [critical("IGN MISSION_ITEM: Invalid item")]
            return [ack(client, code, mission_type), *texts]
        manager.items.append(as_read_back(item, self.stack, mission_type))
        manager.checksum = checksum(message, manager.checksum)
        if message.current:
            manager.start_at = message.seq
        manager.seq += 1
        if manager.seq < manager.count:
            return [self._request(manager, now_us)]
        manager.state = "idle"
        if manager.checksum != self.ids[mission_type]:
            self._replace(mission_type, manager.items, manager.checksum, manager.start_at, now_us)
        return [with_extension(ack(client, ACCEPTED, mission_type), manager.checksum)]

    def _replace(
        self, mission_type: int, items: list[MissionItem], plan_id: int, start_at: int, now_us: int
    ) -> None:
        self.lists[mission_type] = items
        self.ids[mission_type] = plan_id
        if mission_type == MISSION:
            self.changed = True
            self.start_at = start_at
            self._check_mission()
        if mission_type == FENCE or self._reason is not None:
            self._check_us = now_us + FENCE_CHECK_US

    def _clear(self, manager: Manager, mission_type: int, now_us: int) -> list[Message]:
        if manager.state != "idle":
            return [critical("WPM: IGN CLEAR CMD: Busy")]
        manager.mission_type = mission_type
        for kind in self.lists if mission_type == ALL else (mission_type,):
            if kind in self.lists:
                self._replace(kind, [], 0, 0, now_us)
        return [ack(manager.client, ACCEPTED, mission_type)]

    # Downloads ----------------------------------------------------------------------------------

    def _listed(self, manager: Manager, message: Message, now_us: int) -> list[Message]:
        mission_type = message.mission_type
        done = manager.state == "sending" and manager.seq == manager.count
        free = manager.state == "idle" or done
        if not free and (manager.state == "getting" or manager.mission_type != mission_type):
            return [text(6, "Mission download request ignored, already active\t")]
        manager.state, manager.mission_type = "sending", mission_type
        manager.received_us, manager.seq = now_us, 0
        manager.count = len(self.lists.get(mission_type, []))
        counted = count_message(manager.client, manager.count, mission_type)
        return [with_extension(counted, self.ids.get(mission_type, 0))]

    def _requested(self, manager: Manager, message: Message, now_us: int) -> list[Message]:
        if manager.state == "idle":
            return []
        if manager.state == "getting":
            return [critical("WPM: REJ. CMD: Busy")]
        mission_type, seq = manager.mission_type, message.seq
        if message.mission_type != mission_type:
            return []
        manager.received_us = now_us
        items = self.lists.get(mission_type, [])
        if seq not in (manager.seq, manager.seq - 1) or not 0 <= seq < len(items):
            manager.state = "idle"
            unexpected = critical("WPM: REJ. CMD: Req. WP was unexpected")
            return [ack(manager.client, ERROR, mission_type), unexpected]
        manager.seq = seq + 1
        item = items[seq]
        if not manager.as_int:
            item = replace(item, frame=FLOAT_FRAMES.get(item.frame, item.frame))
        current = seq == self.current_seq()
        return [item_out(manager.client, seq, item, current, mission_type, manager.as_int)]

    def _acknowledged(self, manager: Manager, message: Message, now_us: int) -> list[Message]:
        if manager.state == "sending" and message.mission_type == manager.mission_type:
            manager.state = "idle"
        elif manager.state == "getting":
            if message.type == mavlink.MAV_MISSION_OPERATION_CANCELLED:
                manager.state = "idle"
            elif message.type == mavlink.MAV_MISSION_UNSUPPORTED:
                manager.as_int = not manager.as_int
                return [self._request(manager, now_us)]
        return []

    # Feasibility --------------------------------------------------------------------------------

    def _check_mission(self) -> list[Message]:
        """Check the mission against the fence, and return the texts to send."""
        scale = math.cos(math.radians(self.home.x / 1e7))
        shapes = usable_shapes(self.lists[FENCE], (self.home.x, self.home.y), scale)
        outside = first_outside(self.items, shapes, scale)
        if outside is None:
            self._reason = None
            return []
        self._reason = f"Geofence violation for waypoint {outside + 1}"
        return [critical(self._reason)]

    def _check_fence(self) -> list[Message]:
        scale = math.cos(math.radians(self.home.x / 1e7))
        fence = self.lists[FENCE]
        texts = self._check_mission()
        if len(usable_shapes(fence, (self.home.x, self.home.y), scale)) < len(shapes_of(fence)):
            texts.append(critical("Geofence invalid, doesn't contain Home position"))
        return texts
