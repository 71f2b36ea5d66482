"""Restart of a TAK server under load: ``python -m benchmarks.tak_restart [--taky PROGRAM]``.

The daemon flies mocks at real-time speed and sends them to a TAK server, over which a crowd sends
positions. The server is started after the daemon, and is later ended with SIGKILL, absent for some
time and started again. An observer, another client of the server, records what arrives. One person
of the crowd enters the fire just before each kill, so that an alarm may begin while the server
is absent. The server is a relay in a separate process, or taky (PyPI).

After each restart the daemon must reconnect within 10 s. From its first event on, the positions of
all vehicles must arrive within one interval; missions, fire and the chat messages of the severe
alarms of the moment of the restart within the interval of the fire; the forecast within its
interval; and all people must be used again, for which a forecast is computed, within a minute plus
two of their intervals. Memory (PSS) after the last restart may be 5 MiB above that after the first
one. The delay of the event loop may be 50 ms larger than before the server was started. The exit
code is 1 if a limit is exceeded.
"""

import argparse
import asyncio
import itertools
import json
import statistics
import tempfile
import time
from collections.abc import Awaitable, Callable, Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click

from benchmarks.link_shared import free_tcp_port
from benchmarks.load import Client, cpu_s, memory_mib, process, ready_after_s
from benchmarks.load_scenario import FIRE, Load, scenario_text
from benchmarks.shared import print_figures
from benchmarks.tak_peers import Crowd, Observer, TakServer
from mission_service.interfaces.cot.cot_sender import FIRE_EVERY, FORECAST_EVERY

SITE = "load"
CELLS = 250
EVERY_S = 2.0
MIN_POSITIONS = 2  # of a mission that is sent
ARRIVAL_EVERY_S = 20.0
CORNER = (36.289, -84.094)  # of the landscape, 9 km from the fire and beside its path
WITHIN_S = 150.0
RECONNECT_S, PEOPLE_S = 10.0, 60.0
LAG_S, GROWTH_MIB = 0.05, 5.0
SETTINGS = """
[service.cot]
url = "tcp://127.0.0.1:{port}"
every_s = {every_s}

[service.cot.people]
groups = ["Cyan"]
roles = ["Team Member"]

[service.fire_arrival]
every_s = {arrival_every_s}
"""


class Daemon:
    """Reads figures and state of the daemon over HTTP."""

    def __init__(self, client: Client, pid: int) -> None:
        """Use a client with a token."""
        self._client, self.pid = client, pid

    async def _get(self, path: str) -> bytes:
        return (await asyncio.to_thread(self._client.get, path))[1]

    async def lag_s(self) -> float:
        """Return the largest delay of the event loop in the last 15 s."""
        name = "mission_service_event_loop_lag_seconds "
        lines = (await self._get("/metrics")).decode().splitlines()
        return next(float(line.split()[1]) for line in lines if line.startswith(name))

    async def _state(self, key: str) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = json.loads(await self._get("/api/v1/state"))[key]
        return found

    async def missions_on_board(self) -> set[str]:
        """Return the uids of the missions on board that are sent: those with two positions."""
        found = set()
        for each in await self._state("missions"):
            items = (each["on_board"] or {"items": []})["items"]
            if sum(item["lat_deg"] is not None for item in items) >= MIN_POSITIONS:
                found.add(f"{SITE}.{each['vehicle']}.mission")
        return found

    async def severe_alarms(self) -> list[str]:
        """Return the texts of the active severe alarms."""
        return [
            each["text"] for each in await self._state("alarms") if each["severity"] == "severe"
        ]

    async def has_alarm(self, key: str) -> bool:
        """Return whether an alarm is active."""
        return any(each["alarm"] == key for each in await self._state("alarms"))

    async def people_after(self, unix_us: int) -> int:
        """Return the number of people with a position after a time."""
        arrivals = json.loads(await self._get("/api/v1/fire/arrivals"))
        return sum(
            each["kind"] == "person" and each["position_unix_us"] > unix_us for each in arrivals
        )

    async def load(self, seconds: float) -> tuple[float, float]:
        """Return the share of a core and the largest delay of the event loop within a time."""
        used_s, began_s = cpu_s(self.pid), time.monotonic()
        await asyncio.sleep(seconds)
        share = (cpu_s(self.pid) - used_s) / (time.monotonic() - began_s)
        return round(share, 3), await self.lag_s()


