"""Simulates a scenario in virtual time, with mock autopilots, MAVLink frames and an event heap."""

import contextlib
import heapq
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.kinematics import Wind
from autopilot_bridge.mock.local_frame import LocalFrame
from autopilot_bridge.mock.mock_camera import CapturedImage
from autopilot_bridge.stacks.link_loss import STATION_ID
from autopilot_bridge.stacks.stacks import stack_named
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather
from firemodel.spread.fire_scheme import Fire
from mission_service.config.fire_sections import SimulatedFireSection, SimulationSection
from mission_service.config.scenario import Scenario
from mission_service.config.sections import LinkSection, VehicleSection
from mission_service.core.core import Core
from mission_service.errors import ScenarioError
from mission_service.events import AnyOperatorEvent
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_fire import home_of, landscape_of, warnings_on
from mission_service.fire.simulated_cameras import cameras_of
from mission_service.fire.simulated_fire import (
    SimulatedFire,
    simulated_fire_of,
    simulated_weather,
)
from mission_service.guidance.registry import way_of
from mission_service.journal.journal_file import Journal, header_of
from mission_service.runtime.engine import Engine, Progress, unshown
from mission_service.runtime.gateway import (
    Gateway,
    MissionClock,
    camera_reports_of,
    dropper_of,
    rates_hz,
)
from mission_service.runtime.run_statistics import RunStatistics
from mission_service.runtime.state_view import StateView
from mission_service.simulation.battery_crew import battery_crew_of
from mission_service.simulation.image_writer import (
    SIMULATED_ZERO,
    ImageWriter,
    check_is_empty,
    folder_of,
)
from mission_service.vehicles.parameter_reports import ParameterReports

PROGRESS_EVERY_US = 60_000_000
CLOCK_SENSORS = ("observation_files", "thermal_video")  # sensors that use the host's clock

Crew = Callable[[int, Core], list[AnyOperatorEvent]]


def memory_link(section: LinkSection, seed: int) -> MemoryLink:
    """Return the simulated link for one direction."""
    return MemoryLink(
        loss=section.loss,
        delay_us=round(section.delay_ms * 1e3),
        jitter_us=round(section.jitter_ms * 1e3),
        duplication=section.duplication,
        seed=seed,
    )


def mock_of(section: VehicleSection, landscape: Landscape) -> MockAutopilot:
    """Return the mock autopilot for a vehicle on the ground at its home."""
    mock = MockAutopilot(
        stack_named(section.stack, section.kind),
        LocalFrame(*home_of(section, landscape)),
        system_id=section.system_id,
        airspeed_m_s=section.airspeed_m_s,
    )
    if section.kind == "copter":  # a headwind slows it down at this airspeed
        fastest_m_s = max(section.max_airspeed_m_s, section.airspeed_m_s)
        mock.flight.limits = replace(mock.flight.limits, max_airspeed_m_s=fastest_m_s)
    return mock


def fit_remote_id(mock: MockAutopilot, scenario: Scenario) -> None:
    """Give a mock a Remote ID module that is ready, if the scenario requires Remote ID."""
    if scenario.preflight.remote_id:
        mock.telemetry.remote_id_error = ""


