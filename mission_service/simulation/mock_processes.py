"""Runs mock autopilots from a scenario or from options, for the command ``mock``."""

import asyncio
import contextlib
import json
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from autopilot_bridge.links.link_address import LinkAddress, other_end, parse_link
from autopilot_bridge.links.signing import Key, Signing, Timestamps, read_key
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.fault_injection import FaultyMock
from autopilot_bridge.mock.fault_kinds import parse_faults
from autopilot_bridge.mock.kinematics import CALM, Wind
from autopilot_bridge.mock.local_frame import LocalFrame
from autopilot_bridge.mock.mock_camera import CapturedImage
from autopilot_bridge.mock.serving import ChannelGroup, MockGroup, serve
from autopilot_bridge.stacks.stacks import stack_named
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario, flying, load_scenario
from mission_service.config.sections import VehicleSection
from mission_service.errors import MissionServiceError
from mission_service.fire.scenario_fire import landscape_of
from mission_service.fire.simulated_fire import simulated_fire_of
from mission_service.runtime.clocks import clock_us, wall_us
from mission_service.simulation.battery_crew import CHECK_EVERY_S, BatteryCrew, battery_crew_of
from mission_service.simulation.demo import vehicle_of
from mission_service.simulation.image_writer import ImageWriter
from mission_service.simulation.sim import fit_remote_id, mock_of

FARTHER_DEG = 0.001  # of longitude between the homes of successive mocks


@dataclass(frozen=True, slots=True)
class MockEnvironment:
    """The wind, battery, terrain, faults and parameters of mocks, from the command line."""

    wind: Wind = CALM
    battery_minutes: float | None = None
    terrain_amsl_m: float | None = None
    faults: tuple[str, ...] = field(default=())
    seed: int = 0
    parameters: dict[str, float] = field(default_factory=dict)

    def mock(
        self,
        stack: str,
        kind: str,
        system_id: int,
        home: tuple[float, ...],
        airspeed_m_s: float = 18.0,
    ) -> MockAutopilot:
        """Make a mock. Raises MissionServiceError for an invalid home or an unknown parameter."""
        lat_deg, lon_deg, altitude_m = home
        ground_m = self.terrain_amsl_m
        if ground_m is not None and altitude_m < ground_m:
            raise MissionServiceError(
                f"--terrain {ground_m:g}: the home at {altitude_m:g} m is below the ground"
            )
        mock = MockAutopilot(
            stack_named(stack, kind),
            LocalFrame(lat_deg, lon_deg, altitude_m),
            system_id=system_id,
            airspeed_m_s=airspeed_m_s,
            wind=self.wind,
            terrain=None if ground_m is None else lambda lat_deg, lon_deg: ground_m,
            battery_minutes=self.battery_minutes,
        )
        for name, value in self.parameters.items():
            try:
                mock.parameters.change(name, value)
            except KeyError:
                names = ", ".join(mock.parameters.names)
                raise MissionServiceError(
                    f"--param {name}: unknown parameter; the mock of {stack} {kind} has {names}"
                ) from None
        return mock

    def fleet(self, mocks: list[MockAutopilot]) -> MockGroup:
        """Make a fleet of mocks with the given faults. Raises BridgeError for an unknown fault."""
        if not self.faults:
            return MockGroup(mocks)
        seed = 1000 * self.seed
        return MockGroup(
            [FaultyMock(mock, parse_faults(self.faults), seed + mock.system_id) for mock in mocks]
        )


def read_home(text: str) -> tuple[float, ...]:
    """Parse LAT,LON,ALTITUDE_AMSL_M (degrees, m). Raises MissionServiceError."""
    return _numbers(
        f"--home {text}", text, "LAT,LON,ALTITUDE_AMSL_M", (90.0, 180.0, 9000.0), (-90, -180, -500)
    )


def read_wind(text: str) -> Wind:
    """Parse FROM_DEG,SPEED_M_S: the direction from which the wind blows, and the wind speed."""
    from_deg, speed_m_s = _numbers(f"--wind {text}", text, "FROM_DEG,SPEED_M_S", (360.0, 60.0))
    return Wind(from_deg, speed_m_s)


