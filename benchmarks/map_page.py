"""The page with many aircraft and a long front: ``python -m benchmarks.map_page [--minutes N]``.

The benchmark runs a daemon, mocks in a separate process (as ``load.py``) and headless Chromium with
the built page. It sends the perimeter of a fire with many fingers; the front has at least 2,000
vertices. Reported are the bytes of the page before tiles, its first paint (median of three), and,
for the map at rest and while it pans and zooms: intervals between animation frames, long tasks, and
the processor time of the page's main thread for a frame (script, style, layout, paint) and for all
else. ``at_60`` is the time for a frame at 60 frames a second: the frame and its share of all else.
It does not contain the drawing: headless Chromium draws with the processor, other browsers with the
graphics card, so the frames per second are those of this machine. Then the JavaScript heap after a
garbage collection, the nodes and the listeners are read each minute. The growth of the heap is that
of the second half, because tracks become longer for 15 minutes.

The exit code is 1 if a limit is exceeded: 1.5 MB, 1 s, 16.7 ms for 95 % of the frames, and, after
at least 40 minutes, a growth of 2 MiB an hour.
"""

import argparse
import json
import math
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import numpy as np
from playwright.sync_api import Browser, CDPSession, Page, ViewportSize, sync_playwright

from benchmarks.link_shared import free_tcp_port
from benchmarks.load import Client, cpu_s, process, ready_after_s
from benchmarks.load_scenario import FIRE, M_PER_DEG, Load, scenario_text
from benchmarks.shared import print_figures
from tests.web.browser import CHROMIUM, FLAGS, context_of

MIN_VERTICES = 2000
FINGERS, RADIUS_M, FINGER_M = 34, 2000.0, 350.0
WARM_UP_S = 60.0  # the vehicles take off and fly to the front
SETTLES_S = 15.0  # tiles and texts of the first view
FRAMES_S = 20.0  # of each measurement of frames
PAINTS = 3
BLOCK = 5
LIMITS = {
    "bytes": 1_500_000,
    "first_paint_ms": 1000.0,
    "rest_at_60_p95_ms": 16.7,
    "motion_at_60_p95_ms": 16.7,
    "mib_per_hour": 2.0,
}
MIN_MINUTES_OF_GROWTH = 40.0  # tracks have reached their length, 15 minutes, in the first half
GIVEN_UP_S = 120.0
TASK = "ThreadControllerImpl::RunTask"  # in a trace of Chromium
SIZE: ViewportSize = {"width": 1440, "height": 900}

START = """() => {
    window.measured = { frames: [], tasks: [], isOn: true };
    const observer = new PerformanceObserver((list) =>
        window.measured.tasks.push(...list.getEntries().map((each) => each.duration)));
    observer.observe({ entryTypes: ["longtask"] });
    const frame = (now) => {
        window.measured.frames.push(now);
        if (window.measured.isOn) requestAnimationFrame(frame);
        else observer.disconnect();
    };
    requestAnimationFrame(frame);
}"""
STOP = "() => { window.measured.isOn = false; return window.measured; }"
MOVE = """(seconds) => {
    const end = performance.now() + seconds * 1000;
    const home = missionMap.getCenter();
    let turn = 0;
    const next = () => {
        if (performance.now() > end) return missionMap.jumpTo({ center: home });
        turn += 2;
        const center = [home.lng + 0.02 * Math.cos(turn), home.lat + 0.015 * Math.sin(turn)];
        const zoom = 12.5 + Math.sin(turn);
        missionMap.easeTo({ center, zoom, duration: 1500, easing: (t) => t });
        missionMap.once("moveend", next);
    };
    next();
}"""
PAINT_MS = "performance.getEntriesByName('first-contentful-paint')[0].startTime"
BYTES = """performance.getEntriesByType("navigation")
    .concat(performance.getEntriesByType("resource"))
    .filter((each) => !each.name.includes("/api/"))
    .reduce((sum, each) => sum + each.transferSize, 0)"""


def perimeter() -> dict[str, Any]:
    """Return the perimeter of a fire with many fingers, as GeoJSON."""
    corners = FINGERS * 24
    ring = []
    for corner in range(corners + 1):
        turn = math.tau * (corner % corners) / corners
        far_m = RADIUS_M + FINGER_M * math.sin(FINGERS * turn)
        lat = FIRE[0] + far_m * math.cos(turn) / M_PER_DEG
        lon = FIRE[1] + far_m * math.sin(turn) / M_PER_DEG / math.cos(math.radians(FIRE[0]))
        ring.append([lon, lat])
    return {
        "type": "Feature",
        "properties": {},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }


def vertices(client: Client) -> int:
    """Return the number of vertices of the front that the page draws."""
    front = json.loads(client.get("/api/v1/fire/front")[1])
    return sum(len(ring) for part in front["geometry"]["coordinates"] for ring in part)


def main_thread_ms(trace: bytes) -> tuple[list[float], float]:
    """Return the processor time of each frame on the page's main thread, and of all else, in ms.

    ``trace`` is a trace of Chromium with the categories ``toplevel`` and ``devtools.timeline``. A
    frame is the task in which an animation frame ends: script, style, layout and paint.
    """
    events = json.loads(trace)["traceEvents"]
    ended = [each for each in events if each["name"] == "AnimationFrame" and each["ph"] == "e"]
    threads = [(each["pid"], each["tid"]) for each in ended]
    thread = max(set(threads), key=threads.count)
    marks = np.sort([each["ts"] for each in ended if (each["pid"], each["tid"]) == thread])
    frame_ms, other_ms = [], 0.0
    for each in events:
        if (each["pid"], each["tid"]) != thread or each["name"] != TASK or "tdur" not in each:
            continue
        first = np.searchsorted(marks, each["ts"])
        if first < len(marks) and marks[first] <= each["ts"] + each["dur"]:
            frame_ms.append(each["tdur"] / 1e3)
        else:
            other_ms += each["tdur"] / 1e3
    return frame_ms, other_ms


def percentile(values: list[float], percent: float) -> float:
    """Return a percentile with one decimal."""
    return round(float(np.percentile(values, percent)), 1)


def metrics(session: CDPSession) -> dict[str, float]:
    """Return the performance metrics of the page; durations are processor time, in s."""
    found = session.send("Performance.getMetrics")["metrics"]
    return {each["name"]: float(each["value"]) for each in found}


def frames(page: Page, session: CDPSession, name: str) -> dict[str, float]:
    """Measure animation frames for ``FRAMES_S``; the keys of the figures begin with ``name``."""
    browser = page.context.browser
    assert browser is not None
    before = metrics(session)
    browser.start_tracing(page=page, categories=["toplevel", "devtools.timeline"])
    page.evaluate(START)
    page.wait_for_timeout(FRAMES_S * 1e3)
    seen: Any = page.evaluate(STOP)
    frame_ms, other_ms = main_thread_ms(browser.stop_tracing())
    after = metrics(session)
    intervals_ms = [float(each) for each in np.diff(seen["frames"])]

    def ms_per_s(*keys: str) -> float:
        spent_s = sum(after[key] - before[key] for key in keys)
        return round(1e3 * spent_s / (after["Timestamp"] - before["Timestamp"]), 1)

    return {
        f"{name}_frames_per_s": round(1e3 / statistics.mean(intervals_ms), 1),
        f"{name}_interval_median_ms": percentile(intervals_ms, 50),
        f"{name}_interval_p95_ms": percentile(intervals_ms, 95),
        f"{name}_long_tasks": len(seen["tasks"]),
        f"{name}_longest_task_ms": round(max(seen["tasks"], default=0.0)),
        f"{name}_script_ms_per_s": ms_per_s("ScriptDuration"),
        f"{name}_style_layout_ms_per_s": ms_per_s("LayoutDuration", "RecalcStyleDuration"),
        f"{name}_main_ms_per_s": ms_per_s("TaskDuration"),
        f"{name}_frame_median_ms": percentile(frame_ms, 50),
        f"{name}_frame_p95_ms": percentile(frame_ms, 95),
        f"{name}_other_ms_per_s": round(other_ms / FRAMES_S, 1),
        f"{name}_at_60_p95_ms": round(percentile(frame_ms, 95) + other_ms / FRAMES_S / 60, 1),
    }


def heap(session: CDPSession) -> dict[str, float]:
    """Return the heap in MiB after a garbage collection, and the numbers of nodes and listeners."""
    for _ in range(2):
        session.send("HeapProfiler.collectGarbage")
    found = metrics(session)
    return {
        "heap_mib": round(found["JSHeapUsedSize"] / 2**20, 2),
        "nodes": found["Nodes"],
        "listeners": found["JSEventListeners"],
    }


