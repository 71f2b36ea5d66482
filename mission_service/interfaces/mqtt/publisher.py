"""Publishes the states of the picture to a broker, and handles commands if configured.

The run never waits for the broker, and memory does not grow without one: see ``outgoing.py``.
"""

import asyncio
import contextlib
import logging
from collections import Counter, deque
from collections.abc import Callable, Coroutine
from functools import partial
from typing import TYPE_CHECKING, Any

import aiomqtt
import msgspec
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from mission_service.config.service import MqttSection
from mission_service.core.requests import ABORT
from mission_service.interfaces.maps.run_forecasts import forecasts_of, front_now
from mission_service.interfaces.mqtt.commands import MOST_BYTES, Doorkeeper
from mission_service.interfaces.mqtt.connection import (
    TAKE_S,
    client_to,
    keep_connected,
    together,
)
from mission_service.interfaces.mqtt.inbox import Inbox
from mission_service.interfaces.mqtt.messages import Reply, ServiceStatus
from mission_service.interfaces.mqtt.outgoing import Outgoing, Publication
from mission_service.interfaces.mqtt.site import Site, site_in
from mission_service.interfaces.mqtt.topics import COMMAND, FRONT, POLLED, REPLY, STATUS, Topic
from mission_service.runtime.clocks import clock_us, wall_us

if TYPE_CHECKING:
    from mission_service.runtime.hub import Hub

LOOK_S = 0.05  # shortest interval between two looks at the picture
LONGEST_LOOK_S = 0.5
FRONT_EVERY_S, CORRECTED_EVERY_S = 10.0, 1.0
STATUS_EVERY_S = 1.0  # interval of checks for a change
POLLED_EVERY_S = 0.5
FAREWELL_S = 1.0
TELL_AGAIN_US = 60_000_000
MOST_UNREAD = 100  # commands that wait
MOST_REPLIES = 100  # waiting for the broker; beyond it the oldest is dropped
PACKET_BYTES = 2 * MOST_BYTES  # the broker drops larger ones; above MOST_BYTES they are refused
BROKER_ALARM, COMMANDS_ALARM = "broker", "broker/commands"


def mqtt_door(
    settings: MqttSection, scenario_name: str
) -> Callable[["Hub"], Coroutine[Any, Any, None]]:
    """The coroutine that publishes and subscribes until cancelled. Raises MissionServiceError."""
    site = site_in(settings, scenario_name)

    async def door(hub: "Hub") -> None:
        await Publisher(hub, settings, site).run()

    return door


def _inbox() -> Inbox:
    return Inbox(MOST_UNREAD, urgent=f"/{ABORT}")


