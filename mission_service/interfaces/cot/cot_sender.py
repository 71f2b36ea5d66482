"""Exchanges Cursor on Target events by UDP (also multicast), TCP or TLS (table ``[service.cot]``).

The run never waits for a receiver. Each round sends the current state and drops events that cannot
be sent. Events that arrive on the connection are processed as people's reports
(``event_receiver.py``), or dropped if neither ``[service.cot.reports]`` nor
``[service.cot.people]`` is configured.
"""

import asyncio
import itertools
import socket
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any

from firemodel.errors import FireModelError
from mission_service.config.mqtt_names import site_of
from mission_service.config.service_section import CotSection
from mission_service.errors import MissionServiceError
from mission_service.interfaces.cot.alarm_chat import AlarmChat
from mission_service.interfaces.cot.cot_events import (
    fire_events,
    forecast_events,
    mission_event,
    vehicle_event,
)
from mission_service.interfaces.cot.event_receiver import ABOUT, EventReceiver
from mission_service.interfaces.cot.tak_connections import (
    ANSWER_S,
    CotTransport,
    Datagrams,
    Stream,
)
from mission_service.interfaces.cot.tak_endpoint import endpoint_of
from mission_service.interfaces.maps.run_fronts import expected_fronts, front_now
from mission_service.runtime.clocks import clock_us, wall_us

if TYPE_CHECKING:
    from mission_service.runtime.run_context import RunContext

FIRE_EVERY = 10  # the front and missions are sent once in this many rounds
FORECAST_EVERY, FORECAST_MIN = 60, (30.0, 60.0)
ROUNDS_UNTIL_STALE = 3
MIN_WAIT_S, MAX_WAIT_S = 1.0, 8.0
ALARM = "cot"


def cot_interface(
    settings: CotSection, scenario_name: str
) -> Callable[["RunContext"], Coroutine[Any, Any, None]]:
    """Return the coroutine function that sends events until cancelled.

    Raises MissionServiceError for unusable settings.
    """
    endpoint_of(settings)

    async def run_interface(context: "RunContext") -> None:
        await CotSender(context, settings, site_of(scenario_name)).run()

    return run_interface