def growth(samples: list[tuple[float, float]]) -> float:
    """Return the slope of the second half of samples (hours, MiB) in MiB an hour.

    Only the smallest of ``BLOCK`` successive samples counts: others contain data in processing.
    """
    half = samples[len(samples) // 2 :]
    blocks = [half[start : start + BLOCK] for start in range(0, len(half) - BLOCK + 1, BLOCK)]
    least = [min(block, key=lambda sample: sample[1]) for block in blocks]
    return round(statistics.linear_regression(*zip(*least, strict=True)).slope, 2)


def watch(
    page: Page, session: CDPSession, minutes: float
) -> Iterator[tuple[float, dict[str, float]]]:
    """Yield the time in hours and the heap, once a minute."""
    began_s = time.monotonic()
    for minute in range(math.floor(minutes) + 1):
        page.wait_for_timeout(max(0.0, began_s + 60 * minute - time.monotonic()) * 1e3)
        yield (time.monotonic() - began_s) / 3600, heap(session)


def measure(many: int, minutes: float, folder: Path) -> dict[str, Any]:
    """Run daemon, mocks and page; return all figures."""
    port = free_tcp_port()
    path, out = folder / "map.toml", folder / "out"
    path.write_text(scenario_text(Load(many, http_port=port)), "utf-8")
    with process("benchmarks.load_mocks", str(path)):
        time.sleep(3.0)  # the mocks fly without a daemon
        began_s = time.monotonic()
        command = ("mission_service.cli", "run", str(path), "--out", str(out), "--json")
        with process(*command, out=folder / "daemon.log") as daemon:
            ready_after_s(Client(port), began_s, daemon)
            token = (out / "token").read_text("ascii").strip()
            client = Client(port, token)
            status, answer = client.post("/api/v1/fire/perimeter", perimeter(), 60.0)
            if status != 200 or vertices(client) < MIN_VERTICES:
                sys.exit(f"no front of {MIN_VERTICES} vertices: {status} {answer.decode()[:500]}")
            time.sleep(WARM_UP_S)
            used_s, at_s = cpu_s(daemon.pid), time.monotonic()
            figures = in_browser(client, f"http://127.0.0.1:{port}/#token={token}", minutes)
            share = (cpu_s(daemon.pid) - used_s) / (time.monotonic() - at_s)
    return {"vehicles": many, **figures, "daemon_core": round(share, 3)}


def first_paint_ms(browser: Browser, address: str) -> float:
    """Open the page ``PAINTS`` times with an empty cache; return the median first paint."""
    found = []
    for _ in range(PAINTS):
        with context_of(browser, viewport=SIZE) as context:
            page = context.new_page()
            page.goto(address)
            page.wait_for_selector("#map[data-ready]", timeout=GIVEN_UP_S * 1e3)
            found.append(float(page.evaluate(PAINT_MS)))
    return round(statistics.median(found))


def in_browser(client: Client, address: str, minutes: float) -> dict[str, Any]:
    """Open the page and measure it."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        figures: dict[str, Any] = {"first_paint_ms": first_paint_ms(browser, address)}
        page = context_of(browser, viewport=SIZE).new_page()
        page.goto(address)
        page.wait_for_selector("#map[data-ready]", timeout=GIVEN_UP_S * 1e3)
        session = page.context.new_cdp_session(page)
        session.send("Performance.enable", {"timeDomain": "threadTicks"})
        page.wait_for_timeout(SETTLES_S * 1e3)
        figures["bytes"] = page.evaluate(BYTES)
        figures |= frames(page, session, "rest")
        page.evaluate(MOVE, FRAMES_S + 2)
        figures |= frames(page, session, "motion")
        figures["vertices"] = vertices(client)
        samples = []
        for hours, found in watch(page, session, minutes):
            line = {"minute": round(60 * hours), "vertices": vertices(client), **found}
            click.echo(json.dumps(line), err=True)
            samples.append((hours, found["heap_mib"]))
            figures |= found
        if minutes >= MIN_MINUTES_OF_GROWTH:
            figures["mib_per_hour"] = growth(samples)
        browser.close()
    return figures


def beyond(figures: dict[str, Any]) -> list[str]:
    """Return one line for each exceeded limit."""
    return [
        f"{key}: {figures[key]} > {most}"
        for key, most in LIMITS.items()
        if figures.get(key, 0.0) > most
    ]


def main() -> None:
    """Print the figures; exit with 1 if a limit is exceeded."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=100)
    parser.add_argument("--minutes", type=float, default=2.0, help="minutes of the heap's growth")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        figures = measure(given.vehicles, given.minutes, Path(folder))
    print_figures(figures, beyond(figures))


if __name__ == "__main__":
    main()
