"""What UAVs of a formation tell each other, over MQTT: one process a vehicle, or several of them.

Nothing here waits for a broker. What is said goes into a short queue, in which a newer state takes
the place of an older one; what is lost, maps heal by their digests. While there is no broker all
circle on where they are: whoever moved would not know who is in its way.
"""

import asyncio
import contextlib
import logging
import re
from collections import Counter, deque
from collections.abc import Collection
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import aiomqtt
import msgspec

from mission_service.config.mqtt_names import Broker, check_prefix, read_broker, site_of, site_topic
from mission_service.config.service import MqttSection
from mission_service.interfaces.mqtt.connection import (
    MOST_WAIT_S,
    OPEN,
    TAKE_S,
    Access,
    client_to,
    keep_connected,
    together,
)
from mission_service.interfaces.mqtt.site import access_for
from mission_service.peer_messages import AnyMessage, Difference, Digest, State

MOST_WAITING = 200  # messages to go out, besides states
MOST_UNREAD = 2000
READ_S = 0.02  # between one look at what has come and the next
TIME = "time"  # a kind of its own: mission time of a process, in microseconds
TIME_EVERY_S, TIME_LEAST_S, JOIN_S = 1.0, 0.2, 2.0
BEHIND_US = 10_000_000  # who has only just been held up is told nothing
OVERTAKEN = ("/state", f"/{TIME}")  # the newest message of these is all that counts
AHEAD_US = 60_000_000  # of one who talks, others may be

_encode = msgspec.json.Encoder().encode
_decode = msgspec.json.Decoder(AnyMessage).decode


@dataclass(frozen=True, slots=True)
class Channel:
    """Where the vehicles of one site meet."""

    broker: Broker
    prefix: str
    site: str
    access: Access = OPEN

    def topic(self, vehicle: str, kind: str) -> str:
        """Where messages of one kind from one vehicle are to be heard; both may be ``+``."""
        return f"{site_topic(self.prefix, self.site)}/formation/{vehicle}/{kind}"


class UnfitError(Exception):
    """A message that none of this formation's vehicles can have sent."""


def channel_of(
    broker: str, prefix: str, scenario_name: str, settings: MqttSection | None = None
) -> Channel:
    """Where the vehicles of a scenario meet. Raises MissionServiceError for what is none.

    Who we are to the broker the settings say, if it is theirs.
    """
    where = read_broker(broker)
    access = access_for(where, settings)
    return Channel(where, check_prefix(prefix), site_of(scenario_name), access)


def encoded(message: AnyMessage) -> tuple[str, bytes]:
    """A message as it is sent: its kind, the last level of its topic, and JSON."""
    return type(message).__name__.lower(), _encode(message)


def decoded(vehicle: str, payload: bytes, latest_us: int) -> AnyMessage:
    """What ``vehicle`` has said, at ``latest_us`` of mission time at the latest.

    Raises UnfitError for what it cannot have said. Whether cells are on the map, the map looks.
    """
    try:
        message: AnyMessage = _decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise UnfitError(f"a message that cannot be read: {error}") from None
    if message.sender != vehicle:
        raise UnfitError(f"a message of {message.sender}")
    if message.at_us > latest_us:
        raise UnfitError(f"a message of mission time {message.at_us / 1e6:.0f} s")
    if isinstance(message, Difference):
        seen_us = max((at_us for _, _, at_us, _ in message.cells), default=0)
        if seen_us > message.at_us + AHEAD_US:
            raise UnfitError(f"cells seen at {seen_us / 1e6:.0f} s, which is later")
    return message


def decoded_time(payload: bytes, latest_us: int) -> int:
    """Mission time as another process has it. Raises UnfitError for what is none."""
    if re.fullmatch(rb"[0-9]{1,16}", payload) is None or int(payload) > latest_us:
        raise UnfitError("a time that is none of this mission")
    return int(payload)


class Outbox:
    """What is still to be sent, the newest states first; of the rest the oldest is dropped."""

    def __init__(self) -> None:
        self._states: dict[str, AnyMessage] = {}  # by sender
        self._digests: dict[str, AnyMessage] = {}
        self._rest: deque[AnyMessage] = deque(maxlen=MOST_WAITING)
        self.is_not_empty = asyncio.Event()

    def put(self, message: AnyMessage) -> None:
        """A state or digest takes the place of an older one."""
        if isinstance(message, State):
            self._states[message.sender] = message
        elif isinstance(message, Digest):
            self._digests[message.sender] = message
        else:
            self._rest.append(message)
        self.is_not_empty.set()

    def take(self) -> AnyMessage | None:
        """The next to be sent, if any."""
        if self._states:
            return self._states.pop(next(iter(self._states)))
        if self._rest:
            return self._rest.popleft()
        if self._digests:
            return self._digests.pop(next(iter(self._digests)))
        self.is_not_empty.clear()
        return None


class Inbox(asyncio.Queue[aiomqtt.Message]):
    """What has come and is still to be handled: of states only the newest of each vehicle.

    A process that falls behind must not live in the past. When full, the oldest is dropped.
    """

    def _init(self, maxsize: int) -> None:
        self._queue: dict[object, aiomqtt.Message] = {}

    def _put(self, item: aiomqtt.Message) -> None:
        overtaken = item.topic.value.endswith(OVERTAKEN)
        self._queue[item.topic.value if overtaken else object()] = item

    def _get(self) -> aiomqtt.Message:
        return self._queue.pop(next(iter(self._queue)))

    def put_nowait(self, item: aiomqtt.Message) -> None:
        """Never full."""
        if self.full():
            self.get_nowait()
        super().put_nowait(item)


