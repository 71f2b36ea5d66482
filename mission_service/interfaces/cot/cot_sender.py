"""Exchanges Cursor on Target events by UDP (also multicast), TCP or TLS (table ``[service.cot]``).

The run never waits for a receiver. Each round sends the current state and drops events that cannot
be sent. Events that arrive on the connection are processed as reports of people
(``report_receiver.py``), or are dropped without ``[service.cot.reports]``.
"""

import asyncio
import itertools
import socket
import ssl
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any

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
from mission_service.interfaces.maps.run_fronts import expected_fronts, front_now
from mission_service.interfaces.mqtt.broker_connection import tls_of
from mission_service.runtime.clocks import clock_us, wall_us

if TYPE_CHECKING:
    from mission_service.runtime.run_context import RunContext

FIRE_EVERY = 10  # front and missions are sent once in this many rounds
FORECAST_EVERY, FORECAST_MIN = 60, (30.0, 60.0)
ROUNDS_UNTIL_STALE = 3
MIN_WAIT_S, MAX_WAIT_S = 1.0, 30.0
ALARM = "cot"


def cot_interface(
    settings: CotSection, scenario_name: str
) -> Callable[["RunContext"], Coroutine[Any, Any, None]]:
    """Return the coroutine function that sends events until cancelled.

    Raises MissionServiceError for unusable settings.
    """
    _tls(settings)

    async def run_interface(context: "RunContext") -> None:
        await CotSender(context, settings, site_of(scenario_name)).run()

    return run_interface


def _tls(settings: CotSection) -> ssl.SSLContext | None:
    """Return the TLS context of a connection. Raises MissionServiceError for unusable files."""
    if settings.scheme != "tls":
        return None
    return tls_of(settings.tls_ca, settings.tls_certificate, settings.tls_key)


class CotSender:
    """The sender of one run's events, which also makes the receiver of events."""

    def __init__(self, context: "RunContext", settings: CotSection, site: str) -> None:
        self._context, self._settings, self._site = context, settings, site
        self._sent: dict[str, int] = {}  # last version sent, by vehicle
        self._chat = AlarmChat(settings.chat, site)
        self._forecast: asyncio.Task[list[dict[str, Any]]] | None = None
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
                    try:
                        await self._rounds(transport)
                    finally:
                        transport.close()
                        self._chat.connection_lost(clock_us())
                        wait_s = MIN_WAIT_S
                except (OSError, TimeoutError, MissionServiceError) as error:
                    text = f"no CoT to {self._settings.url}: {str(error) or 'no response'}"
                    self._context.state_view.alarm(ALARM, text)
                    self._context.ring()
                await asyncio.sleep(wait_s)
                wait_s = min(2.0 * wait_s, MAX_WAIT_S)
        finally:
            if self._forecast is not None:
                self._forecast.cancel()

    async def _connect(self) -> CotTransport:
        """Connect. Raises OSError, TimeoutError or MissionServiceError.

        The certificates are read again, because they may have been replaced.
        """
        host, port = self._settings.host, self._settings.port
        if self._settings.scheme != "udp":
            reader, writer = await asyncio.open_connection(host, port, ssl=_tls(self._settings))
            return Stream(reader, writer, self._receiver)
        loop = asyncio.get_running_loop()
        addresses = await loop.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        family, _, _, _, address = addresses[0]
        return Datagrams(address, family, self._receiver)

    async def _rounds(self, transport: CotTransport) -> None:
        """Send rounds of events. Raises OSError or TimeoutError when the transport fails."""
        stale_us = round(ROUNDS_UNTIL_STALE * self._settings.every_s * 1e6)
        for number in itertools.count():
            await self._send_vehicles(transport, stale_us)
            if number % FIRE_EVERY == 0:
                await self._send_fire(transport, FIRE_EVERY * stale_us)
                await self._send_missions(transport, FIRE_EVERY * stale_us)
            await self._send_forecast(transport, number, FORECAST_EVERY * stale_us)
            for message in self._chat.messages(self._context.state_view.alarms.values(), wall_us()):
                await transport.send(message)
                self._chat.mark_sent(message, clock_us())
            self._context.state_view.clear_alarm(ALARM)
            if self._receiver is not None:
                self._receiver.handle_timer()
            await asyncio.sleep(self._settings.every_s)

    async def _send_vehicles(self, transport: CotTransport, stale_us: int) -> None:
        """Send positions that are new since the last round; receivers mark the others as stale."""
        state_view = self._context.state_view
        for name, fix in list(state_view.telemetry.items()):
            version = state_view.changed[f"telemetry/{name}"]
            if version > self._sent.get(name, 0):
                self._sent[name] = version
                kind = state_view.vehicles[name].kind
                await transport.send(vehicle_event(fix, kind, self._site, wall_us(), stale_us))

    async def _send_fire(self, transport: CotTransport, stale_us: int) -> None:
        front = await front_now(self._context)
        for event in fire_events(front, self._site, wall_us(), stale_us):
            await transport.send(event)

    async def _send_missions(self, transport: CotTransport, stale_us: int) -> None:
        for mission in list(self._context.state_view.missions.values()):
            event = mission_event(mission, self._site, wall_us(), stale_us)
            if event is not None:
                await transport.send(event)

    async def _send_forecast(self, transport: CotTransport, number: int, stale_us: int) -> None:
        """Begin a forecast every ``FORECAST_EVERY`` rounds; send it in the round after its end."""
        if number % FORECAST_EVERY == 0 and self._forecast is None:
            work = expected_fronts(self._context, FORECAST_MIN)
            self._forecast = asyncio.create_task(work)
        if self._forecast is None or not self._forecast.done():
            return
        done, self._forecast = self._forecast, None
        for event in forecast_events(done.result(), self._site, wall_us(), stale_us):
            await transport.send(event)
