"""Receives data on other aircraft from the sources in ``[surveillance]`` in a live run.

Received bytes are collected and decoded a few times a second, because batches cost less than single
messages. A source that cannot be reached, is silent or sends too much raises an alarm.
"""

import asyncio
import ipaddress
import socket
from typing import Any

from mission_service.config.surveillance_section import AircraftSource, SurveillanceSection
from mission_service.runtime.clocks import clock_us, wall_us
from mission_service.runtime.run_context import RunContext
from mission_service.surveillance.aircraft_table import AircraftDecoder

EVERY_S = 0.25
CONNECT_S = 5.0
MIN_WAIT_S, MAX_WAIT_S = 1.0, 30.0
MAX_BUFFER = 256 * 1024  # maximum bytes between two decodings; more are discarded
ALARM = "surveillance"
UDP_FORMATS = ("gdl90", "cot")


class SourceReceiver:
    """The receiver of one source: it collects bytes, and decodes them when ``pump`` is called."""

    def __init__(self, source: AircraftSource, context: RunContext, silent_s: float) -> None:
        self.source = source
        self.rejected = 0  # messages rejected by the decoders of earlier connections
        self._context = context
        self._silent_us = round(1e6 * silent_s)
        self._decoder = self._new_decoder()
        self._buffer = bytearray()
        self._failure = "not connected yet"
        self._received_us = clock_us()
        self._dropped = False

    def _new_decoder(self) -> AircraftDecoder:
        return self._context.service.aircraft.decoder(self.source)

    @property
    def rejected_total(self) -> int:
        """The number of damaged or implausible messages since the start."""
        return self.rejected + self._decoder.rejected

    def collect(self, data: bytes) -> None:
        """Add received bytes; discard them if too many are waiting."""
        self._received_us = clock_us()
        self._dropped |= len(self._buffer) + len(data) > MAX_BUFFER
        if len(self._buffer) + len(data) <= MAX_BUFFER:
            self._buffer += data

    def connected(self) -> None:
        """Begin a new connection, whose first bytes begin a message."""
        self.rejected += self._decoder.rejected
        self._decoder, self._failure = self._new_decoder(), ""
        self._buffer.clear()
        self._received_us = clock_us()

    def failed(self, reason: str) -> None:
        """Record why the source cannot be received."""
        self._failure = reason

    def pump(self) -> str:
        """Decode the collected bytes; return the source's problem, or an empty text."""
        data, self._buffer = bytes(self._buffer), bytearray()
        dropped, self._dropped = self._dropped, False
        if data:
            self._decoder.decode(data, self._context.clock.now_us, wall_us())
        if self._failure:
            return f"no aircraft from {self.source.label}: {self._failure}"
        if dropped:
            kilobytes = MAX_BUFFER / EVERY_S / 1024
            return (
                f"{self.source.label} sends more than {kilobytes:.0f} kB/s; the rest is discarded"
            )
        if self._decoder.problem:
            return f"{self.source.label}: {self._decoder.problem}"
        if clock_us() - self._received_us > self._silent_us:
            return f"no data from {self.source.label} for {self._silent_us / 1e6:.0f} s"
        return ""

    async def receive(self) -> None:
        """Receive until cancelled; connect again after a failure."""
        wait_s = MIN_WAIT_S
        while True:
            try:
                if self.source.format in UDP_FORMATS:
                    await self._receive_datagrams()
                else:
                    await self._receive_stream()
                wait_s = MIN_WAIT_S
                self.failed("the server closed the connection")
            except (OSError, TimeoutError) as error:
                self.failed(str(error) or "no answer")
            await asyncio.sleep(wait_s)
            wait_s = min(2.0 * wait_s, MAX_WAIT_S)

    async def _receive_stream(self) -> None:
        """Receive from a TCP server until the connection ends. Raises OSError, TimeoutError."""
        async with asyncio.timeout(CONNECT_S):
            reader, writer = await asyncio.open_connection(self.source.host, self.source.port)
        try:
            self.connected()
            while data := await reader.read(65_536):
                self.collect(data)
        finally:
            writer.close()

    async def _receive_datagrams(self) -> None:
        """Receive datagrams until cancelled. Raises OSError."""
        loop = asyncio.get_running_loop()
        addresses = await loop.getaddrinfo(
            self.source.host, self.source.port, type=socket.SOCK_DGRAM
        )
        family, _, _, _, address = addresses[0]
        with _listening(address, family) as listener:
            self.connected()
            while True:
                self.collect(await loop.sock_recv(listener, 65_535))


def _listening(address: tuple[Any, ...], family: int) -> socket.socket:
    """Return a socket for datagrams to an address, or to a multicast group. Raises OSError."""
    if ipaddress.ip_address(address[0]).is_multicast:
        from mission_service.interfaces.cot.tak_connections import joined_group  # imports the maps

        return joined_group(address, family)
    listener = socket.socket(family, socket.SOCK_DGRAM)
    try:
        listener.setblocking(False)
        listener.bind(address)
    except OSError:
        listener.close()
        raise
    return listener


async def receive_aircraft(context: RunContext, section: SurveillanceSection) -> None:
    """Receive from a run's sources until cancelled, and show their problems as alarms."""
    receivers = [SourceReceiver(each, context, section.silent_s) for each in section.sources]
    table = context.service.aircraft.table
    context.gauges["aircraft_tracked"] = lambda: float(len(table.tracks))
    context.gauges["aircraft_rejected_total"] = lambda: float(
        sum(each.rejected_total for each in receivers)
    )
    quiet_until_us = clock_us() + round(1e6 * CONNECT_S)  # no alarm while connecting
    async with asyncio.TaskGroup() as group:
        for each in receivers:
            group.create_task(each.receive())
        while True:
            problems = {each.source.label: text for each in receivers if (text := each.pump())}
            if clock_us() >= quiet_until_us:
                context.state_view.show_alarms(ALARM, problems, "warning")
            await asyncio.sleep(EVERY_S)
