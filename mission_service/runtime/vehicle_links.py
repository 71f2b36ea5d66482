"""Opens each link of a live run once, with a client for each vehicle on the link.

Vehicles on the same link have different system ids. Each vehicle is bound to the remote address at
which it was found (``autopilot_bridge/vehicle/remote_binding.py``). Vehicles that share a link or a
backup link share one connection, which opens all their links.
"""

import asyncio
import contextlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from autopilot_bridge.clients.client_protocol import VehicleClient
from autopilot_bridge.clients.mavsdk import MavsdkClient
from autopilot_bridge.clients.mavsdk_library import MAVSDK_IDS
from autopilot_bridge.clients.shared_link import SharedLink
from autopilot_bridge.links.asyncio_connection import Connection, Port
from autopilot_bridge.links.signing import Signing
from autopilot_bridge.links.tlog_writer import Tlog
from autopilot_bridge.stacks.link_loss import STATION_ID
from autopilot_bridge.stacks.stacks import Stack
from firemodel.landscape.landscape import Landscape
from mission_service.commands import Severity
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.config.shared_links import sharing
from mission_service.fire.scenario_fire import weather_of
from mission_service.guidance.registry import way_of
from mission_service.runtime.gateway import (
    Gateway,
    MissionClock,
    camera_reports_of,
    dropper_of,
    rates_hz,
)
from mission_service.runtime.link_signing import SigningRefusals, refusal, signings
from mission_service.vehicles.parameter_reports import ParameterReports

REPORT_SILENCE_AFTER_US = 4_000_000
MAX_SENDERS = 3  # in one report
# Vehicles exceed the commanded airspeed: ArduPlane flew at 23 instead of 15 m/s, and faster in a
# dive.
FASTER = 2.0
BACKUP_ID_OFFSET = 127  # added to the preferred link's signing link id, modulo 255
STRONGEST_WIND_M_S = 30.0  # wind assumed for flights, unless the scenario has stronger wind
SEVERITIES: dict[str, Severity] = {
    "source": "severe",
    "clock": "severe",
    "jump": "severe",
    "value": "warning",
}

Clock = Callable[[], int]
Report = Callable[[str, str], None]  # receives a vehicle, or "service", and a warning


@dataclass
class Link:
    """One vehicle's link: its gateway, connection and refused frames."""

    section: VehicleSection
    gateway: Gateway
    connection: Connection | MavsdkClient  # shared with other vehicles on the same link
    ports: tuple[Port, ...]  # of the vehicle's links, the preferred link first
    refusals: tuple[SigningRefusals, ...]  # of each port
    unexpected: Mapping[int, Stack]  # autopilots received but not in the scenario, by system id
    known_ids: frozenset[int]  # the system ids of all vehicles in the scenario
    _reported: set[str] = field(default_factory=set)  # ports with a reported loss of a datagram

    @property
    def connected(self) -> bool:
        """Whether the autopilot has been connected since the service began."""
        return self.gateway.client.stack is not None

    def new_reports(self) -> list[str]:
        """Return the new reports on refused frames and on lost datagrams, one line each."""
        lines = []
        for port, refusals in zip(self.ports, self.refusals, strict=True):
            lines += refusals.new_reports(port.counts, port.receives_signed)
            if port.lost_datagrams and port.address not in self._reported:
                self._reported.add(port.address)
                text = f"a datagram was lost on {port.address}: {port.last_error}"
                lines.append(f"{text}; further losses are not announced")
        return lines


def max_speed_m_s(section: VehicleSection, scenario: Scenario) -> float:
    """Return the upper bound of a vehicle's ground speed, in m/s."""
    fastest_m_s = section.airspeed_m_s
    if way_of(scenario).changes_airspeed:
        fastest_m_s = max(fastest_m_s, section.max_airspeed_m_s)
    wind_m_s = max(entry.wind_speed_m_s for entry in weather_of(scenario).entries)
    return FASTER * fastest_m_s + max(STRONGEST_WIND_M_S, FASTER * wind_m_s)


async def open_links(
    stack: contextlib.AsyncExitStack,
    scenario: Scenario,
    landscape: Landscape,
    clock: MissionClock,
    clock_us: Clock,
    wall_us: Clock,
    tlog_path: Path | None,
    report: Report,
) -> dict[str, Link]:
    """Open the links of all vehicles that this process controls; ``stack`` closes the links.

    Raises ScenarioError for vehicles that cannot share their link, and BridgeError for a link or a
    key that cannot be used.
    """
    groups = sharing(scenario.flown)
    if any(section.backend == "mavsdk" for section in scenario.flown):
        # A transfer and a command of each vehicle may run simultaneously, in separate threads.
        threads = ThreadPoolExecutor(2 * len(scenario.flown) + 2)
        asyncio.get_running_loop().set_default_executor(threads)
    announce = partial(report, "service")
    tlog = stack.enter_context(Tlog(tlog_path, wall_us, announce)) if tlog_path else None
    system_ids = {section.system_id for section in scenario.flown}
    if tlog is not None and len(system_ids) < len(scenario.flown):
        words = "vehicles with the same system id cannot be distinguished in it; change their ids"
        announce(f"{tlog_path}: {words}")
    sources = [section.signing_key for section in scenario.flown]
    signing_of = stack.enter_context(signings(sources, wall_us, announce))
    places = {section.name: place for place, section in enumerate(scenario.flown)}
    links: dict[str, Link] = {}
    for sections in groups:
        first = sections[0]
        signing = signing_of.get(first.signing_key)
        addresses = tuple(dict.fromkeys(link for each in sections for link in each.links))
        link_ids = _link_ids(sections, addresses, places)
        clients, connection, unexpected = _clients_of(
            sections, scenario, clock_us, tlog, signing, dict(zip(addresses, link_ids, strict=True))
        )
        await stack.enter_async_context(connection)
        port_of = {port.address: port for port in connection.ports}
        for section, client in zip(sections, clients, strict=True):
            gateway = Gateway(
                section.name,
                client,
                clock,
                dropper_of(scenario),
                way_of(scenario).return_height_m(scenario, landscape),
                camera_reports_of(scenario, section.name),
                ParameterReports(section.name, client, _station_id(section)),
            )
            links[section.name] = Link(
                section,
                gateway,
                connection,
                tuple(port_of[link] for link in section.links),
                tuple(SigningRefusals(link, section.system_id, signing) for link in section.links),
                unexpected,
                frozenset(each.system_id for each in scenario.vehicles),
            )
    return {name: links[name] for name in places}


