"""Guides vehicles along a front by missions; replaces a mission when its path becomes outdated."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.items import MissionItem
from firemodel.landscape.landscape import Landscape
from mission_service.commands import (
    REJECTED,
    Announce,
    AnyCommand,
    StartMission,
    UploadMission,
)
from mission_service.config.scenario import Scenario
from mission_service.events import (
    TUNED,
    AnyEvent,
    AnyOperatorEvent,
    Observed,
    OperatorEvent,
    Resumed,
    SettingsChanged,
    UploadFinished,
    VehicleEvent,
)
from mission_service.guidance.front.islam_hu_planner import PerimeterPlanner
from mission_service.guidance.front.mission_renewal import CLOSE_BELOW, TURN_BACK, Renewal
from mission_service.guidance.front.unmonitored import FrontMonitor, observes_front
from mission_service.guidance.front.way import Planners
from mission_service.guidance.protocol import (
    Compared,
    ComparesParts,
    Decision,
    Guidance,
    Planner,
    decided,
)
from mission_service.guidance.team.team import TeamMember
from mission_service.guidance.team.team_size import CoverageTargets, TeamSizeAdviser
from mission_service.missions.first_mission import approach_path
from mission_service.missions.from_path import mission_along
from mission_service.position_fix import PositionFix
from mission_service.vehicles.availability import LEADS_TO
from mission_service.vehicles.first_climb import with_first_climb
from mission_service.vehicles.home_altitude import landing_items
from mission_service.vehicles.missions_sent import RETRY_S, MissionsSent
from mission_service.vehicles.traffic import TrafficManager
from mission_service.vehicles.vehicle_state import Vehicle, announce

Floats = NDArray[np.float64]
PATH_IS_CLEAR = "the path is clear"
MAX_FAILED_WAYS = 2  # failed uploads in a row after which other vehicles give way


class FrontFlight(Guidance):
    """The guidance along a front, which commands each vehicle according to its planner's decisions.

    ``planners`` maps each vehicle's name to its planner.
    """

    planners: Mapping[str, Planner]

    def __init__(
        self,
        planners: Planners,
        scenario: Scenario,
        landscape: Landscape,
        traffic: TrafficManager,
        missions: MissionsSent,
    ) -> None:
        self.scenario = scenario
        self.landscape = landscape
        self.planners = planners(scenario, landscape)
        self.traffic = traffic
        self._missions = missions
        self._phase = dict.fromkeys(self.planners, "")
        self._watch = FrontMonitor(self.planners, landscape.cell_size_m)
        self._renewal = Renewal(scenario.mission, traffic)
        self._sent_along: dict[str, Floats] = {}  # paths set by ``send_to``
        self._failed_ways: dict[str, int] = {}  # failed uploads to give way, in a row
        self._give_way_ids: dict[str, int] = {}  # ID of its last mission to give way
        self._giving_way = ("", 0)  # vehicle and ID of such a mission in the current event
        self._adviser = TeamSizeAdviser(
            CoverageTargets(scenario.planner.max_revisit_s, scenario.planner.max_unseen_advance_m)
        )

    def on_vehicle(self, vehicle: Vehicle, event: VehicleEvent) -> list[AnyCommand]:
        """Request a check of the mission after a correction or a sensor's observation."""
        if isinstance(event, Observed) and event.corrects:
            self._renewal.corrected(vehicle, event.at_us / 1e6)
        elif isinstance(event, Observed) and event.source:
            self._renewal.observed(vehicle, event.at_us / 1e6)
        return []

    def on_operator(self, event: AnyOperatorEvent) -> list[AnyCommand]:
        """Apply changed settings to the planners that use them."""
        if not isinstance(event, SettingsChanged):
            return []
        commands: list[AnyCommand] = []
        for planner in self.planners.values():
            if isinstance(planner, PerimeterPlanner):
                planner.tune(event)
        for name in (section.name for section in self.scenario.flown):
            if isinstance(self.planners[name], PerimeterPlanner):
                words = f"settings by {event.by}: {_in_words(event)}"
                commands.append(Announce(name, words))
            else:
                rule = self.scenario.planner.rule
                words = f"{REJECTED} the rule {rule} does not have these settings: none was changed"
                commands.append(Announce(name, words, "warning"))
        return commands

    def send_to(self, name: str, path_m: Floats | None) -> None:
        """Send a vehicle along a path (n, 2; x, y in metres); None returns it to its planner."""
        self._sent_along.pop(name, None)
        if path_m is not None:
            self._sent_along[name] = path_m

    def sent_to(self, name: str) -> Floats | None:
        """Return the path along which ``send_to`` has sent a vehicle, or None."""
        return self._sent_along.get(name)

    def task_begun(self, name: str) -> bool:
        """Return whether a vehicle's planner has found the front."""
        return self.planners[name].phase != "approach"

    def task_path(self, name: str, x_m: float, y_m: float) -> Floats | None:
        """Return the path planned for a vehicle from a position; None during its approach."""
        if not self.task_begun(name):
            return None
        planner = self.planners[name]
        row, col = (float(value) for value in self.landscape.row_col_of(x_m, y_m))
        return self._path(planner, row, col)

    def first_path(self, vehicle: Vehicle, fix: PositionFix) -> Floats:
        """Return the path set by ``send_to``, or otherwise the path to the reported fire.

        The camera finds the front on the way to the fire.
        """
        sent_along = self._sent_along.get(vehicle.name)
        if sent_along is not None:
            return np.vstack([(fix.x_m, fix.y_m), sent_along])
        return approach_path(self.scenario, self.landscape, (fix.x_m, fix.y_m))

    def announcements(
        self, vehicle: Vehicle, at_s: float, decision: Decision | None
    ) -> list[AnyCommand]:
        """Return announcements of a new phase, a decision, and advice on the team size."""
        planner = self.planners[vehicle.name]
        commands: list[AnyCommand] = []
        if vehicle.availability.airborne and planner.phase != self._phase[vehicle.name]:
            self._phase[vehicle.name] = planner.phase
            commands.append(announce(vehicle, f"phase: {planner.phase}"))
        if decision is not None:
            commands.append(decided(vehicle.name, planner, decision))
            if decision.reversed:
                vehicle.due = TURN_BACK
            commands += self._advise(vehicle, planner, at_s)
        return commands

    def _advise(self, vehicle: Vehicle, planner: Planner, at_s: float) -> list[AnyCommand]:
        """Return an announcement if the advice on the team size has changed."""
        if not isinstance(planner, TeamMember):
            return []
        team = planner.team
        if not self._adviser.is_due(team.flying, at_s):
            return []
        ring = team.ring()
        advice = self._adviser.advise(ring, team.fleet(ring, at_s).speed_m_s, at_s)
        if advice is None:
            return []
        return [announce(vehicle, f"team: {advice[1]}", warning=advice[0])]

    def further_commands(
        self, event: AnyEvent, leaving: list[AnyCommand], vehicles: Mapping[str, Vehicle]
    ) -> list[AnyCommand]:
        """Record missions sent; report when monitoring of a part of the front ends or resumes."""
        names = vehicles if isinstance(event, OperatorEvent) else (event.vehicle,)
        for name in names:
            self._settle(vehicles[name], event, leaving)
        for command in leaving:
            if isinstance(command, UploadMission):
                if command.lands:
                    self.traffic.on_landing(command.vehicle, command.items)
                else:
                    self.traffic.on_mission(command.vehicle, command.mission_id, command.items)
        availability = {name: vehicle.availability for name, vehicle in vehicles.items()}
        commands = self._watch.standing_alarms() if isinstance(event, Resumed) else []
        relief = self.scenario.relief
        in_turn = () if relief is None else relief.vehicles  # the relief reports on their task
        for name in (each for each in names if each not in in_turn):
            available = availability[name].flies and availability[name].armed
            available &= not (vehicles[name].ordered or availability[name].on_ground)
            commands += self._watch.update(name, available, observes_front(event), availability)
        return commands

    def _settle(self, vehicle: Vehicle, event: AnyEvent, leaving: list[AnyCommand]) -> None:
        """Record the outcome of the last upload, and end giving way after other commands.

        After a failed upload, the vehicle continues to give way: the upload is repeated.
        """
        name = vehicle.name
        unconfirmed = None if vehicle.unconfirmed is None else vehicle.unconfirmed.pending
        pending, accepted = vehicle.pending or unconfirmed, vehicle.accepted
        self.traffic.on_outcome(
            name,
            0 if pending is None else pending.mission_id,
            0 if accepted is None else accepted.mission_id,
        )
        self._settle_giving_way(vehicle, event.at_us / 1e6, leaving)
        if isinstance(event, UploadFinished):
            self._settle_failure(event)
            return
        way_id = self._give_way_ids.get(name)
        if any(_leads_away(each, name) and not _is_upload(each, name, way_id) for each in leaving):
            self.traffic.end_giving_way(name)

    def _settle_failure(self, event: UploadFinished) -> None:
        """After two failed uploads in a row, record that a vehicle cannot give way: others do."""
        name = event.vehicle
        if event.mission_id != self._give_way_ids.get(name):
            return
        failed = 0 if event.outcome == "accepted" else self._failed_ways.get(name, 0) + 1
        self._failed_ways[name] = failed
        if failed >= MAX_FAILED_WAYS:
            self._failed_ways[name] = 0
            self.traffic.on_giving_way_prevented(name, event.at_us / 1e6)

    def _settle_giving_way(self, vehicle: Vehicle, at_s: float, leaving: list[AnyCommand]) -> None:
        """Record whether the current event's mission to give way is sent.

        If closed airspace prevents this mission, a vehicle that has given way to another one must
        not stay at its waiting position: a new mission is due.
        """
        name = vehicle.name
        (asked, mission_id), self._giving_way = self._giving_way, ("", 0)
        if asked != name:
            return
        if any(_is_upload(each, name, mission_id) for each in leaving):
            self._give_way_ids[name] = mission_id
            return
        self.traffic.on_giving_way_prevented(name, at_s)
        if self._has_way_on_board(vehicle):
            vehicle.due = vehicle.due or PATH_IS_CLEAR

    def lead(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        """Return the commands to give way, or to replace the mission if necessary."""
        if vehicle.pending is not None or _takes_off(vehicle):
            return []
        commands = self._give_way(vehicle, fix)
        if commands is not None:
            return commands
        return self._follow(vehicle, fix) if self._renewal.to_be_checked(vehicle, fix) else []

    def _stays_aside(self, vehicle: Vehicle, at_s: float) -> bool:
        """Return whether the last mission to give way is still on board and may be replaced.

        The next mission was then not sent, for example because closed airspace prevented it.
        """
        may_be_replaced = not vehicle.due and vehicle.proposed is None
        return self._has_way_on_board(vehicle) and may_be_replaced and at_s >= vehicle.not_before_s

    def _has_way_on_board(self, vehicle: Vehicle) -> bool:
        """Return whether the mission on board is the last one that was sent to give way."""
        accepted = vehicle.accepted
        return accepted is not None and accepted.mission_id == self._give_way_ids.get(vehicle.name)

    def _give_way(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand] | None:
        """Return the commands to move aside and hold there, or None if the path is clear."""
        waiting = self.traffic.gave_way_to(vehicle.name)
        other = self.traffic.give_way_to(vehicle.name)
        if other is None:
            if waiting is not None or self._stays_aside(vehicle, fix.at_s):
                vehicle.due = PATH_IS_CLEAR
            return None
        if other == waiting:
            if not self._has_way_on_board(vehicle):
                if fix.at_s < vehicle.upload_ended_at_s + RETRY_S:
                    return []  # the upload has failed, and is repeated later
            elif not self.traffic.comes_too_low(vehicle.name):
                return []
        place = self.traffic.waits_at(vehicle.name)
        upload = self._upload(vehicle, place, fix, f"give way to {other}", keeps_apart=True)
        self._giving_way = vehicle.name, upload.mission_id
        return [upload]

    def _follow(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        """Return the upload of a new mission if the path of the current mission is outdated."""
        planner, sent_along = self.planners[vehicle.name], self._sent_along.get(vehicle.name)
        if sent_along is not None:
            why = self._renewal.why_sent(vehicle, sent_along)
            return [] if why is None else [self._upload(vehicle, sent_along, fix, why)]
        if planner.phase == "approach":
            path, why = self.first_path(vehicle, fix), self._renewal.why_on_approach(vehicle)
            return [] if why is None else [self._upload(vehicle, path, fix, why)]
        is_open = self._renewal.is_open(vehicle, fix)
        ahead = self._path(planner, fix.row, fix.col) if is_open else None
        why = None if ahead is None else self._renewal.why(vehicle, ahead, fix)
        return [] if ahead is None or why is None else [self._upload(vehicle, ahead, fix, why)]

    def _path(self, planner: Planner, row: float, col: float) -> Floats | None:
        cells = np.asarray(planner.path(row, col), dtype=float)
        if not np.isfinite(cells).all():
            raise ValueError("the planner's path contains a value that is not finite")
        if len(cells) < 2:
            return None
        return np.column_stack(self.landscape.xy_of(cells[:, 0], cells[:, 1]))

    def preview(self, vehicle: Vehicle, fix: PositionFix) -> tuple[MissionItem, ...] | None:
        """Return the mission that an update would send now, or None; change no state."""
        planner = self.planners[vehicle.name]
        if planner.phase == "approach":
            return self.items(vehicle, self.first_path(vehicle, fix), fix)
        path = self._path(planner, fix.row, fix.col)
        return None if path is None else self.items(vehicle, path, fix)

    def compared(self, name: str, fix: PositionFix) -> Compared | None:
        """Return the importance of each cell of the front; None before the ``monitor`` phase."""
        planner = self.planners[name]
        if not isinstance(planner, ComparesParts) or planner.phase != "monitor":
            return None
        return planner.compared(fix.row, fix.col, fix.at_s)

    def settings(self) -> dict[str, float]:
        """Return the current settings of the perimeter planners."""
        for planner in self.planners.values():
            if isinstance(planner, PerimeterPlanner):
                return {name: getattr(planner.settings, name) for name in TUNED}
        return {}

    def _upload(
        self, vehicle: Vehicle, path: Floats, fix: PositionFix, why: str, keeps_apart: bool = False
    ) -> UploadMission:
        items = self.items(vehicle, path, fix)
        keeps_apart = keeps_apart or why == CLOSE_BELOW
        return self._missions.upload(vehicle, path, items, fix, why, keeps_apart)

    def items(self, vehicle: Vehicle, path_m: Floats, fix: PositionFix) -> tuple[MissionItem, ...]:
        """Return the mission along a path, above the missions of vehicles in lower layers."""
        flies = vehicle.availability.airborne
        items = mission_along(
            path_m,
            self.planners[vehicle.name].clockwise,
            vehicle.section,
            self.landscape,
            from_ground=not flies,
            landing=landing_items(vehicle, fix.at_s),
            min_at=self.traffic.min_altitudes(vehicle.name),
            start_m=(fix.x_m, fix.y_m) if flies else None,
        )
        return with_first_climb(items, vehicle, self.landscape, fix)


def _is_upload(command: AnyCommand, name: str, mission_id: int | None) -> bool:
    """Return whether a command uploads the mission with this ID to this vehicle."""
    if not isinstance(command, UploadMission) or command.vehicle != name:
        return False
    return command.mission_id == mission_id


def _leads_away(command: AnyCommand, name: str) -> bool:
    """Return whether a command ends a vehicle's flight along the mission on board."""
    if type(command) not in LEADS_TO or isinstance(command, StartMission):
        return False
    return command.vehicle == name


def _takes_off(vehicle: Vehicle) -> bool:
    """Return whether the vehicle is still taking off; a new mission would abort the takeoff.

    A new mission ends the takeoff at any height. ArduPlane then climbs at 1 to 4 m/s rather than
    10 m/s. A PX4 plane sinks back to the ground if the mission arrives shortly after lift-off
    (observed in flight). The takeoff ends when the next mission item becomes current.
    """
    return vehicle.takes_off and vehicle.mode == "mission"


def _in_words(event: SettingsChanged) -> str:
    return ", ".join(f"{name} = {value:g}" for name, value in event.given.items())