class Publisher:
    """The connection of one run to a broker."""

    def __init__(self, hub: "Hub", settings: MqttSection, site: Site) -> None:
        self.site = site
        self.connected = False
        self._told_lost, self._tell_from_us = False, 0
        self.sent: Counter[str] = Counter()  # by schema
        self._hub = hub
        hub.gauges["mqtt_connected"] = lambda: self.connected
        hub.gauges["mqtt_sent_total"] = self.sent.total
        self._takes_commands = settings.commands
        self._outgoing = Outgoing(settings.telemetry_hz)
        self._forecasts = forecasts_of(hub)
        self._doorkeeper = Doorkeeper(partial(hub.desk.ask, may_approve=False))
        self._inbox = _inbox()
        self._replies: deque[Reply] = deque(maxlen=MOST_REPLIES)
        self._reply_waits = asyncio.Event()

    async def run(self) -> None:
        """Publish and handle commands until cancelled."""
        try:
            await keep_connected(self._client, self._use, self._lost)
        finally:
            self._forecasts.close()

    # The connection ---------------------------------------------------------------------------

    def _client(self, logger: logging.Logger) -> aiomqtt.Client:
        self._inbox = _inbox()
        payload = msgspec.json.encode(self._status(False, "the connection was lost"))
        will = aiomqtt.Will(self._topic(STATUS.path), payload, STATUS.qos, STATUS.retained)
        return client_to(
            self.site.broker,
            self.site.access,
            logger=logger,
            inbox=self._inbox,
            will=will,
            most_bytes=PACKET_BYTES,
        )

    async def _use(self, client: aiomqtt.Client) -> None:
        """Publish and handle commands until the connection is lost; raises what ended it."""
        try:
            await self._talk(client)
        except Exception:
            while not self._inbox.empty():  # received before the broker was lost: carried out
                self._take(self._inbox.get_nowait())
            raise

    async def _talk(self, client: aiomqtt.Client) -> None:
        if self._takes_commands:
            await self._subscribe(client)
        self._outgoing.begin()
        self._found()
        told: list[Callable[[aiomqtt.Client], Coroutine[Any, Any, None]]]
        told = [self._tell_status, self._tell_states, self._tell_news, self._tell_front]
        told += [partial(self._tell_polled, topic) for topic in POLLED]
        try:
            await together(*(talk(client) for talk in (*told, self._hear, self._answer)))
        except asyncio.CancelledError:
            with contextlib.suppress(aiomqtt.MqttError, TimeoutError):
                async with asyncio.timeout(FAREWELL_S):
                    farewell = msgspec.json.encode(self._status(False, "it was ended"))
                    await self._publish(client, Publication(STATUS, farewell))
            raise

    def _found(self) -> None:
        self.connected = True
        self._hub.picture.clear(BROKER_ALARM)
        if self._told_lost:
            self._hub.service.announce("mqtt", f"the broker at {self.site.broker} is back", "info")
        self._told_lost = False
        self._hub.ring()

    def _lost(self, why: str) -> None:
        """Raise the alarm; announce a lost broker, but not each of many short connections."""
        self.connected = False
        text = f"no MQTT broker at {self.site.broker}: {why}"
        now_us = clock_us()
        if not self._told_lost and now_us >= self._tell_from_us:
            self._told_lost, self._tell_from_us = True, now_us + TELL_AGAIN_US
            self._hub.service.announce("mqtt", text)
        self._hub.picture.alarm(BROKER_ALARM, text)
        self._hub.ring()

    async def _subscribe(self, client: aiomqtt.Client) -> None:
        """Subscribe to commands, with their retain flags: retained commands are refused."""
        options = SubscribeOptions(qos=COMMAND.qos, retainAsPublished=True)
        topic = self._topic(COMMAND.path.format("+"))
        answers = await client.subscribe(topic, options=options)
        refused = any(isinstance(each, ReasonCode) and each.is_failure for each in answers)
        if refused:
            user = self.site.access.user or "nobody"
            text = f"no commands over MQTT: the broker lets {user} not listen to {topic}"
            self._hub.picture.alarm(COMMANDS_ALARM, text)
        else:
            self._hub.picture.clear(COMMANDS_ALARM)

    def _topic(self, rest: str) -> str:
        return f"{self.site.topic}/{rest}"

    async def _publish(self, client: aiomqtt.Client, told: Publication) -> None:
        topic = told.topic
        await client.publish(
            self._topic(told.path), told.payload, topic.qos, topic.retained, timeout=TAKE_S
        )
        self.sent[topic.schema] += 1

    # Publications -----------------------------------------------------------------------------

    def _status(self, online: bool, why: str = "") -> ServiceStatus:
        hub = self._hub
        return ServiceStatus(
            hub.picture.at_us,
            wall_us(),
            online,
            hub.scenario.name,
            hub.scenario.planner.rule,
            tuple(hub.picture.vehicles),
            tuple(hub.ready()),
            self._takes_commands,
            why,
            hub.replay is not None,
        )

    async def _tell_status(self, client: aiomqtt.Client) -> None:
        before: tuple[object, ...] | None = None
        while True:
            status = self._status(True)
            if (status.not_ready, status.vehicles) != before:
                await self._publish(client, Publication(STATUS, msgspec.json.encode(status)))
                before = (status.not_ready, status.vehicles)
            await asyncio.sleep(STATUS_EVERY_S)

    async def _tell_polled(self, topic: Topic, client: aiomqtt.Client) -> None:
        assert topic.build is not None
        before: object = None
        while True:
            state = topic.build(self._hub, "")
            if state != before:
                await self._publish(client, Publication(topic, msgspec.json.encode(state)))
                before = state
            await asyncio.sleep(POLLED_EVERY_S)

    async def _tell_states(self, client: aiomqtt.Client) -> None:
        while True:
            version = self._hub.picture.version
            for told in self._outgoing.states(self._hub, clock_us()):
                await self._publish(client, told)
            await self._wait_for_news(version)

    async def _tell_news(self, client: aiomqtt.Client) -> None:
        while True:
            version = self._hub.picture.version
            for told in self._outgoing.news(self._hub.picture):
                await self._publish(client, told)
            await self._wait_for_news(version)

    async def _wait_for_news(self, version: int) -> None:
        """Wait for a change of the picture, at most ``LONGEST_LOOK_S``: states may become due."""
        await asyncio.sleep(LOOK_S)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(LONGEST_LOOK_S):
                await self._hub.changed(version)

    async def _tell_front(self, client: aiomqtt.Client) -> None:
        """Publish the front at intervals, and soon after a correction of the fire."""
        hub, loop = self._hub, asyncio.get_running_loop()
        while True:
            began_s, version = loop.time(), hub.picture.fire_version
            front = {"schema": FRONT.schema, **await front_now(hub, self._forecasts)}
            await self._publish(client, Publication(FRONT, msgspec.json.encode(front)))
            await asyncio.sleep(CORRECTED_EVERY_S)
            while loop.time() - began_s < FRONT_EVERY_S:
                if hub.picture.fire_version != version:
                    break
                await asyncio.sleep(LONGEST_LOOK_S)

    # Commands ---------------------------------------------------------------------------------

    async def _hear(self, client: aiomqtt.Client) -> None:
        """Handle commands; ends as soon as the connection is lost, even without publications."""
        async for message in client.messages:
            self._take(message)
            await asyncio.sleep(0)  # other tasks run between two commands

    def _take(self, message: aiomqtt.Message) -> None:
        name = message.topic.value.rpartition("/")[2]
        payload = message.payload if isinstance(message.payload, bytes) else b""
        at_us, now_s = self._hub.clock.now_us, clock_us() / 1e6
        reply = self._doorkeeper.take(name, payload, message.retain, at_us, now_s, wall_us())
        if reply is not None:
            self._replies.append(reply)
            self._reply_waits.set()

    async def _answer(self, client: aiomqtt.Client) -> None:
        while True:
            await self._reply_waits.wait()
            while self._replies:
                reply = self._replies.popleft()
                payload = msgspec.json.encode(reply)
                await self._publish(client, Publication(REPLY, payload, reply.command))
            self._reply_waits.clear()
