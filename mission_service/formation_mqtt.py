"""What UAVs of a formation tell each other, over MQTT: one process a vehicle, or several of them.

Nothing here waits for a broker. What is said goes into a short queue, in which a newer state takes
the place of an older one; what is lost, maps heal by their digests. While there is no broker the
vehicle flies on with what it knows.
"""

import asyncio
import re
from collections import Counter, deque
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

import aiomqtt
import msgspec

from mission_service.errors import MissionServiceError
from mission_service.formation.messages import AnyMessage, Difference, Digest, FireUpdate, State

PREFIX = "mission-service"
VERSION = "v1"
PORT = 1883
LEAST_WAIT_S, MOST_WAIT_S = 0.25, 8.0  # before the next attempt to reach the broker
KEEPALIVE_S = 5  # a broker that is silent for twice as long is gone
TIMEOUT_S = 15.0  # longer than that takes
MOST_WAITING = 200  # messages to go out, besides states
MOST_UNREAD = 2000

_encode = msgspec.json.Encoder().encode
_decode = msgspec.json.Decoder(AnyMessage).decode


@dataclass(frozen=True, slots=True)
class Broker:
    """Where an MQTT broker is."""

    host: str
    port: int = PORT

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


def read_broker(text: str) -> Broker:
    """HOST or HOST:PORT. Raises MissionServiceError."""
    found = re.fullmatch(r"([\w.-]+|\[[0-9a-fA-F:]+\])(?::(\d{1,5}))?", text)
    port = int(found[2] or PORT) if found else 0
    if found is None or not 0 < port < 65536:
        raise MissionServiceError(f"--broker {text}: write it as HOST or HOST:PORT")
    return Broker(found[1].strip("[]"), port)


def topic_of(prefix: str, site: str, vehicle: str, kind: str) -> str:
    """Where messages of one kind from one vehicle are to be heard; both may be ``+``."""
    return f"{prefix}/{VERSION}/{site}/formation/{vehicle}/{kind}"


def site_of(scenario_name: str) -> str:
    """The name of a scenario as one level of a topic."""
    return re.sub(r"[^\w-]+", "-", scenario_name).strip("-") or "site"


def check_prefix(prefix: str) -> str:
    """The prefix of all topics. Raises MissionServiceError for what is no topic."""
    if re.fullmatch(r"[^/+#$\s][^+#\s]*(?<!/)", prefix) is None:
        raise MissionServiceError(
            f"--prefix {prefix}: it is the beginning of topics, as in uav/east"
        )
    return prefix


def encoded(message: AnyMessage) -> tuple[str, bytes]:
    """A message as it is sent: its kind, the last level of its topic, and JSON."""
    return type(message).__name__.lower(), _encode(message)


def decoded(vehicle: str, payload: bytes, cells: int, latest_us: int) -> AnyMessage:
    """What ``vehicle`` has said, of a grid with so many cells, at ``latest_us`` at the latest.

    Raises ValueError, in words, for what no vehicle of this formation can have said.
    """
    try:
        message: AnyMessage = _decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"cannot be read: {error}") from None
    if message.sender != vehicle:
        raise ValueError(f"is said to be from {message.sender}")
    if not 0 <= message.at_us <= latest_us:
        raise ValueError(f"is of mission time {message.at_us / 1e6:.0f} s")
    match message:
        case FireUpdate():
            named: Collection[int] = (*message.burning, *message.cleared)
        case Difference():
            named = [cell for cell, _, _ in message.cells]
            if any(not 0 <= seen_us <= latest_us for _, seen_us, _ in message.cells):
                raise ValueError("has cells that were seen at no time of this mission")
        case _:
            named = ()
    if named and not (min(named) >= 0 and max(named) < cells):
        raise ValueError("has cells that are not on this grid; do all fly the same scenario?")
    return message


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


class Newest(asyncio.Queue[Any]):
    """A queue that drops its oldest entry rather than refuse another one."""

    def put_nowait(self, item: Any) -> None:
        """Never full."""
        if self.full():
            self.get_nowait()
        super().put_nowait(item)


class Exchange:
    """Sends what this process's vehicles say, and delivers what others do.

    ``deliver`` takes what was heard, ``tell`` a line for the user. ``latest_us`` is the latest
    mission time there can be.
    """

    def __init__(
        self,
        broker: Broker,
        prefix: str,
        site: str,
        own: Collection[str],
        cells: int,
        latest_us: int,
        deliver: Callable[[AnyMessage], None],
        tell: Callable[[str], None],
    ) -> None:
        self.broker = broker
        self.connected = False
        self.sent: Counter[str] = Counter()  # by kind
        self.heard: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()  # by vehicle
        self._topic = (prefix, site)
        self._own = frozenset(own)
        self._cells, self._latest_us = cells, latest_us
        self._deliver, self._tell = deliver, tell
        self._outbox = Outbox()

    def say(self, message: AnyMessage) -> None:
        """Send a message when the broker takes it."""
        self._outbox.put(message)

    async def run(self) -> None:
        """Talk until cancelled, whatever becomes of the broker."""
        wait_s = LEAST_WAIT_S
        while True:
            try:
                async with self._client() as client, asyncio.TaskGroup() as group:
                    await client.subscribe(topic_of(*self._topic, "+", "+"), qos=0)
                    self._tell(f"talks to others over {self.broker}")
                    self.connected, wait_s = True, LEAST_WAIT_S
                    group.create_task(self._send(client))
                    group.create_task(self._hear(client))
            except* aiomqtt.MqttError as errors:
                if self.connected or wait_s == LEAST_WAIT_S:
                    reason = _first(errors)
                    self._tell(f"no broker at {self.broker} ({reason}); flies on by itself")
                self.connected = False
            await asyncio.sleep(wait_s)
            wait_s = min(2.0 * wait_s, MOST_WAIT_S)

    def _client(self) -> aiomqtt.Client:
        return aiomqtt.Client(
            self.broker.host,
            self.broker.port,
            keepalive=KEEPALIVE_S,
            timeout=TIMEOUT_S,
            queue_type=Newest,
            max_queued_incoming_messages=MOST_UNREAD,
        )

    async def _send(self, client: aiomqtt.Client) -> None:
        outbox = self._outbox
        while True:
            await outbox.is_not_empty.wait()
            message = outbox.take()
            if message is None:
                continue
            kind, payload = encoded(message)
            await client.publish(topic_of(*self._topic, message.sender, kind), payload, qos=0)
            self.sent[kind] += 1

    async def _hear(self, client: aiomqtt.Client) -> None:
        async for told in client.messages:
            *_, vehicle, kind = str(told.topic).split("/")
            if vehicle in self._own or not isinstance(told.payload, bytes):
                continue
            try:
                message = decoded(vehicle, told.payload, self._cells, self._latest_us)
            except ValueError as error:
                if not self.refused[vehicle]:
                    self._tell(f"{told.topic}: a message {error}; such messages are left out")
                self.refused[vehicle] += 1
                continue
            self.heard[kind] += 1
            self._deliver(message)


def _first(error: BaseException) -> BaseException:
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error