class CotSender:
    """The sender of one run's events, which also creates the receiver of events."""

    def __init__(self, context: "RunContext", settings: CotSection, site: str) -> None:
        self._context, self._settings, self._site = context, settings, site
        self._url = settings.url  # URL of the latest connection attempt
        # Last version sent, by vehicle. Positions from the journal of a resumed run are not sent.
        changed = context.state_view.changed
        self._sent = {name: changed[f"telemetry/{name}"] for name in context.state_view.telemetry}
        self._chat = AlarmChat(settings.chat, site)
        self._shapes: dict[str, asyncio.Task[list[bytes]]] = {}  # by name, until they are sent
        self._receiver: EventReceiver | None = None
        if settings.reports is not None or settings.people is not None:
            self._receiver = EventReceiver(context, settings, site)
        if settings.reports is not None and context.scenario.burn_flown is not None:
            text = "reports from TAK are not used: a burn uses cameras and corrections only"
            context.service.announce(ABOUT, text)

    async def run(self) -> None:
        """Send until cancelled; reconnect after a failure."""
        wait_s = MIN_WAIT_S
        try:
            while True:
                try:
                    async with asyncio.timeout(ANSWER_S):
                        transport = await self._connect()
                    self._chat.connected(clock_us())
                    try:
                        await self._rounds(transport)
                    finally:
                        self._chat.connection_lost(transport.alive_us())
                        transport.close()
                        wait_s = MIN_WAIT_S
                except (OSError, TimeoutError, UnicodeError, MissionServiceError) as error:
                    text = f"no CoT to {self._url}: {str(error) or 'no response'}"
                    self._context.state_view.alarm(ALARM, text)
                    self._context.ring()
                await asyncio.sleep(wait_s)
                wait_s = min(2.0 * wait_s, MAX_WAIT_S)
        finally:
            for work in self._shapes.values():
                work.cancel()

    async def _connect(self) -> CotTransport:
        """Connect. Raises OSError, TimeoutError, MissionServiceError, or, for a host, UnicodeError.

        The certificates are read again, because they may have been replaced.
        """
        endpoint = await asyncio.to_thread(endpoint_of, self._settings)
        self._url = endpoint.url
        if endpoint.scheme != "udp":
            name = self._settings.tls_server_name if endpoint.tls is not None else None
            reader, writer = await asyncio.open_connection(
                endpoint.host, endpoint.port, ssl=endpoint.tls, server_hostname=name
            )
            return Stream(reader, writer, self._receiver)
        loop = asyncio.get_running_loop()
        addresses = await loop.getaddrinfo(endpoint.host, endpoint.port, type=socket.SOCK_DGRAM)
        family, _, _, _, address = addresses[0]
        return Datagrams(address, family, self._receiver)

    async def _rounds(self, transport: CotTransport) -> None:
        """Send rounds of events. Raises OSError or TimeoutError when the transport fails."""
        stale_us = round(ROUNDS_UNTIL_STALE * self._settings.every_s * 1e6)
        self._shapes = {name: work for name, work in self._shapes.items() if not work.done()}
        for number in itertools.count():
            await self._send_vehicles(transport, stale_us)
            await self._send_chat(transport)
            if number % FIRE_EVERY == 0:
                await self._send_missions(transport, FIRE_EVERY * stale_us)
                self._begin("fire", self._fire, FIRE_EVERY * stale_us)
            if number % FORECAST_EVERY == 0:
                self._begin("forecast", self._forecast, FORECAST_EVERY * stale_us)
            await self._send_shapes(transport)
            self._context.state_view.clear_alarm(ALARM)
            if self._receiver is not None:
                self._receiver.handle_timer()
            await transport.wait(self._settings.every_s)

    async def _send_vehicles(self, transport: CotTransport, stale_us: int) -> None:
        """Send positions that are new since the last round; receivers mark the others as stale."""
        state_view = self._context.state_view
        for name in list(state_view.telemetry):
            fix = state_view.telemetry[name]
            version = state_view.changed[f"telemetry/{name}"]
            if version > self._sent.get(name, 0):
                self._sent[name] = version
                kind = state_view.vehicles[name].kind
                await _send(vehicle_event(fix, kind, self._site, wall_us(), stale_us), transport)

    async def _send_chat(self, transport: CotTransport) -> None:
        self._chat.handle_timer(clock_us())
        for message in self._chat.messages(self._context.state_view.alarms.values(), wall_us()):
            await _send(message, transport)
            self._chat.mark_sent(message, clock_us())

    async def _send_missions(self, transport: CotTransport, stale_us: int) -> None:
        for mission in list(self._context.state_view.missions.values()):
            event = mission_event(mission, self._site, wall_us(), stale_us)
            if event is not None:
                await _send(event, transport)

    def _begin(
        self, name: str, shapes: Callable[[int], Coroutine[Any, Any, list[bytes]]], stale_us: int
    ) -> None:
        """Begin computing shapes for a later round, unless earlier ones are still waiting."""
        if name not in self._shapes:
            self._shapes[name] = asyncio.create_task(shapes(stale_us))

    async def _send_shapes(self, transport: CotTransport) -> None:
        """Send the shapes that are complete."""
        for name in [name for name, work in self._shapes.items() if work.done()]:
            work = self._shapes.pop(name)
            for event in work.result():
                await _send(event, transport)

    async def _fire(self, stale_us: int) -> list[bytes]:
        return list(fire_events(await front_now(self._context), self._site, wall_us(), stale_us))

    async def _forecast(self, stale_us: int) -> list[bytes]:
        try:
            fronts = await expected_fronts(self._context, FORECAST_MIN)
        except FireModelError:
            return []  # the last forecast becomes stale
        return list(forecast_events(fronts, self._site, wall_us(), stale_us))


async def _send(event: bytes, transport: CotTransport) -> None:
    """Send an event. Raises OSError or TimeoutError when the transport fails."""
    await transport.send_event(event)
    await asyncio.sleep(0)  # other tasks run between two events
