"""Messages between the UAVs of a formation that several processes fly, over MQTT.

Sending never waits for a broker. A message goes into a short queue, in which a newer state replaces
an older one; maps recover from lost messages by their digests. Without a broker all vehicles keep
circling at their positions, because a moving vehicle could not detect conflicts.
"""

import asyncio
import contextlib
import logging
import re
from collections import Counter, deque
from collections.abc import Collection
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import aiomqtt
import msgspec

from mission_service.config.mqtt_names import Broker, check_prefix, read_broker, site_of, site_topic
from mission_service.config.service import MqttSection
from mission_service.interfaces.mqtt.broker_connection import (
    MAX_WAIT_S,
    OPEN,
    TAKE_S,
    BrokerAccess,
    client_to,
    keep_connected,
    together,
)
from mission_service.interfaces.mqtt.broker_site import access_for
from mission_service.interfaces.mqtt.command_inbox import Inbox
from mission_service.peer_messages import AnyMessage, Difference, Digest, State

if TYPE_CHECKING:
    from mission_service.runtime.peer_listener import PeerListener

MAX_WAITING = 200  # queued messages, besides states and digests
MAX_UNREAD = 2000
READ_S = 0.02  # pause between two reads of the inbox
TIME = "time"  # kind of a message: mission time of a process, in microseconds
TIME_EVERY_S, TIME_LEAST_S, JOIN_S = 1.0, 0.2, 2.0
BEHIND_US = 10_000_000  # a process that lags less is not corrected
OVERTAKEN = ("/state", f"/{TIME}")  # kinds of which only the newest message counts
AHEAD_US = 60_000_000  # mission time of other processes may be this far ahead of a sender's

_encode = msgspec.json.Encoder().encode
_decode = msgspec.json.Decoder(AnyMessage).decode


@dataclass(frozen=True, slots=True)
class Channel:
    """The broker and the topics over which the vehicles of one site exchange messages."""

    broker: Broker
    prefix: str
    site: str
    access: BrokerAccess = OPEN

    def topic(self, vehicle: str, kind: str) -> str:
        """The topic of one vehicle's messages of one kind; ``+`` matches all vehicles or kinds."""
        return f"{site_topic(self.prefix, self.site)}/formation/{vehicle}/{kind}"


class UnfitError(Exception):
    """A message that no vehicle of this formation can have sent."""


def channel_of(
    broker: str, prefix: str, scenario_name: str, settings: MqttSection | None = None
) -> Channel:
    """The channel of a scenario's vehicles. Raises MissionServiceError if it is invalid.

    The credentials are those of ``settings`` if it names the same broker.
    """
    where = read_broker(broker)
    access = access_for(where, settings)
    return Channel(where, check_prefix(prefix), site_of(scenario_name), access)


def encoded(message: AnyMessage) -> tuple[str, bytes]:
    """The kind of a message, which is the last level of its topic, and its JSON."""
    return type(message).__name__.lower(), _encode(message)