def read_parameters(texts: tuple[str, ...]) -> dict[str, float]:
    """Parse arguments NAME=VALUE. Raises MissionServiceError."""
    found = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            found[name] = float(value)
        except ValueError:
            raise MissionServiceError(f"--param {text}: write it as NAME=VALUE") from None
    return found


def _numbers(
    option: str, text: str, form: str, highest: tuple[float, ...], lowest: tuple[float, ...] = ()
) -> tuple[float, ...]:
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != len(highest):
        raise MissionServiceError(f"{option}: write it as {form}")
    for number, low, high in zip(numbers, lowest or (0.0,) * len(highest), highest, strict=True):
        if not low <= number <= high:
            raise MissionServiceError(
                f"{option}: {number:g} is not between {low:g} and {high:g}; write it as {form}"
            )
    return numbers


def by_hand(
    stack: str, kind: str, system_id: int, home: str, count: int, around: MockEnvironment
) -> MockGroup:
    """Make ``count`` mocks with consecutive system ids; homes are 0.001° of longitude apart."""
    if system_id + count > 251:
        last = system_id + count - 1
        raise MissionServiceError(f"system ids {system_id} to {last}: the highest valid id is 250")
    lat_deg, lon_deg, altitude_m = read_home(home)
    homes = ((lat_deg, lon_deg + FARTHER_DEG * number, altitude_m) for number in range(count))
    return around.fleet(
        [around.mock(stack, kind, number, home) for number, home in enumerate(homes, system_id)]
    )


@dataclass(frozen=True)
class MocksOnLink:
    """The mocks on one link, or on several if each mock has that many telemetry ports.

    ``signing_key`` is the source of the mocks' key. ``crew`` replaces batteries of these mocks and
    of the other mocks of the process.
    """

    fleet: MockGroup
    links: tuple[str, ...]
    signing_key: str | None = None
    crew: BatteryCrew | None = None


def from_scenario(
    name: str, vehicle: str | None, links: tuple[str, ...], around: MockEnvironment
) -> list[MocksOnLink]:
    """Make mocks for a scenario's vehicles, on the ground at their homes.

    Without ``links``, each mock connects to the links of its vehicle. Without ``vehicle``, a mock
    is made for the first vehicle, or for each vehicle if ``links`` is also empty. The mocks share
    the spare batteries of ``[simulation.batteries]``.

    Raises MissionServiceError for batteries that the scenario and ``around`` both define.
    """
    scenario = flying(load_scenario(name))
    if scenario.simulation.batteries is not None and around.battery_minutes is not None:
        raise MissionServiceError(
            f"--battery: {scenario.name} has the table [simulation.batteries]; remove one of them"
        )
    landscape = landscape_of(scenario)
    if vehicle is None and not links:
        sections = list(scenario.vehicles)
    else:
        sections = [vehicle_of(scenario, vehicle)]
    fleets = {each.name: _of_section(each, scenario, landscape, around) for each in sections}
    mocks = {name: fleet.mocks[0] for name, fleet in fleets.items()}
    crew = battery_crew_of(scenario, mocks)
    return [
        MocksOnLink(
            fleets[each.name],
            links or tuple(map(other_end, each.links)),
            each.signing_key,
            crew,
        )
        for each in sections
    ]


def _of_section(
    section: VehicleSection, scenario: Scenario, landscape: Landscape, around: MockEnvironment
) -> MockGroup:
    plain = mock_of(section, landscape)
    frame = plain.flight.frame
    home = (frame.lat_deg, frame.lon_deg, frame.altitude_m)
    mock = around.mock(section.stack, section.kind, section.system_id, home, section.airspeed_m_s)
    fit_remote_id(mock, scenario)
    if scenario.passes_image_files:
        fire = simulated_fire_of(scenario, landscape)
        assert fire is not None

        def times_of(image: CapturedImage) -> tuple[int, datetime]:
            return round(scenario.start_s * 1e6) + image.boot_us, datetime.now(UTC)

        mock.fit_camera(ImageWriter(scenario, section, fire, times_of).write)
    return around.fleet([mock])


