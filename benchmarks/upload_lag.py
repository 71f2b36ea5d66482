"""How late what comes from outside makes the event loop: files, bodies, strokes, over a socket.

    .venv/bin/python -m benchmarks.upload_lag

A probe sleeps 1 ms again and again beside the requests; it prints, for each of them, the latest
that it came back (limit 50 ms), the answer and how long that took.
"""

import asyncio
import json
import math
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import click
import httpx

from mission_service.config.service import HttpSection
from mission_service.interfaces.api.server import bound, serving
from tests.api.worlds import World, scenario_of, served, world_in

LIMIT_MS = 50.0
V1 = "/api/v1"


class Probe:
    """How late the loop was at worst since ``begin``."""

    def __init__(self) -> None:
        self.latest_s = 0.0

    async def run(self) -> None:
        """Until cancelled."""
        while True:
            began_s = time.perf_counter()
            await asyncio.sleep(0.001)
            self.latest_s = max(self.latest_s, time.perf_counter() - began_s - 0.001)


def places(world: World, count: int, radius: float = 0.1, wave: float = 0.0) -> list[list[float]]:
    """A ring on the middle of the map as [lat, lon]; ``wave``: its corners alternate by so much."""
    land = world.context.landscape
    rows, cols = land.shape
    found = []
    for k in range(count):
        at = radius * (1.0 + wave * (k % 2))
        angle = 2 * math.pi * k / count
        row, col = rows * (0.5 + at * math.sin(angle)), cols * (0.5 + at * math.cos(angle))
        found.append([float(value) for value in land.lat_lon_of(*land.xy_of(row, col))])
    return found


def drawn(rings: list[list[list[float]]]) -> bytes:
    """GeoJSON of rings, each a polygon."""
    closed = [[[[lon, lat] for lat, lon in [*ring, ring[0]]]] for ring in rings]
    return json.dumps({"type": "MultiPolygon", "coordinates": closed}).encode()


def cases(world: World) -> list[tuple[str, str, bytes]]:
    """Name, path and body of what is sent."""
    ring = places(world, 1000)

    def correct(**more: Any) -> bytes:
        return json.dumps({"state": "burning", **more}).encode()

    many = [places(world, 3000, 0.001 + 0.004 * k) for k in range(40)]
    holes = [[[lon, lat] for lat, lon in places(world, 100, 0.2)]]
    holes += [[[lon, lat] for lat, lon in places(world, 60, 0.001 + 4e-5 * k)] for k in range(2500)]
    holed = json.dumps({"type": "Polygon", "coordinates": [[*r, r[0]] for r in holes]}).encode()
    return [
        ("comb of 60,000 teeth", "/fire/perimeter", drawn([places(world, 60_000, 0.1, 0.3)])),
        ("40 rings of 3,000 corners", "/fire/perimeter", drawn(many)),
        ("2,500 holes in each other", "/fire/perimeter", holed),
        ("1,000,000 brackets", "/fire/perimeter", b'{"type":' + b"[" * 1_000_000),
        ("8 MB of numbers", "/fire/perimeter", b'{"x":[' + b"1.25," * 1_590_000 + b"1]}"),
        ("1 MB of brackets", "/wind", b"[" * 1_000_000),
        ("1 MB of numbers", "/wind", b'{"x":[' + b"1.25," * 200_000 + b"1]}"),
        ("1 MB of keys", "/wind", json.dumps({str(k): k for k in range(60_000)}).encode()),
        ("polygon of 1,000", "/fire/corrections", correct(shape="polygon", points=ring)),
        ("line of 1,000", "/fire/corrections", correct(shape="line", points=ring)),
        (
            "star of 1,000",
            "/fire/corrections",
            correct(shape="polygon", points=places(world, 1000, 0.05, 3.0)),
        ),
        (
            "scribble of 1,000",
            "/fire/corrections",
            correct(shape="polygon", points=[ring[k * 367 % 1000] for k in range(1000)]),
        ),
        ("undo", "/fire/undo", b"{}"),
        ("redo", "/fire/redo", b"{}"),
    ]


async def measured(world: World) -> bool:
    """Send all; whether the loop was held by none of it."""
    service, probe = served(world), Probe()
    with bound(HttpSection(listen="127.0.0.1:0")) as listening:
        address = listening.getsockname()
        stopping = service.app.api.streams.stopping
        async with serving(service.app.asgi, listening, stopping, None):
            probing = asyncio.create_task(probe.run())
            good = True
            for name, path, body in cases(world):
                headers = service.headers()
                sender = await asyncio.create_subprocess_exec(
                    *(sys.executable, "-m", "benchmarks.upload_lag", "--send"),
                    f"http://127.0.0.1:{address[1]}{V1}{path}",
                    headers["authorization"],
                    stdin=asyncio.subprocess.PIPE,
                    stdout=asyncio.subprocess.PIPE,
                )
                assert sender.stdin is not None
                assert sender.stdout is not None
                await sender.stdout.readline()  # it has begun: its start is not measured
                for start in range(0, len(body), 65536):
                    sender.stdin.write(body[start : start + 65536])
                    await sender.stdin.drain()
                sender.stdin.close()
                await asyncio.sleep(0.05)
                probe.latest_s = 0.0
                told = await sender.stdout.read()
                await sender.wait()
                late_ms = 1e3 * probe.latest_s
                good = good and late_ms <= LIMIT_MS
                line = told.decode(errors="replace").strip()
                click.echo(f"{name:28} loop late {late_ms:7.1f} ms   {line[:110]}")
            probing.cancel()
    service.app.api.close()
    return good


def send(url: str, authorization: str) -> None:
    """One request with the body from stdin, from a process of its own."""
    click.echo("", nl=True)
    body = sys.stdin.buffer.read()
    time.sleep(0.2)
    began_s = time.perf_counter()
    answer = httpx.post(url, content=body, headers={"authorization": authorization}, timeout=120)
    took_s = time.perf_counter() - began_s
    click.echo(f"{took_s:5.1f} s  {answer.status_code} {answer.text[:80]!r}")


def main() -> int:
    """0 if nothing held the loop for longer than the limit."""
    with tempfile.TemporaryDirectory() as folder:
        world = world_in(Path(folder), scenario_of("demo", ()))
        world.fly(3700.0)
        rows, cols = world.context.landscape.shape
        click.echo(f"landscape of {rows} x {cols} cells; limit {LIMIT_MS:g} ms")
        return 0 if asyncio.run(measured(world)) else 1


if __name__ == "__main__":
    if sys.argv[1:2] == ["--send"]:
        send(*sys.argv[2:4])
    else:
        sys.exit(main())
