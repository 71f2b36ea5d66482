"""Time of forecasts, overlays and tiles of a 500 x 500 fire: ``python -m benchmarks.maps``.

The delay of other tasks is measured by a task that sleeps for a millisecond in a loop.
"""

import asyncio
import json
import time
from collections.abc import Callable, Coroutine
from typing import Any

import click

from firemodel.landscape.default import jacksboro
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.devs8 import Devs8Fire
from firemodel.spread.fire_scheme import Fire
from mission_service.fire.forecast import Forecasts
from mission_service.interfaces.maps import overlay
from mission_service.interfaces.maps.fronts import contours_geojson, probability_geojson
from mission_service.interfaces.maps.mercator import WORLD_M, mercator_box
from mission_service.interfaces.maps.terrain import TerrainTiles

HOUR_S = 3600.0
CELLS, CELL_M = 500, 20.0
TIMES = 5


def weather() -> WeatherStream:
    """Return weather with a wind that turns each hour."""
    return WeatherStream(
        [
            Weather(HOUR_S * k, 4.0 + k % 5, (225.0 + 20.0 * k) % 360.0, 6.0, 7.0, 8.0, 60.0, 80.0)
            for k in range(24)
        ]
    )


async def forecasts(fire: Fire) -> None:
    """Print the time of each forecast of a fire, and the delay of other tasks meanwhile."""
    late_s: list[float] = []

    async def beat() -> None:
        while True:
            due_s = time.perf_counter() + 0.001
            await asyncio.sleep(0.001)
            late_s.append(time.perf_counter() - due_s)

    version = [0]
    made = Forecasts(lambda: fire, lambda: version[0], seed=1)
    beating = asyncio.create_task(beat())
    now_s = fire.time_s
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
            f"{type(fire).__name__:14} {name:20} {wall_ms:7.1f} ms, {cpu_ms:7.1f} ms of CPU, "
            f"others late by {1e3 * max(late_s, default=0.0):.1f} ms at worst"
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
    """Measure forecasts of both schemes, and maps of the first."""
    land = jacksboro(CELLS, CELLS, CELL_M)
    fires: list[Fire] = [
        scheme(land, weather(), [(CELLS // 2, CELLS // 2, 0.0)])
        for scheme in (AnyAngleFire, Devs8Fire)
    ]
    for fire in fires:
        fire.advance(3 * HOUR_S)
        begun_s = time.perf_counter()
        for _ in range(TIMES):
            fire.copy()
        click.echo(f"a copy {1e3 * (time.perf_counter() - begun_s) / TIMES:.1f} ms")
        asyncio.run(forecasts(fire))
    fire = fires[0]
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
