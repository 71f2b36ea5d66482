"""The live service: vehicles on their links, one TaskGroup. The only place with a real clock."""

import asyncio
import contextlib
import signal
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Literal

from autopilot_bridge.autopilot import Autopilot
from autopilot_bridge.client import VehicleClient
from autopilot_bridge.connection import Connection
from autopilot_bridge.mavsdk_vehicle import MavsdkVehicle
from autopilot_bridge.rates import RatesHz
from autopilot_bridge.signing import Signing
from autopilot_bridge.tlog import Tlog
from mission_service.burn.mission import return_height_m
from mission_service.commands import Announce
from mission_service.config import Scenario
from mission_service.config_sections import VehicleSection
from mission_service.control import Desk, claimed, serve_control
from mission_service.control_client import NAME
from mission_service.core import Core
from mission_service.events import CrewEvent
from mission_service.fire_setup import fire_of, landscape_of
from mission_service.formation.messages import AnyMessage
from mission_service.formation.warm_up import warm_up
from mission_service.formation_mqtt import Channel, Exchange
from mission_service.gateway import Gateway, MissionClock, dropper_of, rates_hz
from mission_service.journal import Journal, header_of
from mission_service.planning import BURN, FORMATION
from mission_service.record import Record
from mission_service.resume import Unfinished, resumed, set_aside, unfinished
from mission_service.service import Service, unheard
from mission_service.signed import Refusals, refusal, signings
from mission_service.world import FireWorld

STATUS_EVERY_S = 0.2
TELL_SILENCE_AFTER_US = 4_000_000


def clock_us() -> int:
    """Microseconds of the machine's monotonic clock."""
    return time.monotonic_ns() // 1000


def wall_us() -> int:
    """Microseconds since 1970, for the records of a .tlog."""
    return time.time_ns() // 1000


def last_written_s(path: Path) -> float:
    """When a file was last written to, in seconds since 1970."""
    return path.stat().st_mtime