class SimulatedVehicle:
    """One simulated vehicle: a client and a mock autopilot, connected by two memory links."""

    def __init__(
        self, section: VehicleSection, scenario: Scenario, landscape: Landscape, clock: MissionClock
    ) -> None:
        seed = scenario.seed * 1000 + section.system_id * 2
        self.mock = mock_of(section, landscape)
        fit_remote_id(self.mock, scenario)
        rates = rates_hz(scenario)
        self.client = NativeClient(target_system=section.system_id, rates_hz=rates)
        self.mock.intervals.only(*rates)
        self._clock = clock
        self._weather = simulated_weather(scenario) if scenario.fly_in_wind else None
        self._entry: Weather | None = None
        self.gateway = Gateway(
            section.name,
            self.client,
            clock,
            dropper_of(scenario),
            way_of(scenario).return_height_m(scenario, landscape),
            camera_reports_of(scenario, section.name),
            ParameterReports(section.name, self.client, STATION_ID),
        )
        self._mock_due_us = 0
        self._up = memory_link(scenario.link, seed)
        self._down = memory_link(scenario.link, seed + 1)

    def next_timer(self) -> int:
        """Return the time of the next timer of the client, mock or links (µs)."""
        due_us = min(self._mock_due_us, self.client.next_timer())
        for link in (self._up, self._down):
            arrives_us = link.next_timer()
            if arrives_us is not None and arrives_us < due_us:
                due_us = arrives_us
        return due_us

    def handle_due(self, now_us: int, service: Engine) -> None:
        """Handle all datagrams and timers that are due at ``now_us``."""
        arrived = self._up.receive(now_us)
        if arrived or now_us >= self._mock_due_us:
            self._advance_mock(arrived, now_us)
        for datagram in self._down.receive(now_us):
            self.client.receive_data(datagram, now_us)
        self.client.handle_timer(now_us)
        service.handle_events(self.gateway.events(now_us), now_us)
        for datagram in self.client.data_to_send():
            self._up.send(datagram, now_us)

    def _advance_mock(self, arrived: list[bytes], now_us: int) -> None:
        """Handle the mock's datagrams and timer, using the simulated fire's wind."""
        if self._weather is not None:
            self._blow(self._weather.weather_at(self._clock.now_us / 1e6))
        for datagram in arrived:
            self.mock.receive_data(datagram, now_us)
        self.mock.handle_timer(now_us)
        self._mock_due_us = self.mock.next_timer()
        for datagram in self.mock.data_to_send():
            self._down.send(datagram, now_us)

    def _blow(self, entry: Weather) -> None:
        """Set the mock's wind."""
        if entry is not self._entry:
            self._entry = entry
            self.mock.flight.wind = Wind(entry.wind_from_deg, entry.wind_speed_m_s)


class Simulation:
    """A simulation of a scenario's vehicles, service and fire, which can be run step by step."""

    def __init__(
        self,
        scenario: Scenario,
        journal: Journal,
        landscape: Landscape,
        crew: Crew | None = None,
        progress: Progress = unshown,
    ) -> None:
        """Set up the run; a burn has a simulated crew unless ``crew`` is given."""
        if crew is None and scenario.burn_flown is not None:
            from mission_service.simulation.simulated_crew import SimulatedCrew

            crew = SimulatedCrew(scenario.burn_flown).due
        self.clock = MissionClock(round(scenario.start_s * 1e6), wall=False)
        self.cameras = cameras_of(scenario, landscape)
        self.estimate = RunEstimate(scenario, landscape)
        self.rigs = [
            SimulatedVehicle(section, scenario, landscape, self.clock) for section in scenario.flown
        ]
        mocks = {rig.gateway.name: rig.mock for rig in self.rigs}
        self._batteries = battery_crew_of(scenario, mocks)
        self.core = Core(scenario, landscape)
        gateways = {rig.gateway.name: rig.gateway for rig in self.rigs}
        warnings = warnings_on(scenario, landscape)
        state_view = StateView(scenario, landscape, self.clock.now_us, warnings)
        self.service = Engine(
            scenario, self.core, self.cameras, self.estimate, journal, state_view, gateways
        )
        self.true_fire = None if self.cameras is None else self.cameras.fire
        if scenario.passes_image_files:
            self.true_fire = self._fit_cameras(scenario, landscape)
        self._crew = crew
        self._progress = progress
        self._report_us = self.clock.now_us
        self._heap = [(0, index) for index in range(len(self.rigs))]

    def _fit_cameras(self, scenario: Scenario, landscape: Landscape) -> SimulatedFire | None:
        """Fit the vehicles with cameras that write files; return the fire that the images show."""
        fire = simulated_fire_of(scenario, landscape)
        assert fire is not None
        check_is_empty(folder_of(scenario))

        def times_of(image: CapturedImage) -> tuple[int, datetime]:
            at_us = self.clock.now_us
            return at_us, SIMULATED_ZERO + timedelta(microseconds=at_us)

        for rig, section in zip(self.rigs, scenario.flown, strict=True):
            rig.mock.fit_camera(ImageWriter(scenario, section, fire, times_of).write)
        self.service.sensors.use_mission_time(SIMULATED_ZERO)
        return fire

    def run_until(self, until_s: float) -> None:
        """Run until mission time ``until_s``."""
        end_us = round(until_s * 1e6)
        while self._heap and self.clock.now_us < end_us:
            self.step()

    @property
    def link_us(self) -> int:
        """The time of the next step on the links' clock (µs); mission time may lag behind."""
        return self._heap[0][0]

    def step(self) -> None:
        """Handle the next timer of a vehicle, then the crew's due events."""
        now_us, index = heapq.heappop(self._heap)
        self.rigs[index].handle_due(now_us, self.service)
        if self._batteries is not None:
            self._batteries.work(self.clock.now_us / 1e6)
        if self._crew is not None:
            for event in self._crew(self.clock.now_us, self.core):
                # The estimate may refuse the event, as in a live run.
                with contextlib.suppress(FireModelError):
                    self.service.submit(event, now_us)
        heapq.heappush(self._heap, (max(self.rigs[index].next_timer(), now_us), index))
        if self.clock.now_us >= self._report_us:
            self._report_us += PROGRESS_EVERY_US
            self._progress(self.service.state_view, self.estimate.fire)