def listening(listen: str) -> str:
    """Return the link for ``--listen`` (HOST:PORT, udpin or tcpin); raises MissionServiceError."""
    kind = listen.partition(":")[0]
    link = listen if kind in ("udpin", "tcpin", "udpout", "tcp", "serial") else f"udpin:{listen}"
    address = parse_link(link)
    if not isinstance(address, LinkAddress) or address.kind not in ("udpin", "tcpin"):
        raise MissionServiceError(
            f"--listen {listen}: not a listening link; use HOST:PORT, udpin or tcpin"
        )
    return link


def describe(fleet: MockGroup, links: Sequence[str], speedup: float) -> list[dict[str, Any]]:
    """Return a dictionary for each mock: system id, stack, links, home and wind."""
    return [
        {
            "system_id": mock.system_id,
            "stack": mock.stack.name,
            "vehicle": mock.stack.kind,
            "link": " and ".join(links),
            "speedup": speedup,
            "home_lat_deg": round(mock.flight.frame.lat_deg, 7),
            "home_lon_deg": round(mock.flight.frame.lon_deg, 7),
            "home_altitude_amsl_m": round(mock.flight.frame.altitude_m, 2),
            "wind_from_deg": mock.flight.wind.from_deg,
            "wind_speed_m_s": mock.flight.wind.speed_m_s,
        }
        for mock in fleet.mocks
    ]


async def _replace_batteries(crew: BatteryCrew | None, speedup: float) -> None:
    began_us = clock_us()
    while crew is not None:
        crew.work((clock_us() - began_us) / 1e6 * speedup)
        await asyncio.sleep(CHECK_EVERY_S / speedup)


def run(
    all_mocks: list[MocksOnLink],
    speedup: float,
    as_json: bool,
    echo: Callable[[str], None],
    until_eof: bool = False,
) -> None:
    """Run mocks until SIGINT or SIGTERM; print one line for each mock when its link is open.

    With ``until_eof`` the run also ends when standard input, a pipe, is closed, so that it ends
    even if the parent process is killed. A mock signs with its ``signing_key``, or with the key
    from a SETUP_SIGNING message.
    """
    timestamps = Timestamps(wall_us)

    def signing_with(key: Key) -> Signing:
        return Signing(key, timestamps)

    async def fly(mocks: MocksOnLink) -> None:
        fleet = mocks.fleet
        if len(mocks.links) > 1:
            if len(fleet.mocks) > sum(isinstance(peer, MockAutopilot) for peer in fleet.peers):
                raise MissionServiceError(
                    "--fault: a mock with faults has only one link; specify one --link"
                )
            fleet = ChannelGroup(fleet.mocks, len(mocks.links))

        def opened() -> None:
            for description in describe(fleet, mocks.links, speedup):
                echo(json.dumps(description) if as_json else _line(description))

        key = mocks.signing_key
        signing = None if key is None else Signing(read_key(key), timestamps)
        await serve(fleet, mocks.links, speedup, clock_us, opened, signing, signing_with)

    async def until_ended() -> None:
        task = asyncio.current_task()
        assert task is not None
        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(number, task.cancel)
        if until_eof:
            asyncio.get_running_loop().add_reader(sys.stdin, task.cancel)
        with contextlib.suppress(asyncio.CancelledError):
            async with asyncio.TaskGroup() as group:
                for mocks in all_mocks:
                    group.create_task(fly(mocks))
                for crew in {each.crew for each in all_mocks}:
                    group.create_task(_replace_batteries(crew, speedup))

    asyncio.run(until_ended())


def _line(mock: dict[str, Any]) -> str:
    wind = ""
    if mock["wind_speed_m_s"] > 0.0:
        wind = f", wind {mock['wind_speed_m_s']:g} m/s from {mock['wind_from_deg']:g} deg"
    return (
        f"mock {mock['stack']} {mock['vehicle']} {mock['system_id']} at "
        f"{mock['home_lat_deg']:.5f},{mock['home_lon_deg']:.5f},{mock['home_altitude_amsl_m']:g} "
        f"on {mock['link']}, x{mock['speedup']:g}{wind}"
    )
