"""TAK servers and clients of ``tak_restart.py``.

``python -m benchmarks.tak_peers PORT`` runs a relay as a TAK server. The relay passes each event on
to all other clients and stores nothing. Unlike a TAK server it does not answer pings.
"""

import asyncio
import contextlib
import math
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from benchmarks.link_shared import free_tcp_port
from mission_service.interfaces.cot.cot_events import zulu
from mission_service.interfaces.cot.event_framing import EventFramer
from mission_service.runtime.clocks import wall_us

MAX_UNSENT_BYTES = 16_000_000  # the relay drops events for a client that reads too slowly
RETRY_S = 0.1
CROWD_CONNECTIONS = 4
TAKY_CONF = """\
[taky]
hostname = 127.0.0.1
bind_ip = 127.0.0.1
root_dir = {folder}
[cot_server]
port = {port}
[ssl]
enabled = false
"""


class TakServer:
    """A server program on a fixed free port; ``taky`` is the path of taky, or None: the relay."""

    def __init__(self, folder: Path, taky: str | None) -> None:
        """Choose the port; start nothing yet."""
        self.port = free_tcp_port()
        self._command = [sys.executable, "-m", "benchmarks.tak_peers", str(self.port)]
        if taky is not None:
            conf = folder / "taky.conf"
            conf.write_text(TAKY_CONF.format(folder=folder, port=self.port), "utf-8")
            self._command = [taky, "-c", str(conf), "-l", "error"]
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> float:
        """Start the server; return the monotonic time in s at which it accepts connections."""
        self._process = subprocess.Popen(self._command)
        while True:
            with socket.socket() as sock:
                if sock.connect_ex(("127.0.0.1", self.port)) == 0:
                    return time.monotonic()
            if self._process.poll() is not None:
                raise SystemExit(f"the TAK server ended with code {self._process.returncode}")
            time.sleep(0.01)

    def kill(self) -> None:
        """End the server with SIGKILL."""
        if self._process is not None:
            self._process.send_signal(signal.SIGKILL)
            self._process.wait(timeout=10)
            self._process = None


class Seen(NamedTuple):
    """An event at the observer: monotonic time in s, and the text of its remarks."""

    at_s: float
    text: str


class Observer:
    """A client of the server that records the events of one site, by uid."""

    def __init__(self, port: int, site: str) -> None:
        """Record the events with uids that begin with the site, also chat messages."""
        self._port, self._site = port, site
        self.seen: dict[str, list[Seen]] = {}
        self.other_events = 0

    async def run(self) -> None:
        """Receive until cancelled; reconnect at once after a loss."""
        while True:
            with contextlib.suppress(OSError):
                reader, writer = await asyncio.open_connection("127.0.0.1", self._port)
                with contextlib.closing(writer):
                    framer = EventFramer()
                    while data := await reader.read(65_536):
                        for event in framer.receive(data):
                            self._record(event)
            await asyncio.sleep(RETRY_S)

    def _record(self, event: bytes) -> None:
        uid = event.partition(b"uid=")[2][1:200].partition(event[event.find(b"uid=") + 4 :][:1])[0]
        name = uid.decode().removeprefix("GeoChat.")
        if not name.startswith(f"{self._site}."):
            self.other_events += 1
            return
        text = ElementTree.fromstring(event).findtext("detail/remarks") or ""
        self.seen.setdefault(name, []).append(Seen(time.monotonic(), text))

    def first_after(self, since_s: float) -> dict[str, float]:
        """Return the first time of each uid after a time."""
        times = {
            uid: next((each.at_s for each in seen if each.at_s > since_s), math.inf)
            for uid, seen in self.seen.items()
        }
        return {uid: at_s for uid, at_s in times.items() if at_s < math.inf}


class Crowd:
    """People that send their positions to the server, evenly spread over an interval."""

    def __init__(self, port: int, count: int, every_s: float, corner: tuple[float, float]) -> None:
        """Place the people near a corner (latitude, longitude)."""
        self._port, self._count, self._every_s, self._corner = port, count, every_s, corner
        self.places: dict[int, tuple[float, float]] = {}  # in place of the usual ones, by person

    async def run(self) -> None:
        """Send until cancelled."""
        async with asyncio.TaskGroup() as group:
            for number in range(CROWD_CONNECTIONS):
                group.create_task(self._connection(range(number, self._count, CROWD_CONNECTIONS)))

    async def _connection(self, people: range) -> None:
        while True:
            with contextlib.suppress(OSError):
                reader, writer = await asyncio.open_connection("127.0.0.1", self._port)
                reading = asyncio.create_task(self._discard(reader))
                try:
                    await self._send(writer, people, lambda reading=reading: not reading.done())  # type: ignore[misc]
                finally:
                    reading.cancel()
                    writer.close()
            await asyncio.sleep(RETRY_S)

    async def _discard(self, reader: asyncio.StreamReader) -> None:
        with contextlib.suppress(OSError):
            while await reader.read(65_536):
                pass

    async def _send(
        self, writer: asyncio.StreamWriter, people: range, connected: Callable[[], bool]
    ) -> None:
        due_s, step_s = time.monotonic(), self._every_s / max(len(people), 1)
        while connected():
            for person in people:
                due_s += step_s
                await asyncio.sleep(max(due_s - time.monotonic(), 0.0))
                writer.write(self._position(person))
                await writer.drain()

    def _position(self, person: int) -> bytes:
        now_us = wall_us()
        lat, lon = self._corner
        place = (lat + 2e-4 * (person % 40) + 1e-6 * (now_us // 1_000_000 % 60), lon)
        lat, lon = self.places.get(person, (place[0], lon + 2e-4 * (person // 40)))
        return (
            f'<event version="2.0" uid="CROWD-{person}" type="a-f-G-U-C" how="m-g" '
            f'time="{zulu(now_us)}" start="{zulu(now_us)}" stale="{zulu(now_us + 60_000_000)}">'
            f'<point lat="{lat:.6f}" lon="{lon:.6f}" hae="500" ce="5" le="9999999"/><detail>'
            f'<contact callsign="Person {person}" endpoint="*:-1:stcp"/>'
            f'<__group name="Cyan" role="Team Member"/></detail></event>'
        ).encode()


class Relay:
    """A relay of events between its clients."""

    def __init__(self) -> None:
        """Start without clients."""
        self._clients: set[asyncio.StreamWriter] = set()

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Pass on the events of one client until it disconnects."""
        self._clients.add(writer)
        framer = EventFramer()
        with contextlib.suppress(OSError):
            while data := await reader.read(65_536):
                events = b"".join(framer.receive(data))
                for client in self._clients - {writer}:
                    if client.transport.get_write_buffer_size() < MAX_UNSENT_BYTES:
                        client.write(events)
        self._clients.discard(writer)
        writer.close()


async def relay(port: int) -> None:
    """Serve until the process is ended."""
    async with await asyncio.start_server(Relay().serve, "127.0.0.1", port) as server:
        await server.serve_forever()


if __name__ == "__main__":
    asyncio.run(relay(int(sys.argv[1])))
