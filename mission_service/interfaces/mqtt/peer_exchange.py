"""Exchanges MQTT messages between the UAVs of a formation that several processes control.

Sending never waits for a broker. Each process puts its messages in a short queue, in which a newer
state replaces an older state. By comparing digests, vehicles find map cells that were lost with a
message. Without a broker, all vehicles loiter in place, because a moving vehicle could not detect
conflicts.
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
from mission_service.config.service_section import MqttSection
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

MAX_WAITING = 200  # maximum number of queued messages, besides states and digests
MAX_UNREAD = 2000
READ_S = 0.02  # pause between two reads of the inbox
TIME = "time"  # kind of the messages with the mission time of a process, in microseconds
TIME_EVERY_S, TIME_LEAST_S, JOIN_S = 1.0, 0.2, 2.0
BEHIND_US = 10_000_000  # a larger lag of another process triggers a message with mission time
OVERTAKEN = ("/state", f"/{TIME}")  # topics of which the inbox stores only the newest message
AHEAD_US = 60_000_000  # limit for observation times ahead of the sender's mission time

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
        """Return the topic for a vehicle's messages of one kind; ``+`` matches any name or kind."""
        return f"{site_topic(self.prefix, self.site)}/formation/{vehicle}/{kind}"


class UnfitError(Exception):
    """A message that no vehicle of this formation can have sent."""


def channel_of(
    broker: str, prefix: str, scenario_name: str, settings: MqttSection | None = None
) -> Channel:
    """Return the channel of a scenario's vehicles.

    The channel uses the credentials in ``settings`` if these configure the same broker. Raises
    MissionServiceError for an invalid address or prefix.
    """
    address = read_broker(broker)
    access = access_for(address, settings)
    return Channel(address, check_prefix(prefix), site_of(scenario_name), access)


def encoded(message: AnyMessage) -> tuple[str, bytes]:
    """Return the kind of a message (the last level of its topic) and its JSON."""
    return type(message).__name__.lower(), _encode(message)


def decoded(vehicle: str, payload: bytes, latest_us: int) -> AnyMessage:
    """Decode a message of ``vehicle`` with a mission time of at most ``latest_us``.

    Raises UnfitError for a message that this vehicle cannot have sent. The positions of cells are
    checked later, when they are added to the map.
    """
    try:
        message: AnyMessage = _decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise UnfitError(f"the message cannot be read: {error}") from None
    if message.sender != vehicle:
        raise UnfitError(f"the message contains another sender, {message.sender}")
    if message.at_us > latest_us:
        raise UnfitError(f"mission time {message.at_us / 1e6:.0f} s is after the mission's end")
    if isinstance(message, Difference):
        observed_us = max((at_us for _, _, at_us, _ in message.cells), default=0)
        if observed_us > message.at_us + AHEAD_US:
            raise UnfitError(f"observation time {observed_us / 1e6:.0f} s is in the future")
    return message


def decoded_time(payload: bytes, latest_us: int) -> int:
    """Decode the mission time of another process. Raises UnfitError for an invalid time."""
    if re.fullmatch(rb"[0-9]{1,16}", payload) is None or int(payload) > latest_us:
        raise UnfitError("the mission time is outside this mission")
    return int(payload)


class Outbox:
    """A queue of messages to send, states first and digests last.

    If more than ``MAX_WAITING`` other messages wait, the oldest of them is dropped.
    """

    def __init__(self) -> None:
        self._states: dict[str, AnyMessage] = {}  # newest state by sender
        self._digests: dict[str, AnyMessage] = {}
        self._rest: deque[AnyMessage] = deque(maxlen=MAX_WAITING)
        self.is_not_empty = asyncio.Event()

    def put(self, message: AnyMessage) -> None:
        """Add a message; a state or digest replaces the sender's older state or digest."""
        if isinstance(message, State):
            self._states[message.sender] = message
        elif isinstance(message, Digest):
            self._digests[message.sender] = message
        else:
            self._rest.append(message)
        self.is_not_empty.set()

    def pop(self) -> AnyMessage | None:
        """Remove and return the next message, or return None."""
        if self._states:
            return self._states.pop(next(iter(self._states)))
        if self._rest:
            return self._rest.popleft()
        if self._digests:
            return self._digests.pop(next(iter(self._digests)))
        self.is_not_empty.clear()
        return None


