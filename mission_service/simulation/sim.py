"""A scenario in virtual time: mock autopilots, real MAVLink frames, no clock but an event heap."""

import heapq
from collections.abc import Callable
from pathlib import Path

from autopilot_bridge.links.link import MemoryLink
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.kinematics import Wind
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle.client import VehicleClient
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather
from mission_service.config.scenario import Scenario
from mission_service.config.sections import LinkSection, VehicleSection
from mission_service.core.core import Core
from mission_service.events import CrewEvent
from mission_service.fire.setup import home_of, landscape_of, weather_of
from mission_service.fire.simulated import FireWorld, world_of
from mission_service.guidance.burn.mission import return_height_m
from mission_service.journal.journal_file import Journal, header_of
from mission_service.runtime.engine import Progress, Service, unshown
from mission_service.runtime.gateway import Gateway, MissionClock, dropper_of, rates_hz
from mission_service.runtime.picture import Picture
from mission_service.runtime.record import Record

PROGRESS_EVERY_US = 60_000_000

Crew = Callable[[int, Core], list[CrewEvent]]


def memory_link(section: LinkSection, seed: int) -> MemoryLink:
    """One direction of the simulated link."""
    return MemoryLink(
        loss=section.loss,
        delay_us=round(section.delay_ms * 1e3),
        jitter_us=round(section.jitter_ms * 1e3),
        duplication=section.duplication,
        seed=seed,
    )


def mock_of(section: VehicleSection, landscape: Landscape) -> MockAutopilot:
    """The mock autopilot of a vehicle, standing at its home."""
    home_lat_deg, home_lon_deg, home_altitude_amsl_m = home_of(section, landscape)
    return MockAutopilot(
        stack_named(section.stack, section.kind),
        system_id=section.system_id,
        home_lat_deg=home_lat_deg,
        home_lon_deg=home_lon_deg,
        home_altitude_amsl_m=home_altitude_amsl_m,
        airspeed_m_s=section.airspeed_m_s,
    )


class Rig:
    """One vehicle of the simulation: client and mock, joined by two memory links."""

    def __init__(
        self, section: VehicleSection, scenario: Scenario, landscape: Landscape, clock: MissionClock
    ) -> None:
        seed = scenario.seed * 1000 + section.system_id * 2
        self.mock = mock_of(section, landscape)
        rates = rates_hz(scenario)
        self.client = VehicleClient(target_system=section.system_id, rates_hz=rates)
        self.mock.intervals.only(*rates)
        self._clock = clock
        self._weather = weather_of(scenario) if scenario.fly_in_wind else None
        self._entry: Weather | None = None
        self.gateway = Gateway(
            section.name,
            self.client,
            clock,
            dropper_of(scenario),
            return_height_m(scenario, landscape),
        )
        self._mock_due_us = 0
        self._up = memory_link(scenario.link, seed)
        self._down = memory_link(scenario.link, seed + 1)

    def next_timer(self) -> int:
        """When this rig next has something to do."""
        next_us = min(self._mock_due_us, self.client.next_timer())
        for link in (self._up, self._down):
            arrives_us = link.next_timer()
            if arrives_us is not None and arrives_us < next_us:
                next_us = arrives_us
        return next_us

    def advance(self, now_us: int, service: Service) -> None:
        """Let everything happen that is due."""
        if self._weather is not None:
            self._blow(self._weather.at(self._clock.now_us / 1e6))
        arrived = self._up.receive(now_us)
        for datagram in arrived:
            self.mock.receive_data(datagram, now_us)
        if arrived or now_us >= self._mock_due_us:
            self.mock.handle_timer(now_us)
            self._mock_due_us = self.mock.next_timer()
        for datagram in self.mock.data_to_send():
            self._down.send(datagram, now_us)
        for datagram in self._down.receive(now_us):
            self.client.receive_data(datagram, now_us)
        self.client.handle_timer(now_us)
        service.take(self.gateway.events(now_us), now_us)
        for datagram in self.client.data_to_send():
            self._up.send(datagram, now_us)

    def _blow(self, entry: Weather) -> None:
        """The mock flies in the wind that drives the fire."""
        if entry is not self._entry:
            self._entry = entry
            self.mock.flight.wind = Wind(entry.wind_from_deg, entry.wind_speed_m_s)


class Simulation:
    """Vehicles, service and fire of a scenario, joined; run it piece by piece."""

    def __init__(
        self,
        scenario: Scenario,
        journal: Journal,
        landscape: Landscape,
        crew: Crew | None = None,
        progress: Progress = unshown,
        picture: Picture | None = None,
    ) -> None:
        """A burn has a simulated crew if none is given; ``picture`` is kept up, if there is one."""
        if crew is None and scenario.burn_flown is not None:
            from mission_service.simulation.crew import SimulatedCrew

            crew = SimulatedCrew(scenario.burn_flown).due
        self.clock = MissionClock(round(scenario.start_s * 1e6), wall=False)
        self.world = world_of(scenario, landscape)
        self.rigs = [Rig(section, scenario, landscape, self.clock) for section in scenario.flown]
        names = tuple(section.name for section in scenario.flown)
        self.record = Record(names, self.clock.now_us)
        self.core = Core(scenario, landscape)
        gateways = {rig.gateway.name: rig.gateway for rig in self.rigs}
        self.service = Service(
            scenario, self.core, self.world, journal, self.record, gateways, picture=picture
        )
        self._crew = crew
        self._progress = progress
        self._report_us = self.clock.now_us
        self._heap = [(0, index) for index in range(len(self.rigs))]

    def run(self, until_s: float) -> None:
        """Until mission time has come so far."""
        end_us = round(until_s * 1e6)
        while self._heap and self.clock.now_us < end_us:
            self.step()

    @property
    def link_us(self) -> int:
        """When something happens next, by the links' clock: it goes on while nothing is heard."""
        return self._heap[0][0]

    def step(self) -> None:
        """Let the next thing happen."""
        now_us, index = heapq.heappop(self._heap)
        self.rigs[index].advance(now_us, self.service)
        if self._crew is not None:
            for event in self._crew(self.clock.now_us, self.core):
                self.service.tell(event, now_us)
        heapq.heappush(self._heap, (max(self.rigs[index].next_timer(), now_us), index))
        if self.clock.now_us >= self._report_us:
            self._report_us += PROGRESS_EVERY_US
            self._progress(self.record, self.world)


def simulate(
    scenario: Scenario,
    journal_path: Path,
    created: str,
    progress: Progress = unshown,
    crew: Crew | None = None,
    until_s: float | None = None,
) -> tuple[Record, FireWorld]:
    """Fly a scenario to its end (or ``until_s``) in virtual time, leaving a journal.

    ``created`` (wall-clock time in words) only goes into the journal's header. ``progress`` is
    called about once a minute of mission time. ``crew`` says what people do by a mission time.
    """
    landscape = landscape_of(scenario)
    journal = Journal(journal_path, header_of(scenario, landscape.digest(), created), durable=False)
    try:
        simulation = Simulation(scenario, journal, landscape, crew, progress)
        simulation.run(scenario.duration_s if until_s is None else until_s)
    finally:
        journal.close()
    simulation.world.advance(simulation.clock.now_us)
    return simulation.record, simulation.world
