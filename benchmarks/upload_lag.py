"""Delay of the event loop by uploaded files, request bodies and drawn shapes, over a socket.

    .venv/bin/python -m benchmarks.upload_lag [--estimate CELLS]

A probe task sleeps for 1 ms in a loop during the requests. The benchmark prints, for each request,
the largest delay of the probe (limit 50 ms), the response and its time.

With --estimate, the requests are those that change the estimate of a fire that has burned for four
hours, on CELLS x CELLS cells, without a socket: late reports and images, corrections, wind. Each is
measured with the estimate on the loop and in a thread, as in a live run. "Computing" is processor
time of the loop, which does not depend on other programs; compare delays with the line "idle".
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
import numpy as np

from mission_service.config.service_section import HttpSection
from mission_service.events import Observed
from mission_service.interfaces.api.server import bound, serving
from tests.api.worlds import World, scenario_of, served, world_in

LIMIT_MS = 50.0
V1 = "/api/v1"


class Probe:
    """Task that measures the largest delay of the event loop."""

    def __init__(self) -> None:
        self.latest_s = 0.0
        self.computed_s = 0.0  # most processor time of the loop's thread between two turns

    async def run(self) -> None:
        """Measure delays until cancelled."""
        while True:
            began_s, began_cpu_s = time.perf_counter(), time.thread_time()
            await asyncio.sleep(0.001)
            self.latest_s = max(self.latest_s, time.perf_counter() - began_s - 0.001)
            self.computed_s = max(self.computed_s, time.thread_time() - began_cpu_s)


def places(world: World, count: int, radius: float = 0.1, wave: float = 0.0) -> list[list[float]]:
    """Return a ring around the middle of the map as [lat, lon].

    ``wave`` is the fraction by which the radius of every second corner is larger.
    """
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
    """Return rings as the polygons of a GeoJSON MultiPolygon."""
    closed = [[[[lon, lat] for lat, lon in [*ring, ring[0]]]] for ring in rings]
    return json.dumps({"type": "MultiPolygon", "coordinates": closed}).encode()


def cases(world: World) -> list[tuple[str, str, bytes]]:
    """Return name, path and body of each request."""
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
        ("2,500 nested holes", "/fire/perimeter", holed),
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
    """Send all requests; return True if none delayed the loop beyond the limit."""
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
                await sender.stdout.readline()  # the start of the process is not measured
                for start in range(0, len(body), 65536):
                    sender.stdin.write(body[start : start + 65536])
                    await sender.stdin.drain()
                sender.stdin.close()
                await asyncio.sleep(0.05)
                probe.latest_s = 0.0
                output = await sender.stdout.read()
                await sender.wait()
                late_ms = 1e3 * probe.latest_s
                good = good and late_ms <= LIMIT_MS
                line = output.decode(errors="replace").strip()
                click.echo(f"{name:28} loop late {late_ms:7.1f} ms   {line[:110]}")
            probing.cancel()
    service.app.api.context.close()
    return good


def estimate_cases(world: World) -> list[tuple[str, dict[str, Any] | Observed]]:
    """Return the name of each case, with its request or its late image.

    Each case changes ground slightly farther from the fire than the case before.
    """
    land = world.context.landscape
    rows, cols = np.nonzero(world.context.estimate.fire.burned())
    top, left = int(rows.min()), int(cols[rows.argmin()])

    def ahead(cells: int, count: int) -> list[list[float]]:
        places = (land.xy_of(top - cells, left + k) for k in range(count))
        return [[float(value) for value in land.lat_lon_of(*place)] for place in places]

    def observed(cells: int, age_s: float, **more: Any) -> dict[str, Any]:
        report = {"do": "observe", "state": "burning", "shape": "points", **more}
        return {**report, "points": ahead(cells, 8), "age_s": age_s}

    def drawn(shape: str, points: list[list[float]]) -> dict[str, Any]:
        return {"do": "correct", "state": "burning", "shape": shape, "points": points}

    def noise(age_s: float) -> dict[str, Any]:
        south, west = (float(value) for value in land.lat_lon_of(*land.xy_of(rows.max(), left)))
        north, east = (float(value) for value in land.lat_lon_of(*land.xy_of(top, cols.max())))
        cells = np.random.default_rng(round(age_s)).choice(["b", "u"], (256, 256))
        bounds = {"south_deg": south, "west_deg": west, "north_deg": north, "east_deg": east}
        raster = {"do": "raster", **bounds, "rows": ["".join(row) for row in cells]}
        return {**raster, "age_s": age_s, "false_alarms_pct": 10.0, "missed_pct": 10.0}

    three_hours_ago_us = round((world.now_s - 10_800.0) * 1e6)
    image = Observed(three_hours_ago_us, "hawk", top - 40, left, ("b" * 12,) * 12)
    wind = {"do": "wind", "speed_m_s": 7.0}
    return [
        ("report, now", observed(3, 0.0)),
        ("report, 1 h old", observed(7, 3600.0)),
        ("report, 3 h old", observed(11, 10_800.0)),
        ("image, 3 h old", image),
        ("wind", {**wind, "from_deg": 100.0}),
        ("report, 3 h old, wind changed", observed(15, 10_800.0)),
        ("corrected line", drawn("line", ahead(18, 12))),
        ("corrected area of 1,000 corners", drawn("polygon", places(world, 1000))),
        ("wind, corrected", {**wind, "from_deg": 80.0}),
        ("report, 3 h old, corrected", observed(19, 10_800.0)),
        ("undo", {"do": "undo"}),
        ("redo", {"do": "redo"}),
        ("raster of noise", noise(60.0)),
        ("another raster of noise", noise(0.0)),
    ]


async def measured_estimate(world: World, in_thread: bool) -> bool:
    """Change the estimate in all ways; return True if none delayed the loop beyond the limit."""
    probe, estimate = Probe(), world.context.estimate
    tasks = [asyncio.create_task(probe.run())]
    if in_thread:
        tasks.append(asyncio.create_task(world.worker.fold_inputs()))
    await asyncio.sleep(0.1)
    good = True
    for name, case in [("idle", None), *estimate_cases(world)]:
        probe.latest_s = probe.computed_s = 0.0
        began_s, text = time.perf_counter(), ""
        if isinstance(case, Observed):
            world.simulation.service.handle_events([case], world.simulation.link_us)
        elif case is not None:
            handler = world.context.request_handler
            answer = await handler.ask_and_wait({**case, "by": "anna", "station": "tower"})
            text = str(answer.get("error", ""))
        while in_thread and estimate.is_behind:  # noqa: ASYNC110 - a late image has no reply
            await asyncio.sleep(0.01)
        took_s = time.perf_counter() - began_s
        await asyncio.sleep(0.5)
        late_ms, computed_ms = 1e3 * probe.latest_s, 1e3 * probe.computed_s
        good = good and late_ms <= LIMIT_MS
        click.echo(
            f"{name:32} loop late {late_ms:7.1f} ms, computing {computed_ms:6.1f} ms; "
            f"used after {took_s:5.2f} s   {text}"
        )
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return good


def main_estimate(cells: int) -> int:
    """Return 0 if no change of the estimate in a thread delayed the loop beyond the limit."""
    # The terrain of the scenario is 7 km wide around the fire.
    size = (f"landscape.{name}={cells}" for name in ("rows", "cols"))
    changes = (*size, f"landscape.cell_size_m={min(30, 10_000 // cells)}", "start_s=14400")
    good = True
    for in_thread in (False, True):
        with tempfile.TemporaryDirectory() as folder:
            scenario = scenario_of("demo", (*changes, "deploy_at_s=14400", "duration_s=20000"))
            world = world_in(Path(folder), scenario)
            world.fly(14_460.0)
            burned = int(world.context.estimate.fire.burned().sum())
            where = "in a thread" if in_thread else "on the loop"
            click.echo(f"{cells} x {cells} cells, {burned} burned; {where}; limit {LIMIT_MS:g} ms")
            found = asyncio.run(measured_estimate(world, in_thread))
            good = found if in_thread else good
    return 0 if good else 1


def send(url: str, authorization: str) -> None:
    """Send one request with the body from stdin and print the response and its time."""
    click.echo("", nl=True)
    body = sys.stdin.buffer.read()
    time.sleep(0.2)
    began_s = time.perf_counter()
    response = httpx.post(url, content=body, headers={"authorization": authorization}, timeout=120)
    took_s = time.perf_counter() - began_s
    click.echo(f"{took_s:5.1f} s  {response.status_code} {response.text[:80]!r}")


def main() -> int:
    """Return 0 if no request delayed the loop beyond the limit, else 1."""
    with tempfile.TemporaryDirectory() as folder:
        world = world_in(Path(folder), scenario_of("demo", ()))
        world.fly(3700.0)
        rows, cols = world.context.landscape.shape
        click.echo(f"landscape of {rows} x {cols} cells; limit {LIMIT_MS:g} ms")
        return 0 if asyncio.run(measured(world)) else 1


if __name__ == "__main__":
    if sys.argv[1:2] == ["--send"]:
        send(*sys.argv[2:4])
    elif sys.argv[1:2] == ["--estimate"]:
        sys.exit(main_estimate(int(sys.argv[2])))
    else:
        sys.exit(main())