async def serve(
    scenario: Scenario,
    journal_path: Path,
    created: str,
    progress: Callable[[Record, FireWorld], None] = lambda record, world: None,
    watch: Callable[[], None] = lambda: None,
    tlog_path: Path | None = None,
    channel: Channel | None = None,
) -> tuple[Record, FireWorld]:
    """Run until mission time reaches the scenario's end, or SIGINT or SIGTERM.

    The vehicles keep the mission on board, which ends in a loiter. ``progress`` is called five
    times a second; ``watch`` may raise to end the run (a child process that died, say). The traffic
    of all links is added to the .tlog, if one is named. Over ``channel`` the vehicles talk to those
    of other processes.
    """
    landscape = landscape_of(scenario)
    digest = landscape.digest()
    if scenario.planner.rule == FORMATION:  # compiling takes long: nobody flies yet
        warm_up(scenario.formation.avoidance)
    burns = scenario.planner.rule == BURN
    if burns:
        from mission_service.burn_preview import warm_up as warm_up_burn

        warm_up_burn(scenario, landscape)
    world = FireWorld(fire_of(scenario, landscape), landscape)
    clock = MissionClock(round(scenario.start_s * 1e6), wall=scenario.clock == "wall")
    world.advance(clock.now_us)
    record = Record(tuple(section.name for section in scenario.flown), clock.now_us)
    gateways: dict[str, Gateway] = {}
    async with contextlib.AsyncExitStack() as stack:
        if any(section.backend == "mavsdk" for section in scenario.flown):
            # Each may have a transfer and a command under way, in a thread each.
            threads = ThreadPoolExecutor(2 * len(scenario.flown) + 2)
            asyncio.get_running_loop().set_default_executor(threads)
        listening = stack.enter_context(claimed(journal_path.parent / NAME)) if burns else None
        # Links first: a port in use must not cost an earlier run its journal.
        connections: list[Connection | MavsdkVehicle] = []
        refusals: list[Refusals] = []
        tlog = stack.enter_context(Tlog(tlog_path, wall_us)) if tlog_path else None
        sources = [section.signing_key for section in scenario.flown]
        signing_of = stack.enter_context(
            signings(sources, wall_us, lambda text: tell(record, "service", text))
        )
        for section in scenario.flown:
            signing = signing_of.get(section.signing_key)
            client, connection = _client_of(
                section, rates_hz(scenario), tlog, signing, len(connections)
            )
            gateways[section.name] = Gateway(
                section.name,
                client,
                clock,
                dropper_of(scenario),
                return_height_m(scenario, landscape),
            )
            connections.append(await stack.enter_async_context(connection))
            refusals.append(Refusals(section.link, section.system_id, signing))
        cut_off = unfinished(journal_path, scenario, digest)
        down_from_s = last_written_s(journal_path) if cut_off else 0.0
        kept = None if cut_off else set_aside(journal_path, scenario)
        if kept is not None:
            tell(
                record,
                "service",
                f"the journal of an earlier burn is kept as {kept.name}; this is a new one",
            )
        header, rest = header_of(scenario, digest, created), cut_off.rest() if cut_off else None
        journal = Journal(journal_path, header, durable=True, rest=rest)
        stack.callback(journal.close)
        core = Core(scenario, landscape)
        latest_us = round(scenario.duration_s * 1e6)
        exchange = None if channel is None else Exchange(channel, gateways, latest_us)
        say = unheard if exchange is None else exchange.say
        service = Service(scenario, core, world, journal, record, gateways, say)
        if cut_off is not None:
            # Mission time goes on from here; links live on while the past is told.
            down_s, began_us = wall_us() / 1e6 - down_from_s, clock_us()
            await asyncio.to_thread(replay, cut_off, service)
            news = resumed(cut_off.last_us, down_s)
            clock.go_on(news.at_us, began_us)
            service.go_on(cut_off.missing, news, clock_us())
            words = f"goes on with the burn of {journal_path} after {news.down_s:.0f} s"
            tell(record, "service", f"{words}; whatever was approved is void")
        silence = Silence(scenario, gateways, connections)
        stop = asyncio.Event()
        _stop_on_signals(stop)
        async with asyncio.TaskGroup() as group:
            flights = []
            if exchange is not None:
                ears = Ears(service, clock)
                flights.append(group.create_task(exchange.run(ears)))
                await exchange.join()
            flights += [
                group.create_task(_fly(connection, gateway, service))
                for connection, gateway in zip(connections, gateways.values(), strict=True)
            ]
            if listening is not None:
                desk = desk_of(scenario, service, clock, connections)
                flights.append(group.create_task(serve_control(listening, desk)))
            while not stop.is_set() and clock.now_us < scenario.duration_s * 1e6:
                watch()
                silence.tell(record)
                for name, connection, told in zip(gateways, connections, refusals, strict=True):
                    for line in told.news(connection.counts, connection.hears_signed):
                        tell(record, name, line)
                clock.wall_passed(clock_us())
                world.advance(clock.now_us)
                progress(record, world)
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(stop.wait(), STATUS_EVERY_S)
            for flight in flights:
                flight.cancel()
        is_over = clock.now_us >= latest_us
        if is_over or core.leader.status()["complete"]:
            journal.end()  # else what was lit and dropped is to be known when it goes on
    world.advance(clock.now_us)
    return record, world


def _client_of(
    section: VehicleSection,
    rates: RatesHz,
    tlog: Tlog | None,
    signing: Signing | None,
    place: int,
) -> tuple[Autopilot, Connection | MavsdkVehicle]:
    """A vehicle's client, and its link to be opened."""
    link_id = place % 256 if section.signing_link_id is None else section.signing_link_id
    if section.backend == "mavsdk":
        vehicle = MavsdkVehicle(section.link, section.system_id, clock_us, tlog, signing, link_id)
        return vehicle, vehicle
    client = VehicleClient(target_system=section.system_id, rates_hz=rates)
    return client, Connection(
        section.link, client, clock_us, tlog=tlog, signing=signing, link_id=link_id
    )