class PeerListener(Protocol):
    """What takes in all that others say."""

    @property
    def mission_us(self) -> int:
        """Mission time here."""

    def passed(self, mission_us: int) -> None:
        """Mission time has come so far elsewhere."""

    def hear(self, message: AnyMessage) -> None:
        """A vehicle that is flown elsewhere has said something."""

    def contact(self, there: bool) -> None:
        """Others can be talked to, or no longer."""

    def tell(self, text: str, warning: bool) -> None:
        """A line for the user."""


class Exchange:
    """Sends what this process's vehicles (``own``) say, and hears those of other processes.

    ``latest_us`` is the latest mission time there can be.
    """

    def __init__(self, channel: Channel, own: Collection[str], latest_us: int) -> None:
        self.channel = channel
        self.connected, self._told_lost = False, False
        self.sent: Counter[str] = Counter()  # by kind
        self.refused: Counter[str] = Counter()  # by vehicle
        self._own = frozenset(own)
        self._latest_us = latest_us
        self._outbox, self._inbox = Outbox(), Inbox(MOST_UNREAD)
        self._time_due = asyncio.Event()
        self._in_contact = False
        self._joined = asyncio.Event()  # others have told what time it is

    def say(self, message: AnyMessage) -> None:
        """Send a message as soon as the broker takes it."""
        self._outbox.put(message)

    async def run(self, ears: PeerListener) -> None:
        """Talk until cancelled, whatever becomes of the broker."""
        await keep_connected(
            self._client, partial(self._use, ears=ears), partial(self._lost, ears=ears)
        )

    async def _use(self, client: aiomqtt.Client, ears: PeerListener) -> None:
        """Until the broker is gone; raises what ends it."""
        await client.subscribe(self.channel.topic("+", "+"), qos=0)
        ears.tell(f"talks to others over {self.channel.broker}", False)
        self.connected, self._told_lost = True, False
        talks = (self._hear, self._send, self._tell_time, self._find_contact)
        await together(*(talk(client, ears) for talk in talks))

    def _lost(self, why: str, ears: PeerListener) -> None:
        if not self._told_lost:
            text = (
                f"no broker at {self.channel.broker} ({why}); it stays where it is until there is"
            )
            ears.tell(text, True)
        self.connected, self._told_lost = False, True
        if self._in_contact:
            self._in_contact = False
            ears.contact(False)

    async def join(self) -> None:
        """Wait a moment until others have told what time it is; returns also if nobody does."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(JOIN_S):
                await self._joined.wait()

    def _client(self, logger: logging.Logger) -> aiomqtt.Client:
        self._inbox = Inbox(MOST_UNREAD)
        return client_to(self.channel.broker, self.channel.access, logger=logger, inbox=self._inbox)

    async def _send(self, client: aiomqtt.Client, ears: PeerListener) -> None:
        while True:
            await self._outbox.is_not_empty.wait()
            message = self._outbox.take()
            if message is not None:
                kind, payload = encoded(message)
                topic = self.channel.topic(message.sender, kind)
                await client.publish(topic, payload, qos=0, timeout=TAKE_S)
                self.sent[kind] += 1

    async def _find_contact(self, client: aiomqtt.Client, ears: PeerListener) -> None:
        """All come back to a broker within this time: who is not heard then is not there."""
        await asyncio.sleep(MOST_WAIT_S + 0.5)
        self._in_contact = True
        ears.contact(True)
        await asyncio.Event().wait()

    async def _tell_time(self, client: aiomqtt.Client, ears: PeerListener) -> None:
        """Now and then, and to who is behind: mission time is the latest there is anywhere."""
        topic = self.channel.topic(min(self._own), TIME)
        while True:
            self._time_due.clear()
            await client.publish(topic, str(ears.mission_us).encode(), qos=0, timeout=TAKE_S)
            await asyncio.sleep(TIME_LEAST_S)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(TIME_EVERY_S):
                    await self._time_due.wait()

    async def _hear(self, client: aiomqtt.Client, ears: PeerListener) -> None:
        async for told in client.messages:
            self._take(told, ears)
            while not self._inbox.empty():
                self._take(self._inbox.get_nowait(), ears)
            await asyncio.sleep(READ_S)  # meanwhile more comes: who is busy handles only the newest

    def _take(self, told: aiomqtt.Message, ears: PeerListener) -> None:
        *_, vehicle, kind = told.topic.value.split("/")
        if vehicle in self._own:
            return
        payload = told.payload if isinstance(told.payload, bytes) else b""
        try:
            if kind == TIME:
                self._hear_time(decoded_time(payload, self._latest_us), ears)
            else:
                ears.hear(decoded(vehicle, payload, self._latest_us))
        except UnfitError as problem:
            if not self.refused[vehicle]:
                ears.tell(f"{told.topic}: {problem}; such messages are left out", True)
            self.refused[vehicle] += 1

    def _hear_time(self, mission_us: int, ears: PeerListener) -> None:
        if mission_us < ears.mission_us - BEHIND_US:
            self._time_due.set()
        else:
            self._time_due.clear()  # somebody else has answered
        ears.passed(mission_us)
        self._joined.set()