def _link_ids(
    sections: list[VehicleSection], addresses: tuple[str, ...], places: dict[str, int]
) -> list[int]:
    """Return the signing link id for each link; the ids of a vehicle's links differ.

    A receiver accepts only increasing timestamps from the same link id, and frames on two links
    may overtake each other.
    """
    of_link: dict[str, int] = {}
    for section in sections:
        given = section.signing_link_id
        first = places[section.name] % 256 if given is None else given
        for number, link in enumerate(section.links):
            of_link.setdefault(link, first if number == 0 else (first + BACKUP_ID_OFFSET) % 255)
    return [of_link[address] for address in addresses]


def _station_id(section: VehicleSection) -> int:
    """Return the system id of the heartbeats sent to a vehicle."""
    return MAVSDK_IDS[0] if section.backend == "mavsdk" else STATION_ID


def _clients_of(
    sections: list[VehicleSection],
    scenario: Scenario,
    clock_us: Clock,
    tlog: Tlog | None,
    signing: Signing | None,
    link_ids: dict[str, int],
) -> tuple[Sequence[VehicleClient], Connection | MavsdkClient, Mapping[int, Stack]]:
    """Return the clients of vehicles that share links, and their connection, not yet open.

    The third value contains the autopilots received but not in the scenario, by system id.
    ``link_ids`` contains the signing link ids for the addresses of all links.
    """
    first = sections[0]
    if first.backend == "mavsdk":
        fastest_m_s = max_speed_m_s(first, scenario)
        vehicle = MavsdkClient(
            *(first.link, first.system_id, clock_us, tlog, signing, link_ids[first.link]),
            fastest_m_s,
        )
        return [vehicle], vehicle, {}
    signed = signing is not None
    addresses = tuple(link_ids)
    link = SharedLink(addresses, rates_hz=rates_hz(scenario), expects=True, signed=signed)
    clients = [
        link.expect(
            section.system_id,
            max_speed_m_s(section, scenario),
            tuple(addresses.index(each) for each in section.links),
        )
        for section in sections
    ]
    signs_as = tuple(link_ids.values())
    connection = Connection(addresses, link, clock_us, tlog=tlog, signing=signing, link_id=signs_as)
    return clients, connection, link.unexpected


def connected(links: dict[str, Link]) -> list[list[Link]]:
    """Group vehicles by their connection."""
    found: dict[int, list[Link]] = {}
    for link in links.values():
        found.setdefault(id(link.connection), []).append(link)
    return list(found.values())


def alarms(links: dict[str, Link]) -> list[tuple[str, str, str]]:
    """Return the link alarms since the last call as (vehicle, kind, text).

    An empty text ends an alarm.
    """
    found = []
    for name, link in links.items():
        while link.gateway.link_alarms:
            found.append((name, *link.gateway.link_alarms.popleft()))
    return found


class LinkMonitor:
    """A monitor that reports vehicles without a heartbeat once, some seconds after the start."""

    def __init__(self, links: dict[str, Link], now_us: int) -> None:
        self._unreported = dict(links)
        self._report_at_us = now_us + REPORT_SILENCE_AFTER_US

    def silent_vehicles(self, now_us: int) -> list[tuple[str, str]]:
        """When the report is due, return the vehicles without a heartbeat, with possible causes."""
        if now_us < self._report_at_us:
            return []
        found = []
        for name, link in self._unreported.items():
            address = " or ".join(link.section.links)
            refusals = [refusal(port.counts, port.address) for port in link.ports]
            refused = next(filter(None, refusals), None)
            if not link.connected and refused is not None:
                found.append((name, f"no frame accepted yet: {refused}"))
            elif not link.connected and (senders := _other_senders(link)):
                found.append((name, f"no heartbeat on {address} yet; {senders}"))
            elif not link.connected:
                remedy = "check that the autopilot is running and that this is its port"
                found.append((name, f"no heartbeat on {address} yet; {remedy}"))
        self._unreported.clear()
        return found


def _other_senders(link: Link) -> str:
    """Return the unknown autopilots that send instead of a vehicle, and the remedy, in words."""
    unknown = sorted(set(link.unexpected) - link.known_ids)[:MAX_SENDERS]
    if not unknown:
        return ""
    stacks = [(key, link.unexpected[key]) for key in unknown]
    senders = ", ".join(f"{key} ({stack.name} {stack.vehicle})" for key, stack in stacks)
    return (
        f"received instead: system {senders}; the scenario has system_id = "
        f"{link.section.system_id}: change it, or the autopilot's MAV_SYS_ID or SYSID_THISMAV"
    )