def replay(cut_off: Unfinished, service: Service) -> None:
    """Let a fresh core and all that follows it have the past; nothing is carried out."""
    for event, commands in cut_off.turns(service.core.handle):
        service.past(event, commands)


def desk_of(
    scenario: Scenario,
    service: Service,
    clock: MissionClock,
    connections: Sequence[Connection | MavsdkVehicle],
) -> Desk:
    """Where people's requests are taken; what they lead to leaves at once."""
    burn = scenario.burn
    assert burn is not None
    stations = tuple(station.name for station in burn.stations)

    def told(event: CrewEvent) -> list[str]:
        news = service.record.news
        before = len(news)
        service.tell(event, clock_us())
        for connection in connections:
            connection.flush()
        return [announced.text for _, announced in news[before:]]

    def status() -> dict[str, Any]:
        return {
            "scenario": scenario.name,
            "at_s": clock.now_us / 1e6,
            "stations": stations,
            "items": burn.go_items,
            **service.status(),
            "leader": service.core.leader.status(),
        }

    def on_map(lat_deg: float, lon_deg: float) -> bool:
        landscape = service.world.landscape
        return landscape.contains(*landscape.xy_of_lat_lon(lat_deg, lon_deg))

    return Desk(told, status, lambda: clock.now_us, stations, burn.go_items, on_map)


def tell(record: Record, vehicle: str, text: str) -> None:
    """Warn the user."""
    record.news.append((record.at_us, Announce(vehicle, text, "warning")))


class Ears:
    """What comes of all that other processes say."""

    def __init__(self, service: Service, clock: MissionClock) -> None:
        self._service = service
        self._clock = clock

    @property
    def mission_us(self) -> int:
        """Mission time here."""
        return self._clock.now_us

    def passed(self, mission_us: int) -> None:
        """Mission time has come so far elsewhere."""
        self._clock.others_passed(mission_us, clock_us())

    def hear(self, message: AnyMessage) -> None:
        """A vehicle flown elsewhere has said something."""
        self.passed(message.at_us)
        self._service.hear(message, self._clock.now_us, clock_us())

    def contact(self, there: bool) -> None:
        """Others can be talked to, or no longer."""
        self._service.contact(there, self._clock.now_us, clock_us())

    def tell(self, text: str, warning: bool) -> None:
        """A line for the user."""
        level: Literal["info", "warning"] = "warning" if warning else "info"
        record = self._service.record
        record.news.append((record.at_us, Announce("formation", text, level)))


class Silence:
    """Tells once of each vehicle that has not been heard since the service began."""

    def __init__(
        self,
        scenario: Scenario,
        gateways: dict[str, Gateway],
        connections: list[Connection | MavsdkVehicle],
    ) -> None:
        links = [section.link for section in scenario.flown]
        self._unheard = dict(zip(gateways, zip(links, connections, strict=True), strict=True))
        self._gateways = gateways
        self._tell_at_us = clock_us() + TELL_SILENCE_AFTER_US

    def tell(self, record: Record) -> None:
        """Add the news to the record when it is time."""
        if clock_us() < self._tell_at_us:
            return
        for name, (link, connection) in self._unheard.items():
            refused = refusal(connection.counts, link)
            if self._gateways[name].client.stack is None and refused is not None:
                tell(record, name, f"nothing believed yet: {refused}")
            elif self._gateways[name].client.stack is None:
                text = (
                    f"nothing heard on {link} yet; is its autopilot running, and is this its port?"
                )
                tell(record, name, text)
        self._unheard.clear()


async def _fly(connection: Connection | MavsdkVehicle, gateway: Gateway, service: Service) -> None:
    """Hand on what one vehicle's link brings until cancelled."""
    while True:
        await connection.wait()
        now_us = clock_us()
        service.take(gateway.events(now_us), now_us)
        connection.flush()


def _stop_on_signals(stop: asyncio.Event) -> None:
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
