"""Continues the flight of a vehicle whose mission was read back after a restart of the service."""

from mission_service import events
from mission_service.commands import AnyCommand, Return, StartMission
from mission_service.core.decision_engine import DecisionEngine
from mission_service.core.landings import Landings
from mission_service.core.mission_starts import WAITS
from mission_service.core.request_results import RequestResults
from mission_service.guidance.protocol import Guidance
from mission_service.vehicles.availability import GOING_HOME, MISSION
from mission_service.vehicles.reconciliation import in_words, recognised
from mission_service.vehicles.vehicle_state import UnconfirmedState, Vehicle, announce


class Continuation:
    """Continues flights after a restart; in ``prescribed`` flights, only announces missions."""

    def __init__(
        self,
        prescribed: bool,
        decision_engine: DecisionEngine,
        guidance: Guidance,
        results: RequestResults,
        landings: Landings,
    ) -> None:
        self._prescribed = prescribed
        self.decision_engine = decision_engine
        self.guidance = guidance
        self._results = results
        self._landings = landings

    def read_back(self, vehicle: Vehicle, event: events.MissionReadBack) -> list[AnyCommand]:
        """Continue with the mission read back after a restart; in a burn, only announce it."""
        at_s, availability = event.at_us / 1e6, vehicle.availability
        was, vehicle.unconfirmed = vehicle.unconfirmed, None
        if was is None:
            return []
        words = announce(vehicle, in_words(event))
        if self._prescribed:
            return [words]
        accepted: list[AnyCommand] = []
        vehicle.read_back = recognised(vehicle, was, event)
        if vehicle.read_back == "new":
            assert was.pending is not None
            accepted = self._results.accepted(vehicle, was.pending, at_s)
        landing = self._landings.read_back(vehicle, at_s)
        if landing or vehicle.landing_state.active:
            return [words, *accepted, *landing]
        sent_home = was.recalled and not vehicle.ordered and not availability.taken_over
        if sent_home and availability.airborne and vehicle.mode not in GOING_HOME:
            self.decision_engine.recall(vehicle.name, at_s)
            return [words, Return(vehicle.name)]
        if vehicle.ordered:
            accepted_last = vehicle.accepted
            evades = accepted_last is not None and accepted_last.evades
            # The mission that leads out of a closed volume replaces the hold.
            if vehicle.mode in GOING_HOME or (vehicle.mode == MISSION and not evades):
                vehicle.hold_again_at_s = at_s
            held = "an earlier order to hold applies until an operator orders resume"
            return [words, announce(vehicle, held, warning=True)]
        if not availability.airborne:
            return [words, *accepted, *self._continued_on_ground(vehicle, was, at_s)]
        starts = any(isinstance(command, StartMission) for command in accepted)
        return [words, *accepted, *self._continued_in_air(vehicle, was, starts)]

    def _continued_on_ground(
        self, vehicle: Vehicle, was: UnconfirmedState, at_s: float
    ) -> list[AnyCommand]:
        """Repeat a start that was under way before the restart, unless it requires an order."""
        waits, on_board = vehicle.waits_for_operator, vehicle.flown_line is not None
        if not waits and was.starting and on_board:
            vehicle.start_again_at_s = at_s
        elif not waits and not on_board and (was.starting or vehicle.start_again_at_s):
            vehicle.holding, vehicle.start_again_at_s = True, None
        else:  # the vehicle has landed or its autopilot has rebooted meanwhile
            waits = waits or (vehicle.started and not vehicle.start_again_at_s)
        return [announce(vehicle, WAITS, warning=True)] if waits else []

    def _continued_in_air(
        self, vehicle: Vehicle, was: UnconfirmedState, starts: bool
    ) -> list[AnyCommand]:
        """Start the mission of a vehicle that an operator resumed or that holds before a start."""
        if vehicle.availability.taken_over:
            return []
        if was.resumed and vehicle.read_back == "unknown":
            vehicle.started = False  # a new mission is uploaded and started
            return []
        if was.resumed:
            return [StartMission(vehicle.name)]
        in_mission = vehicle.mode == MISSION or not self.guidance.in_mission(vehicle.name)
        if vehicle.availability.recalled or in_mission:
            return []
        if not was.starting and was.pending is None:
            return []
        if vehicle.flown_line is None:
            vehicle.holding = True
            return []
        return [] if starts else [StartMission(vehicle.name)]