def decoded(vehicle: str, payload: bytes, latest_us: int) -> AnyMessage:
    """Decode a message of ``vehicle``, of mission time ``latest_us`` at the latest.

    Raises UnfitError for a message that this vehicle cannot have sent. The map checks that cells
    are on it.
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
    """Decode the mission time of another process. Raises UnfitError if it is invalid."""
    if re.fullmatch(rb"[0-9]{1,16}", payload) is None or int(payload) > latest_us:
        raise UnfitError("a time outside this mission")
    return int(payload)


class Outbox:
    """Messages to send: states first, digests last; of the others the oldest is dropped."""

    def __init__(self) -> None:
        self._states: dict[str, AnyMessage] = {}  # by sender
        self._digests: dict[str, AnyMessage] = {}
        self._rest: deque[AnyMessage] = deque(maxlen=MAX_WAITING)
        self.is_not_empty = asyncio.Event()

    def put(self, message: AnyMessage) -> None:
        """Add a message; a state or digest replaces an older one of its sender."""
        if isinstance(message, State):
            self._states[message.sender] = message
        elif isinstance(message, Digest):
            self._digests[message.sender] = message
        else:
            self._rest.append(message)
        self.is_not_empty.set()

    def pop(self) -> AnyMessage | None:
        """Remove the next message and return it, or None."""
        if self._states:
            return self._states.pop(next(iter(self._states)))
        if self._rest:
            return self._rest.popleft()
        if self._digests:
            return self._digests.pop(next(iter(self._digests)))
        self.is_not_empty.clear()
        return None


def _inbox() -> Inbox:
    """Of states and times only the newest of each vehicle counts."""
    return Inbox(MAX_UNREAD, newest=OVERTAKEN)


class PeerExchange:
    """Sends the messages of this process's vehicles (``own``), and receives those of others.

    ``latest_us`` is the latest possible mission time.
    """

    def __init__(self, channel: Channel, own: Collection[str], latest_us: int) -> None:
        self.channel = channel
        self.connected, self._loss_reported = False, False
        self.sent: Counter[str] = Counter()  # by kind
        self.refused: Counter[str] = Counter()  # by vehicle
        self._own = frozenset(own)
        self._latest_us = latest_us
        self._outbox, self._inbox = Outbox(), _inbox()
        self._time_due = asyncio.Event()
        self._in_contact = False
        self._joined = asyncio.Event()  # a mission time was received

    def broadcast(self, message: AnyMessage) -> None:
        """Queue a message; it is sent as soon as the broker accepts it."""
        self._outbox.put(message)

    async def run(self, listener: "PeerListener") -> None:
        """Exchange messages until cancelled; connect again after a failure."""
        await keep_connected(
            self._client,
            partial(self._use, listener=listener),
            partial(self._lost, listener=listener),
        )

    async def _use(self, client: aiomqtt.Client, listener: "PeerListener") -> None:
        """Exchange messages until the connection is lost; raises the error that ended it."""
        await client.subscribe(self.channel.topic("+", "+"), qos=0)
        listener.announce(f"connected to other processes over {self.channel.broker}", False)
        self.connected, self._loss_reported = True, False
        loops = (self._receive, self._send, self._send_time, self._find_contact)
        await together(*(talk(client, listener) for talk in loops))

    def _lost(self, why: str, listener: "PeerListener") -> None:
        if not self._loss_reported:
            text = f"no broker at {self.channel.broker} ({why}); vehicles circle until it is back"
            listener.announce(text, True)
        self.connected, self._loss_reported = False, True
        if self._in_contact:
            self._in_contact = False
            listener.on_link(False)

    async def join(self) -> None:
        """Wait up to ``JOIN_S`` for the mission time of another process."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(JOIN_S):
                await self._joined.wait()

    def _client(self, logger: logging.Logger) -> aiomqtt.Client:
        self._inbox = _inbox()
        return client_to(self.channel.broker, self.channel.access, logger=logger, inbox=self._inbox)

    async def _send(self, client: aiomqtt.Client, listener: "PeerListener") -> None:
        while True:
            await self._outbox.is_not_empty.wait()
            message = self._outbox.pop()
            if message is not None:
                kind, payload = encoded(message)
                topic = self.channel.topic(message.sender, kind)
                await client.publish(topic, payload, qos=0, timeout=TAKE_S)
                self.sent[kind] += 1

    async def _find_contact(self, client: aiomqtt.Client, listener: "PeerListener") -> None:
        """Report the contact, after a time in which all processes connect to the broker again."""
        await asyncio.sleep(MAX_WAIT_S + 0.5)
        self._in_contact = True
        listener.on_link(True)
        await asyncio.Event().wait()

    async def _send_time(self, client: aiomqtt.Client, listener: "PeerListener") -> None:
        """Publish mission time regularly, and soon after a time from a process that lags behind.

        Mission time of the formation is the latest of all processes.
        """
        topic = self.channel.topic(min(self._own), TIME)
        while True:
            self._time_due.clear()
            await client.publish(topic, str(listener.mission_us).encode(), qos=0, timeout=TAKE_S)
            await asyncio.sleep(TIME_LEAST_S)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(TIME_EVERY_S):
                    await self._time_due.wait()

    async def _receive(self, client: aiomqtt.Client, listener: "PeerListener") -> None:
        async for told in client.messages:
            self._take(told, listener)
            while not self._inbox.empty():
                self._take(self._inbox.get_nowait(), listener)
            await asyncio.sleep(READ_S)  # meanwhile newer states replace older ones

    def _take(self, told: aiomqtt.Message, listener: "PeerListener") -> None:
        *_, vehicle, kind = told.topic.value.split("/")
        if vehicle in self._own:
            return
        payload = told.payload if isinstance(told.payload, bytes) else b""
        try:
            if kind == TIME:
                self._receive_time(decoded_time(payload, self._latest_us), listener)
            else:
                listener.on_message(decoded(vehicle, payload, self._latest_us))
        except UnfitError as problem:
            if not self.refused[vehicle]:
                listener.announce(f"{told.topic}: {problem}; such messages are left out", True)
            self.refused[vehicle] += 1

    def _receive_time(self, mission_us: int, listener: "PeerListener") -> None:
        if mission_us < listener.mission_us - BEHIND_US:
            self._time_due.set()
        else:
            self._time_due.clear()  # another process has published it
        listener.passed(mission_us)
        self._joined.set()
