"""Replays a logged flight in an open loop: the core's commands do not change the flight.

Clients of the logged vehicles (``logged_vehicle.py``) replace the clients on links. The simulated
camera, the core, the journal and the state view are the same as in a live run. The replay of a
flight therefore writes a journal that can be verified, and interfaces show the replay like a run.
"""

import heapq
from collections.abc import Iterable, Iterator
from typing import Any

from autopilot_bridge.vehicle.client_events import Position
from mission_service.core.core import Core
from mission_service.events import AnyOperatorEvent, IgnitionReported
from mission_service.fire.run_estimate import OF_FIRE, RunEstimate
from mission_service.fire.scenario_fire import warnings_on
from mission_service.fire.simulated_cameras import cameras_of
from mission_service.journal.journal_file import Journal
from mission_service.replay.flights.flight_logs import VehicleLog
from mission_service.replay.flights.journal_log import JournalLog
from mission_service.replay.flights.logged_vehicle import LoggedVehicle
from mission_service.replay.flights.scenario_pairing import Pairing
from mission_service.runtime.alarms.proximity_alarms import ProximityAlarms
from mission_service.runtime.engine import Engine
from mission_service.runtime.gateway import Gateway, MissionClock
from mission_service.runtime.state_view import StateView

FlightEntry = VehicleLog | AnyOperatorEvent
EVERY_US = 50_000  # minimum interval between replayed positions of a vehicle


def entries_of(pairing: Pairing) -> Iterator[FlightEntry]:
    """Yield the entries of a flight and the operators' requests about the fire, in time order.

    Logs with hundreds of positions per second are thinned.
    """
    log, mission = pairing.flight.logs[0], pairing.mission
    of_fire: list[AnyOperatorEvent] = []
    if isinstance(log, JournalLog):
        kinds = (*OF_FIRE, IgnitionReported)
        of_fire = [each for each in log.requests() if isinstance(each, kinds)]
    requests = ((mission.log_us(each.at_us), each) for each in of_fire)
    vehicles = ((each.at_us, each) for each in pairing.flight.played())
    last_us: dict[str, int] = {}
    streams: list[Iterable[tuple[int, FlightEntry]]] = [requests, vehicles]
    for at_us, entry in heapq.merge(*streams, key=lambda each: each[0]):
        if at_us > pairing.end_us:
            return
        if isinstance(entry, VehicleLog) and isinstance(entry.event, Position):
            if at_us - last_us.get(entry.vehicle, -EVERY_US) < EVERY_US:
                continue
            last_us[entry.vehicle] = at_us
        yield entry


class OpenLoopReplay:
    """The service that replays a flight with the logged vehicles."""

    def __init__(
        self,
        pairing: Pairing,
        journal: Journal,
        saved: dict[str, Any] | None = None,
    ) -> None:
        """Begin a replay, or continue from the ``saved`` state, which is not copied."""
        state = saved or _initial_state(pairing)
        self.clock: MissionClock = state["clock"]
        self.vehicles: dict[str, LoggedVehicle] = state["vehicles"]
        self.gateways: dict[str, Gateway] = state["gateways"]
        self._proximity: ProximityAlarms = state["proximity"]
        self.service = Engine(
            pairing.scenario,
            state["core"],
            state["cameras"],
            state["estimate"],
            journal,
            state["state_view"],
            self.gateways,
        )
        if saved is not None:
            self.service.restore(saved)

    def snapshot_fields(self) -> dict[str, Any]:
        """Return all fields of the state except the scenario, for a copy."""
        return {
            "clock": self.clock,
            "vehicles": self.vehicles,
            "gateways": self.gateways,
            "proximity": self._proximity,
            **self.service.snapshot_fields(),
        }

    def apply(self, entry: FlightEntry) -> None:
        """Process the flight's next entry."""
        if not isinstance(entry, VehicleLog):
            self.service.submit(entry, entry.at_us)
            return
        self.vehicles[entry.vehicle].apply(entry.event)
        self.service.handle_events(self.gateways[entry.vehicle].events(entry.at_us), entry.at_us)
        self._proximity.check_pairs(entry.at_us)


def _initial_state(pairing: Pairing) -> dict[str, Any]:
    scenario, landscape, mission = pairing.scenario, pairing.landscape, pairing.mission
    clock = MissionClock(mission.start_us, wall=True)
    clock.go_on(mission.start_us, mission.begin_us)
    if all(isinstance(log, JournalLog) for log in pairing.flight.logs):
        clock.ahead_us = mission.start_us - mission.begin_us
    vehicles = {section.name: LoggedVehicle() for section in scenario.vehicles}
    estimate = RunEstimate(scenario, landscape)
    estimate.advance(mission.start_us)
    warnings = warnings_on(scenario, landscape)
    state_view = StateView(scenario, landscape, mission.start_us, warnings)
    return {
        "clock": clock,
        "vehicles": vehicles,
        "gateways": {name: Gateway(name, vehicle, clock) for name, vehicle in vehicles.items()},
        "proximity": ProximityAlarms(state_view, scenario.mission.separation_m),
        "core": Core(scenario, landscape),
        "cameras": cameras_of(scenario, landscape),
        "estimate": estimate,
        "state_view": state_view,
    }