def clock_sensors_in(scenario: Scenario) -> list[str]:
    """Return the names of the sensors that use the host's clock.

    The journals of two simulations with such a sensor would differ.
    """
    return [name for name in scenario.estimate.sensors if name in CLOCK_SENSORS]


def _check_sensors(scenario: Scenario) -> None:
    """Raise ScenarioError for a sensor that uses the host's clock."""
    if names := clock_sensors_in(scenario):
        raise ScenarioError(
            f"{scenario.name}: estimate.sensors: {names[0]} uses wall-clock time, which a "
            "simulation does not have; use run, or remove the sensor"
        )


def simulate(
    scenario: Scenario,
    journal_path: Path,
    created: str,
    progress: Progress = unshown,
    crew: Crew | None = None,
    until_s: float | None = None,
) -> tuple[RunStatistics, Fire]:
    """Simulate a scenario until its end (or ``until_s``) in virtual time, and write a journal.

    If the scenario has no table [simulation.fire], a table with the defaults is added, because only
    a simulated fire can be observed in a simulation.

    ``created`` (wall-clock time as text) is only written to the journal's header. ``progress`` is
    called about once a minute of mission time. ``crew`` returns the operators' events that are due
    at the given mission time.

    The journal of a complete simulation ends with the line that marks a regular end.

    Raises ScenarioError for a sensor that uses the host's clock.
    """
    _check_sensors(scenario)
    scenario = _with_simulated_fire(scenario)
    landscape = landscape_of(scenario)
    journal = Journal(journal_path, header_of(scenario, landscape.digest(), created), durable=False)
    try:
        simulation = Simulation(scenario, journal, landscape, crew, progress)
        simulation.run_until(scenario.duration_s if until_s is None else until_s)
        journal.end()
    finally:
        journal.close()
    simulation.service.advance_fire(simulation.clock.now_us)
    progress(simulation.service.state_view, simulation.estimate.fire)
    return simulation.service.statistics, simulation.estimate.fire


def _with_simulated_fire(scenario: Scenario) -> Scenario:
    if scenario.simulation.fire is not None:
        return scenario
    section = SimulationSection(fire=SimulatedFireSection())
    return scenario.model_copy(update={"simulation": section})
