"""Open-loop replay: the core processes a logged flight; its commands do not change the flight.

The log's vehicles take the place of the vehicles on links (``logged_vehicle.py``). All else is the
same as in a live run: simulated camera, core, journal, state view. The replay of a flight therefore
leaves a journal that can be verified, and the interfaces show it like a run.
"""

import heapq
from collections.abc import Iterable, Iterator
from typing import Any

from autopilot_bridge.vehicle.client_events import Position
from mission_service.core.core import Core
from mission_service.events import AnyOperatorEvent, IgnitionReported
from mission_service.fire.observed_fire import OF_FIRE, ObservedFire
from mission_service.fire.simulated_fire import world_of
from mission_service.journal.journal_file import Journal
from mission_service.replay.flights.flight_logs import VehicleLog
from mission_service.replay.flights.journal_log import JournalLog
from mission_service.replay.flights.logged_vehicle import LoggedVehicle
from mission_service.replay.flights.scenario_pairing import Replaying
from mission_service.runtime.engine import Engine
from mission_service.runtime.gateway import Gateway, MissionClock
from mission_service.runtime.health_monitor import HealthMonitor
from mission_service.runtime.run_statistics import RunStatistics
from mission_service.runtime.state_view import StateView

Told = VehicleLog | AnyOperatorEvent
EVERY_US = 50_000  # least interval between positions of a vehicle
NEVER_LATE_US = 1 << 62  # a log has no deadlines


def told_in(what: Replaying) -> Iterator[Told]:
    """Yield the entries of a flight and the operators' requests about the fire, in order of time.

    Logs may have hundreds of positions a second: some are dropped, none is changed.
    """
    log, mission = what.flight.logs[0], what.mission
    people: list[AnyOperatorEvent] = []
    if isinstance(log, JournalLog):
        people = [each for each in log.crew() if isinstance(each, (*OF_FIRE, IgnitionReported))]
    on_clock = ((mission.log_us(each.at_us), each) for each in people)
    vehicles = ((each.at_us, each) for each in what.flight.played())
    passed_us: dict[str, int] = {}
    streams: list[Iterable[tuple[int, Told]]] = [on_clock, vehicles]
    for at_us, told in heapq.merge(*streams, key=lambda each: each[0]):
        if at_us > what.end_us:
            return
        if isinstance(told, VehicleLog) and isinstance(told.event, Position):
            if at_us - passed_us.get(told.vehicle, -EVERY_US) < EVERY_US:
                continue
            passed_us[told.vehicle] = at_us
        yield told


class OpenLoopReplay:
    """The service of a scenario whose vehicles are those of a flight."""

    def __init__(
        self,
        what: Replaying,
        journal: Journal,
        state_view: StateView | None = None,
        kept: dict[str, Any] | None = None,
    ) -> None:
        """``kept``: the state of another replay to continue from; this one then owns it."""
        begun = kept or _begun(what, state_view)
        self.clock: MissionClock = begun["clock"]
        self.vehicles: dict[str, LoggedVehicle] = begun["vehicles"]
        self.gateways: dict[str, Gateway] = begun["gateways"]
        self._health_monitor: HealthMonitor | None = begun["health_monitor"]
        self.service = Engine(
            what.scenario,
            begun["core"],
            begun["fire"].world,
            journal,
            begun["record"],
            self.gateways,
            state_view=begun["state_view"],
        )
        if kept is not None:
            self.service.restore(kept)

    def snapshot_fields(self) -> dict[str, Any]:
        """Return the whole state besides the scenario, for copying."""
        return {
            "clock": self.clock,
            "vehicles": self.vehicles,
            "gateways": self.gateways,
            "health_monitor": self._health_monitor,
            **self.service.snapshot_fields(),
        }

    def apply(self, told: Told) -> None:
        """Process the flight's next entry."""
        if not isinstance(told, VehicleLog):
            self.service.submit(told, told.at_us)
            return
        self.vehicles[told.vehicle].apply(told.event)
        self.service.handle_events(self.gateways[told.vehicle].events(told.at_us), told.at_us)
        if self._health_monitor is not None:
            self._health_monitor.check(told.at_us)


def _begun(what: Replaying, state_view: StateView | None) -> dict[str, Any]:
    scenario, landscape, mission = what.scenario, what.landscape, what.mission
    clock = MissionClock(mission.start_us, wall=True)
    clock.go_on(mission.start_us, mission.begin_us)
    if all(isinstance(log, JournalLog) for log in what.flight.logs):
        clock.ahead_us = mission.start_us - mission.begin_us
    vehicles = {section.name: LoggedVehicle() for section in scenario.vehicles}
    world = world_of(scenario, landscape)
    world.advance(mission.start_us)
    health_monitor = None
    if state_view is not None:
        health_monitor = HealthMonitor(state_view, scenario.mission.separation_m, NEVER_LATE_US)
    return {
        "clock": clock,
        "vehicles": vehicles,
        "gateways": {name: Gateway(name, vehicle, clock) for name, vehicle in vehicles.items()},
        "health_monitor": health_monitor,
        "core": Core(scenario, landscape),
        "fire": ObservedFire(scenario, world),
        "record": RunStatistics(tuple(vehicles), mission.start_us),
        "state_view": state_view,
    }