async def waited_s(what: Callable[[], Any], since_s: float, within_s: float = WITHIN_S) -> float:
    """Return the time in s since a monotonic time until a condition is met; infinity: never."""
    while time.monotonic() < since_s + within_s:
        found = what()
        if await found if asyncio.iscoroutine(found) else found:
            return round(time.monotonic() - since_s, 2)
        await asyncio.sleep(0.05)
    return float("inf")


def chat_texts(observer: Observer) -> set[str]:
    """Return the texts of all chat messages that the observer has received."""
    return {
        each.text.removeprefix("ALARM ")
        for uid, seen in observer.seen.items()
        if uid.startswith(f"{SITE}.service.")
        for each in seen
    }


def worst_interval_s(observer: Observer, uids: Iterable[str], since_s: float) -> float:
    """Return the longest time between two positions of a vehicle since a time."""
    worst = 0.0
    for uid in uids:
        times = [each.at_s for each in observer.seen[uid] if each.at_s > since_s]
        worst = max([worst, *(b - a for a, b in itertools.pairwise(times))])
    return round(worst, 2)


async def restarted(
    given: argparse.Namespace, daemon: Daemon, server: TakServer, peers: tuple[Observer, Crowd]
) -> dict[str, Any]:
    """Kill the server, start it again, and return the times until everything has arrived."""
    observer, crowd = peers
    before = set(observer.seen)
    person = len(crowd.places)
    crowd.places[person] = (FIRE[0], FIRE[1] + 0.0005 * person)
    await asyncio.sleep(given.every + 1.0)  # the position is sent
    server.kill()
    killed_s = time.monotonic()
    click.echo("killed", err=True)
    noticed_s = await waited_s(lambda: daemon.has_alarm("cot"), killed_s)
    await asyncio.sleep(max(killed_s + given.down - time.monotonic(), 0.0))
    alarms = await daemon.severe_alarms()
    unsent = set(alarms) - chat_texts(observer)
    started_s, started_us = await asyncio.to_thread(server.start), time.time_ns() // 1000
    click.echo("started again", err=True)
    await waited_s(lambda: observer.first_after(killed_s), started_s)
    first_s = min(observer.first_after(killed_s).values())

    def of_kind(kind: str) -> set[str]:
        return {uid for uid in before if uid.startswith(f"{SITE}.{kind}")}

    missions = await daemon.missions_on_board()
    vehicles = set(vehicle_uids(given))

    async def flown() -> bool:
        # A mission that is being replaced is not sent.
        return missions & await daemon.missions_on_board() <= observer.first_after(killed_s).keys()

    async def chatted() -> bool:
        return set(alarms) & set(await daemon.severe_alarms()) <= chat_texts(observer)

    async def counted() -> bool:
        used: int = await daemon.people_after(started_us)
        return used >= int(given.entities)

    async def cleared() -> bool:
        return not await daemon.has_alarm("cot")

    def seen(uids: set[str]) -> Callable[[], bool]:
        return lambda: uids <= observer.first_after(killed_s).keys()

    waits = {
        "vehicles_s": waited_s(seen(vehicles), first_s),
        "missions_s": waited_s(flown, first_s),
        "fire_s": waited_s(seen(of_kind("fire.1")), first_s),
        "forecast_s": waited_s(seen(of_kind("forecast.")), first_s),
        "chat_s": waited_s(chatted, first_s),
        "people_s": waited_s(counted, first_s),
        "cleared_s": waited_s(cleared, first_s),
    }

    async def reported(name: str, wait: Awaitable[float]) -> float:
        found_s = await wait
        click.echo(f"{name}: {found_s}", err=True)
        if name == "people_s":
            click.echo(f"{await daemon.people_after(started_us)} people", err=True)
        return found_s

    times_s = await asyncio.gather(*(reported(*each) for each in waits.items()))
    found = dict(zip(waits, times_s, strict=True))
    return {
        "noticed_s": noticed_s,
        "reconnected_s": round(first_s - started_s, 2),
        "alarms_begun_in_outage": len(unsent),
        **found,
    }


def vehicle_uids(given: argparse.Namespace) -> list[str]:
    """Return the uids of the vehicles' events."""
    return [f"{SITE}.uas{number + 1}" for number in range(given.vehicles)]