class PeerExchange:
    """The exchange of messages between this process's vehicles (``own``) and all others.

    ``latest_us`` is the latest possible mission time.
    """

    def __init__(self, channel: Channel, own: Collection[str], latest_us: int) -> None:
        self.channel = channel
        self.connected, self._loss_reported = False, False
        self.sent: Counter[str] = Counter()  # number of messages by kind
        self.refused: Counter[str] = Counter()  # number of messages by vehicle
        self._own = frozenset(own)
        self._latest_us = latest_us
        self._outbox, self._inbox = Outbox(), Inbox(MAX_UNREAD, newest=OVERTAKEN)
        self._time_due = asyncio.Event()
        self._in_contact = False
        self._joined = asyncio.Event()  # a mission time was received

    def broadcast(self, message: AnyMessage) -> None:
        """Queue a message for sending."""
        self._outbox.put(message)

    async def run(self, listener: "PeerListener") -> None:
        """Exchange messages until cancelled; reconnect after a failure."""
        await keep_connected(
            self._client,
            partial(self._use, listener=listener),
            partial(self._lost, listener=listener),
        )

    async def _use(self, client: aiomqtt.Client, listener: "PeerListener") -> None:
        """Exchange messages until the connection is lost, then raise the error of the loss."""
        await client.subscribe(self.channel.topic("+", "+"), qos=0)
        listener.announce(f"connected to other processes over {self.channel.broker}", False)
        self.connected, self._loss_reported = True, False
        loops = (self._receive, self._send, self._send_time, self._find_contact)
        await together(*(loop(client, listener) for loop in loops))

    def _lost(self, why: str, listener: "PeerListener") -> None:
        if not self._loss_reported:
            text = (
                f"no broker at {self.channel.broker} ({why}); vehicles circle until it is reached"
            )
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
        self._inbox = Inbox(MAX_UNREAD, newest=OVERTAKEN)
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
        """Report that the link is up when all processes have had time to reconnect."""
        await asyncio.sleep(MAX_WAIT_S + 0.5)
        self._in_contact = True
        listener.on_link(True)
        await asyncio.Event().wait()

    async def _send_time(self, client: aiomqtt.Client, listener: "PeerListener") -> None:
        """Publish mission time at intervals, and soon after a process reports a much earlier time.

        The mission time of the formation is the latest mission time of all processes.
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
        async for message in client.messages:
            self._handle(message, listener)
            while not self._inbox.empty():
                self._handle(self._inbox.get_nowait(), listener)
            await asyncio.sleep(READ_S)  # during the pause, newer states replace older states

    def _handle(self, message: aiomqtt.Message, listener: "PeerListener") -> None:
        *_, vehicle, kind = message.topic.value.split("/")
        if vehicle in self._own:
            return
        payload = message.payload if isinstance(message.payload, bytes) else b""
        try:
            if kind == TIME:
                self._receive_time(decoded_time(payload, self._latest_us), listener)
            else:
                listener.on_message(decoded(vehicle, payload, self._latest_us))
        except UnfitError as problem:
            if not self.refused[vehicle]:
                listener.announce(f"{message.topic}: {problem}; such messages are ignored", True)
            self.refused[vehicle] += 1

    def _receive_time(self, mission_us: int, listener: "PeerListener") -> None:
        if mission_us < listener.mission_us - BEHIND_US:
            self._time_due.set()
        else:
            self._time_due.clear()  # another process has published the time
        listener.passed(mission_us)
        self._joined.set()
