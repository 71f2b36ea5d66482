"""The links of a live run: each vehicle's client on its link, signed where there is a key."""

import asyncio
import contextlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from autopilot_bridge.autopilot import Autopilot
from autopilot_bridge.client import VehicleClient
from autopilot_bridge.connection import Connection
from autopilot_bridge.mavsdk_vehicle import MavsdkVehicle
from autopilot_bridge.rates import RatesHz
from autopilot_bridge.signing import Signing
from autopilot_bridge.tlog import Tlog
from firemodel.landscape import Landscape
from mission_service.burn.mission import return_height_m
from mission_service.config import Scenario
from mission_service.config_sections import VehicleSection
from mission_service.gateway import Gateway, MissionClock, dropper_of, rates_hz
from mission_service.signed import Refusals, refusal, signings

TELL_SILENCE_AFTER_US = 4_000_000

Clock = Callable[[], int]
Tell = Callable[[str, str], None]  # a vehicle, or "service", and a warning


@dataclass
class Link:
    """One vehicle's link: its connection, what speaks over it, and what was not believed."""

    section: VehicleSection
    gateway: Gateway
    connection: Connection | MavsdkVehicle
    refusals: Refusals

    @property
    def heard(self) -> bool:
        """Whether its autopilot has been heard."""
        return self.gateway.client.stack is not None


async def open_links(
    stack: contextlib.AsyncExitStack,
    scenario: Scenario,
    landscape: Landscape,
    clock: MissionClock,
    clock_us: Clock,
    wall_us: Clock,
    tlog_path: Path | None,
    tell: Tell,
) -> dict[str, Link]:
    """Open the links of all vehicles that are flown here; ``stack`` closes them."""
    if any(section.backend == "mavsdk" for section in scenario.flown):
        # Each may have a transfer and a command under way, in a thread each.
        threads = ThreadPoolExecutor(2 * len(scenario.flown) + 2)
        asyncio.get_running_loop().set_default_executor(threads)
    tlog = stack.enter_context(Tlog(tlog_path, wall_us)) if tlog_path else None
    if tlog is not None and not _all_differ(scenario):
        words = "vehicles with one system id cannot be told apart in it; give them different ones"
        tell("service", f"{tlog_path}: {words}")
    sources = [section.signing_key for section in scenario.flown]
    signing_of = stack.enter_context(signings(sources, wall_us, lambda text: tell("service", text)))
    links: dict[str, Link] = {}
    for section in scenario.flown:
        signing = signing_of.get(section.signing_key)
        client, connection = _client_of(
            section, rates_hz(scenario), clock_us, tlog, signing, len(links)
        )
        gateway = Gateway(
            section.name,
            client,
            clock,
            dropper_of(scenario),
            return_height_m(scenario, landscape),
        )
        await stack.enter_async_context(connection)
        refusals = Refusals(section.link, section.system_id, signing)
        links[section.name] = Link(section, gateway, connection, refusals)
    return links


def _all_differ(scenario: Scenario) -> bool:
    ids = [section.system_id for section in scenario.flown]
    return len(set(ids)) == len(ids)


def _client_of(
    section: VehicleSection,
    rates: RatesHz,
    clock_us: Clock,
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


class Silence:
    """Tells once of each vehicle that has not been heard since the service began."""

    def __init__(self, links: dict[str, Link], now_us: int) -> None:
        self._unheard = dict(links)
        self._tell_at_us = now_us + TELL_SILENCE_AFTER_US

    def news(self, now_us: int) -> list[tuple[str, str]]:
        """Whom nobody has heard yet, and what that may be; once, when it is time."""
        if now_us < self._tell_at_us:
            return []
        found = []
        for name, link in self._unheard.items():
            where = link.section.link
            refused = refusal(link.connection.counts, where)
            if not link.heard and refused is not None:
                found.append((name, f"nothing believed yet: {refused}"))
            elif not link.heard:
                words = "is its autopilot running, and is this its port?"
                found.append((name, f"nothing heard on {where} yet; {words}"))
        self._unheard.clear()
        return found
