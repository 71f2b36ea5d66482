"""Time of forecasts, overlays and tiles of a 500 x 500 fire: ``python -m benchmarks.maps``.

The delay of other tasks is measured by a task that sleeps for a millisecond in a loop.
"""

import asyncio
import json
import time
from collections.abc import Callable, Coroutine
from typing import Any

import click

from mission_service.config.scenario import Scenario, load_scenario
from mission_service.fire.forecast import Forecasts
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_fire import landscape_of
from mission_service.interfaces.maps import overlay
from mission_service.interfaces.maps.fronts import contours_geojson, probability_geojson
from mission_service.interfaces.maps.mercator import WORLD_M, mercator_box
from mission_service.interfaces.maps.terrain import TerrainTiles

HOUR_S = 3600.0
CELLS, CELL_M = 500, 20.0
TIMES = 5


def scenario() -> Scenario:
    """Return the default scenario on a large grid, with a wind that turns each hour."""
    winds = ", ".join(
        f"{{at_s={HOUR_S * k}, wind_speed_m_s={4 + k % 5}, wind_from_deg={(225 + 20 * k) % 360}, "
        "dead_1h_pct=6, dead_10h_pct=7, dead_100h_pct=8, live_herb_pct=60, live_woody_pct=80}"
        for k in range(24)
    )
    grid = (f"landscape.{name}={CELLS}" for name in ("rows", "cols"))
    changes = (*grid, f"landscape.cell_size_m={CELL_M}", f"weather=[{winds}]")
    return load_scenario("default", changes)


async def forecasts(estimate: RunEstimate) -> None:
    """Print the time of each forecast of a run, and the delay of other tasks during it."""
    late_s: list[float] = []

    async def beat() -> None:
        while True:
            due_s = time.perf_counter() + 0.001
            await asyncio.sleep(0.001)
            late_s.append(time.perf_counter() - due_s)

    version = [0]
    made = Forecasts(lambda: estimate, lambda: version[0])
    beating = asyncio.create_task(beat())
    now_s = estimate.fire.time_s
    requests: dict[str, Callable[[], Coroutine[Any, Any, Any]]] = {
        "arrival in 1 h": lambda: made.arrival(now_s + HOUR_S),
        "arrival in 6 h": lambda: made.arrival(now_s + 6 * HOUR_S),
        "probability in 6 h": lambda: made.probability(now_s + 6 * HOUR_S),
    }
    for name, request in requests.items():
        await request()
        await asyncio.sleep(0.05)
        late_s.clear()
        begun_s, used_s = time.perf_counter(), time.process_time()
        for _ in range(TIMES):
            version[0] += 1
            await request()
        wall_ms, cpu_ms = (
            1e3 * (after - before) / TIMES
            for after, before in ((time.perf_counter(), begun_s), (time.process_time(), used_s))
        )
        click.echo(
            f"{name:20} {wall_ms:7.1f} ms, {cpu_ms:7.1f} ms of CPU, "
            f"others late by at most {1e3 * max(late_s, default=0.0):.1f} ms"
        )
    beating.cancel()
    made.close()


def timed(name: str, work: Callable[[], Any]) -> Any:
    """Return the result of a function; print its first and its later times and the size."""
    begun_s = time.perf_counter()
    found = work()
    first_ms = 1e3 * (time.perf_counter() - begun_s)
    begun_s = time.perf_counter()
    for _ in range(TIMES):
        work()
    size = len(found) if isinstance(found, bytes) else len(json.dumps(found))
    then_ms = 1e3 * (time.perf_counter() - begun_s) / TIMES
    click.echo(
        f"{name:30} {first_ms:6.1f} ms at first, then {then_ms:5.1f} ms, {size / 1e3:.0f} kB"
    )
    return found


def main() -> None:
    """Measure forecasts and maps of an estimate without observations."""
    given = scenario()
    land = landscape_of(given)
    estimate = RunEstimate(given, land)
    estimate.advance(round(3 * HOUR_S * 1e6))
    asyncio.run(forecasts(estimate))
    fire = estimate.fire
    now_s = fire.time_s
    fire.advance(now_s + HOUR_S)
    arrival_s = fire.expected_s()
    times_s = [now_s + 1800.0, now_s + 3600.0]
    timed("contours at +30 and +60 min", lambda: contours_geojson(arrival_s, land, times_s, now_s))
    share = (arrival_s < now_s).astype(float)
    timed("bands of probability", lambda: probability_geojson(share, land, now_s, now_s))
    timed("overlay", lambda: overlay.arrival_png(arrival_s, land, 0.0, now_s + HOUR_S))
    tiles = TerrainTiles(land)
    described = tiles.describe()
    for z in range(described["minzoom"], described["maxzoom"] + 1):
        west, south, east, north = mercator_box(land)
        x = int(((west + east) / 2 / WORLD_M + 0.5) * 2**z)
        y = int((0.5 - (south + north) / 2 / WORLD_M) * 2**z)
        begun_s = time.perf_counter()
        tiles.tile(z, x, y)
        click.echo(f"a tile at zoom {z}: {1e3 * (time.perf_counter() - begun_s):.1f} ms")


if __name__ == "__main__":
    main()
