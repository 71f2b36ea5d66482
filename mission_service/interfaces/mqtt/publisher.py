"""Publishes the state view's states to a broker, and handles commands if configured.

The run never waits for the broker. Memory does not grow without a broker
(``publish_schedule.py``).
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

from mission_service.config.service_section import MqttSection
from mission_service.core.request_events import ABORT
from mission_service.interfaces.maps.run_fronts import front_now
from mission_service.interfaces.mqtt.broker_connection import (
    TAKE_S,
    client_to,
    keep_connected,
    together,
)
from mission_service.interfaces.mqtt.broker_site import Site, site_in
from mission_service.interfaces.mqtt.command_gate import MAX_BYTES, CommandGate
from mission_service.interfaces.mqtt.command_inbox import Inbox
from mission_service.interfaces.mqtt.payloads import Reply, ServiceStatus
from mission_service.interfaces.mqtt.publish_schedule import Publication, PublishSchedule
from mission_service.interfaces.mqtt.topics import COMMAND, FRONT, POLLED, REPLY, STATUS, Topic
from mission_service.runtime.clocks import clock_us, wall_us

if TYPE_CHECKING:
    from mission_service.runtime.run_context import RunContext

LOOK_S = 0.05  # shortest interval between two checks of the state view
LONGEST_LOOK_S = 0.5
FRONT_EVERY_S, CORRECTED_EVERY_S = 10.0, 1.0
STATUS_EVERY_S = 1.0  # interval of checks for a change
POLLED_EVERY_S = 0.5
FAREWELL_S = 1.0
REPUBLISH_AFTER_US = 60_000_000
MAX_UNREAD = 100  # maximum number of queued commands
MAX_REPLIES = 100  # maximum number of queued replies; then the oldest is dropped
PACKET_BYTES = 2 * MAX_BYTES  # the broker drops larger packets; the service refuses > MAX_BYTES
BROKER_ALARM, COMMANDS_ALARM = "broker", "broker/commands"


def mqtt_interface(
    settings: MqttSection, scenario_name: str
) -> Callable[["RunContext"], Coroutine[Any, Any, None]]:
    """Return the coroutine function that publishes and subscribes until cancelled.

    Raises MissionServiceError for invalid settings.
    """
    site = site_in(settings, scenario_name)

    async def run_interface(context: "RunContext") -> None:
        await Publisher(context, settings, site).run()

    return run_interface


def _inbox() -> Inbox:
    return Inbox(MAX_UNREAD, urgent=f"/{ABORT}")


class Publisher:
    """The connection of one run to a broker."""

    def __init__(self, context: "RunContext", settings: MqttSection, site: Site) -> None:
        self.site = site
        self.connected = False
        self._loss_reported, self._publish_from_us = False, 0
        self.sent: Counter[str] = Counter()  # number of messages by schema
        self._context = context
        context.gauges["mqtt_connected"] = lambda: self.connected
        context.gauges["mqtt_sent_total"] = self.sent.total
        self._takes_commands = settings.commands
        self._outgoing = PublishSchedule(settings.telemetry_hz)
        self._command_gate = CommandGate(partial(context.request_handler.ask, may_approve=False))
        self._inbox = _inbox()
        self._replies: deque[Reply] = deque(maxlen=MAX_REPLIES)
        self._reply_waits = asyncio.Event()

    async def run(self) -> None:
        """Publish all topics, and handle commands, until cancelled."""
        await keep_connected(self._client, self._use, self._lost)

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
            max_bytes=PACKET_BYTES,
        )

    async def _use(self, client: aiomqtt.Client) -> None:
        """Publish and handle commands until the connection is lost, then raise the error."""
        try:
            await self._exchange(client)
        except Exception:
            while not self._inbox.empty():  # carry out commands that were received before the loss
                self._handle(self._inbox.get_nowait())
            raise

    async def _exchange(self, client: aiomqtt.Client) -> None:
        if self._takes_commands:
            await self._subscribe(client)
        self._outgoing.begin()
        self._on_connected()
        try:
            await together(
                self._publish_status(client),
                self._publish_states(client),
                self._publish_announcements(client),
                self._publish_front(client),
                *(self._publish_polled(topic, client) for topic in POLLED),
                self._receive(client),
                self._send_replies(client),
            )
        except asyncio.CancelledError:
            with contextlib.suppress(aiomqtt.MqttError, TimeoutError):
                async with asyncio.timeout(FAREWELL_S):
                    farewell = msgspec.json.encode(self._status(False, "the service was stopped"))
                    await self._publish(client, Publication(STATUS, farewell))
            raise

    def _on_connected(self) -> None:
        self.connected = True
        self._context.state_view.clear_alarm(BROKER_ALARM)
        if self._loss_reported:
            self._context.service.announce(
                "mqtt", f"reconnected to the broker at {self.site.broker}", "info"
            )
        self._loss_reported = False
        self._context.ring()

    def _lost(self, why: str) -> None:
        """Raise the alarm; announce the loss unless one was announced shortly before."""
        self.connected = False
        text = f"no MQTT broker at {self.site.broker}: {why}"
        now_us = clock_us()
        if not self._loss_reported and now_us >= self._publish_from_us:
            self._loss_reported, self._publish_from_us = True, now_us + REPUBLISH_AFTER_US
            self._context.service.announce("mqtt", text)
        self._context.state_view.alarm(BROKER_ALARM, text)
        self._context.ring()

    async def _subscribe(self, client: aiomqtt.Client) -> None:
        """Subscribe to commands with their retain flags, because retained commands are refused."""
        options = SubscribeOptions(qos=COMMAND.qos, retainAsPublished=True)
        topic = self._topic(COMMAND.path.format("+"))
        answers = await client.subscribe(topic, options=options)
        if any(isinstance(each, ReasonCode) and each.is_failure for each in answers):
            user = self.site.access.user
            user = "a client without a user name" if user is None else f"the user {user}"
            text = f"no commands over MQTT: the broker does not permit {user} to read {topic}"
            self._context.state_view.alarm(COMMANDS_ALARM, text)
        else:
            self._context.state_view.clear_alarm(COMMANDS_ALARM)

    def _topic(self, rest: str) -> str:
        return f"{self.site.topic}/{rest}"

    async def _publish(self, client: aiomqtt.Client, message: Publication) -> None:
        topic, path = message.topic, self._topic(message.path)
        await client.publish(path, message.payload, topic.qos, topic.retained, timeout=TAKE_S)
        self.sent[topic.schema] += 1

    # Publications -----------------------------------------------------------------------------

    def _status(self, online: bool, why: str = "") -> ServiceStatus:
        context = self._context
        return ServiceStatus(
            context.state_view.at_us,
            wall_us(),
            online,
            context.scenario.name,
            context.scenario.planner.rule,
            tuple(context.state_view.vehicles),
            tuple(context.ready()),
            self._takes_commands,
            why,
            context.replay is not None,
        )

    async def _publish_status(self, client: aiomqtt.Client) -> None:
        before: tuple[object, ...] | None = None
        while True:
            status = self._status(True)
            if (status.not_ready, status.vehicles) != before:
                await self._publish(client, Publication(STATUS, msgspec.json.encode(status)))
                before = (status.not_ready, status.vehicles)
            await asyncio.sleep(STATUS_EVERY_S)

    async def _publish_polled(self, topic: Topic, client: aiomqtt.Client) -> None:
        assert topic.build is not None
        before: object = None
        while True:
            state = topic.build(self._context, "")
            if state != before:
                await self._publish(client, Publication(topic, msgspec.json.encode(state)))
                before = state
            await asyncio.sleep(POLLED_EVERY_S)

    async def _publish_states(self, client: aiomqtt.Client) -> None:
        while True:
            version = self._context.state_view.version
            for message in self._outgoing.states(self._context, clock_us()):
                await self._publish(client, message)
            await self._wait_for_change(version)

    async def _publish_announcements(self, client: aiomqtt.Client) -> None:
        while True:
            version = self._context.state_view.version
            for message in self._outgoing.announcements(self._context.state_view):
                await self._publish(client, message)
            await self._wait_for_change(version)

    async def _wait_for_change(self, version: int) -> None:
        """Wait for a change of the state view, but at most ``LONGEST_LOOK_S``."""
        await asyncio.sleep(LOOK_S)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(LONGEST_LOOK_S):
                await self._context.changed(version)

    async def _publish_front(self, client: aiomqtt.Client) -> None:
        """Publish the front at intervals, and soon after a correction of the fire."""
        context, loop = self._context, asyncio.get_running_loop()
        while True:
            began_s, version = loop.time(), context.state_view.fire_version
            front = {"schema": FRONT.schema, **await front_now(context)}
            await self._publish(client, Publication(FRONT, msgspec.json.encode(front)))
            await asyncio.sleep(CORRECTED_EVERY_S)
            while loop.time() - began_s < FRONT_EVERY_S:
                if context.state_view.fire_version != version:
                    break
                await asyncio.sleep(LONGEST_LOOK_S)

    # Commands ---------------------------------------------------------------------------------

    async def _receive(self, client: aiomqtt.Client) -> None:
        """Handle commands; raise the error of a lost connection even if nothing is published."""
        async for message in client.messages:
            self._handle(message)
            await asyncio.sleep(0)  # other tasks run between two commands

    def _handle(self, message: aiomqtt.Message) -> None:
        name = message.topic.value.rpartition("/")[2]
        payload = message.payload if isinstance(message.payload, bytes) else b""
        at_us, now_s = self._context.clock.now_us, clock_us() / 1e6
        reply = self._command_gate.accept(name, payload, message.retain, at_us, now_s, wall_us())
        if reply is not None:
            self._replies.append(reply)
            self._reply_waits.set()

    async def _send_replies(self, client: aiomqtt.Client) -> None:
        while True:
            await self._reply_waits.wait()
            while self._replies:
                reply = self._replies.popleft()
                payload = msgspec.json.encode(reply)
                with contextlib.suppress(ValueError):  # the client refuses the topic or the payload
                    await self._publish(client, Publication(REPLY, payload, reply.command))
            self._reply_waits.clear()