async def measure(given: argparse.Namespace, folder: Path, stack: ExitStack) -> dict[str, Any]:
    """Run daemon, mocks, server and clients; return all figures."""
    port, server = free_tcp_port(), TakServer(folder, given.taky)
    stack.callback(server.kill)
    path, out = folder / "load.toml", folder / "out"
    extra = SETTINGS.format(port=server.port, every_s=EVERY_S, arrival_every_s=ARRIVAL_EVERY_S)
    path.write_text(
        scenario_text(Load(given.vehicles, cells=CELLS, http_port=port, extra=extra)), "utf-8"
    )
    stack.enter_context(process("benchmarks.load_mocks", str(path)))
    command = ("mission_service.cli", "run", str(path), "--out", str(out), "--json")
    running = stack.enter_context(process(*command, out=given.log or folder / "daemon.log"))
    await asyncio.to_thread(ready_after_s, Client(port), time.monotonic(), running)
    daemon = Daemon(Client(port, (out / "token").read_text("ascii").strip()), running.pid)
    await asyncio.sleep(given.warm_up)
    figures: dict[str, Any] = {"vehicles": given.vehicles, "entities": given.entities}
    click.echo("flying without a TAK server", err=True)
    figures["core_without"], figures["lag_without_s"] = await daemon.load(given.seconds)
    observer = Observer(server.port, SITE)
    crowd = Crowd(server.port, given.entities, given.every, CORNER)
    peers = [asyncio.create_task(each.run()) for each in (observer, crowd)]
    try:
        await asyncio.to_thread(server.start)
        vehicles = vehicle_uids(given)
        connected_s = await waited_s(
            lambda: {*vehicles, f"{SITE}.fire.1"} <= observer.seen.keys(), time.monotonic()
        )
        figures["first_s"] = connected_s
        await waited_s(
            lambda: any(uid.startswith(f"{SITE}.forecast") for uid in observer.seen),
            time.monotonic(),
        )
        click.echo(f"{json.dumps(figures)}; the server has everything", err=True)
        steady_s = time.monotonic()
        figures["core"], figures["lag_s"] = await daemon.load(given.seconds)
        figures["interval_s"] = worst_interval_s(observer, vehicles, steady_s)
        figures["restarts"], lags = [], []
        memory = []
        for _ in range(given.restarts):
            figures["restarts"].append(await restarted(given, daemon, server, (observer, crowd)))
            click.echo(json.dumps(figures), err=True)
            lags.append(await daemon.lag_s())
            await asyncio.sleep(given.seconds)
            memory.append(round(memory_mib(daemon.pid), 1))
    finally:
        for peer in peers:
            peer.cancel()
    figures["lag_restarts_s"], figures["pss_mib"] = max(lags), memory
    figures["crowd_events_received"] = observer.other_events
    figures["intervals_p50_s"] = round(
        statistics.median(
            b.at_s - a.at_s for uid in vehicles for a, b in itertools.pairwise(observer.seen[uid])
        ),
        2,
    )
    return figures


def exceeded_limits(given: argparse.Namespace, figures: dict[str, Any]) -> list[str]:
    """Return one line for each exceeded limit."""
    limits = {
        "reconnected_s": RECONNECT_S,
        "vehicles_s": EVERY_S,
        "missions_s": FIRE_EVERY * EVERY_S,
        "fire_s": FIRE_EVERY * EVERY_S,
        "chat_s": FIRE_EVERY * EVERY_S,
        "forecast_s": FORECAST_EVERY * EVERY_S,
        "people_s": PEOPLE_S + 2.0 * given.every,
    }
    over = [
        f"{name}: {each[name]} > {most}"
        for each in figures["restarts"]
        for name, most in limits.items()
        if each[name] > most
    ]
    if figures["pss_mib"][-1] > figures["pss_mib"][0] + GROWTH_MIB:
        over.append(f"pss_mib: {figures['pss_mib']}")
    if max(figures["lag_s"], figures["lag_restarts_s"]) > figures["lag_without_s"] + LAG_S:
        over.append("lag_s")
    return over


def main() -> None:
    """Print the figures; exit with 1 if a limit is exceeded."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=50)
    parser.add_argument("--entities", type=int, default=1000)
    parser.add_argument("--every", type=float, default=4.0, help="interval of a person's positions")
    parser.add_argument("--down", type=float, default=20.0, help="seconds without a server")
    parser.add_argument("--restarts", type=int, default=3)
    parser.add_argument("--warm-up", type=float, default=60.0)
    parser.add_argument("--seconds", type=float, default=30.0, help="duration of each measurement")
    parser.add_argument("--taky", help="path of the program taky")
    parser.add_argument("--log", type=Path, help="file for the log of the daemon")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        figures = asyncio.run(measure(given, Path(folder), stack))
    print_figures(figures, exceeded_limits(given, figures))


if __name__ == "__main__":
    main()
