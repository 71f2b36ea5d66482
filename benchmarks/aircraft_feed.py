"""Feed of simulated aircraft as SBS text on TCP port 30003, to try the surveillance of a run.

The aircraft cross the area around a position at random heights and courses; some pass over the
position itself. Add to the scenario:

    [surveillance]
    [[surveillance.sources]]
    format = "sbs"
    address = "127.0.0.1:30003"
"""

import asyncio
import contextlib
import math
import random

import click

from benchmarks.aircraft_load import moved
from mission_service.ground_distance import M_PER_DEG, distance_m
from tests.service.aircraft_messages import Aircraft, sbs_lines

KINDS = (("N417EA", 55.0), ("LIFE3", 62.0), ("TNK07", 75.0), ("AAL212", 120.0), ("HELO9", 40.0))


def crossing(
    home: tuple[float, float], radius_m: float, heights_m: tuple[float, float], rng: random.Random
) -> Aircraft:
    """Return an aircraft at the edge of the area that flies towards a point near its centre."""
    angle, aside_m = rng.uniform(0.0, math.tau), rng.gauss(0.0, radius_m / 8.0)
    apart_m, course = radius_m * rng.uniform(0.6, 1.0), angle + math.pi
    name, speed_m_s = rng.choice(KINDS)
    north_m = apart_m * math.cos(angle) - aside_m * math.sin(course)
    east_m = apart_m * math.sin(angle) + aside_m * math.cos(course)
    lon_deg = home[1] + east_m / M_PER_DEG / math.cos(math.radians(home[0]))
    motion = (speed_m_s * math.cos(course), speed_m_s * math.sin(course), 0.0)
    address = rng.randrange(0xA00000, 0xAFFFFF)
    place = (home[0] + north_m / M_PER_DEG, lon_deg, rng.uniform(*heights_m))
    return Aircraft(address, *place, *motion, callsign=name)


async def feed(
    home: tuple[float, float],
    count: int,
    radius_m: float,
    heights_m: tuple[float, float],
    address: tuple[str, int],
    seed: int,
) -> None:
    """Serve all aircraft once a second until cancelled."""
    rng = random.Random(seed)
    crafts = [crossing(home, radius_m, heights_m, rng) for _ in range(count)]
    clients: set[asyncio.StreamWriter] = set()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        clients.add(writer)
        with contextlib.suppress(OSError):
            await reader.read()
        clients.discard(writer)

    server = await asyncio.start_server(serve, *address)
    async with server:
        while True:
            text = b"".join(map(sbs_lines, crafts))
            for writer in list(clients):
                writer.write(text)
            await asyncio.sleep(1.0)
            crafts = [moved(each, 1.0) for each in crafts]
            crafts = [
                each
                if distance_m(home, (each.lat_deg, each.lon_deg)) < 1.05 * radius_m
                else crossing(home, radius_m, heights_m, rng)
                for each in crafts
            ]


@click.command(help=__doc__)
@click.argument("lat_deg", type=float, default=36.3642)
@click.argument("lon_deg", type=float, default=-84.1409)
@click.option("--count", default=12)
@click.option("--radius-m", default=12_000.0)
@click.option("--heights-m", nargs=2, type=float, default=(450.0, 1500.0), help="Above the sea.")
@click.option("--host", default="127.0.0.1")
@click.option("--port", default=30_003)
@click.option("--seed", default=0)
def main(
    lat_deg: float,
    lon_deg: float,
    count: int,
    radius_m: float,
    heights_m: tuple[float, float],
    host: str,
    port: int,
    seed: int,
) -> None:
    """Serve the feed until Ctrl-C."""
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(feed((lat_deg, lon_deg), count, radius_m, heights_m, (host, port), seed))


if __name__ == "__main__":
    main()
