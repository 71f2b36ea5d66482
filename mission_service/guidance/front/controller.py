"""Flight along a front: a rolling mission, renewed when it is no longer what should be flown."""

from collections.abc import Mapping

import numpy as np
import shapely
from numpy.typing import NDArray

from autopilot_bridge.items import MissionItem
from firemodel.landscape.landscape import Landscape
from mission_service.commands import Announce, AnyCommand, UploadMission
from mission_service.config.scenario import Scenario
from mission_service.events import TUNED, CrewEvent, Observed, SettingsTold, VehicleEvent
from mission_service.guidance.front.advice import Adviser, Wishes
from mission_service.guidance.front.perimeter import PerimeterPlanner
from mission_service.guidance.front.way import Planners
from mission_service.guidance.protocol import Compared, Decision, Guidance, Planner, decided
from mission_service.guidance.team.team import Seat
from mission_service.missions.approach import approach_path
from mission_service.missions.from_path import mission_along
from mission_service.position_fix import Here
from mission_service.vehicles.missions_sent import MissionsSent
from mission_service.vehicles.state import Vehicle, say
from mission_service.vehicles.traffic import Spacing

Floats = NDArray[np.float64]

# A new path is compared with the one being flown over this share of the horizon ...
COMPARED_SHARE = 0.25
# ... and a mission is extended when less than this share of the horizon is left.
LEFT_SHARE = 0.4
CHECK_EVERY_S = 2.0
CLOSE_BELOW = "another flies close below"


class FrontFlight(Guidance):
    """Leads each vehicle as its planner has it; ``planners`` by name."""

    planners: Mapping[str, Planner]

    def __init__(
        self,
        planners: Planners,
        scenario: Scenario,
        landscape: Landscape,
        spacing: Spacing,
        missions: MissionsSent,
    ) -> None:
        self.scenario = scenario
        self.landscape = landscape
        self.planners = planners(scenario, landscape)
        self.spacing = spacing
        self._missions = missions
        self._phase = dict.fromkeys(self.planners, "")
        self._corrected: set[str] = set()  # those whose whole path is to be compared
        self._adviser = Adviser(
            Wishes(scenario.planner.worst_age_s, scenario.planner.unseen_advance_m)
        )

    def heard(self, vehicle: Vehicle, event: VehicleEvent) -> list[AnyCommand]:
        """Note what people have corrected; else it lives on positions."""
        if isinstance(event, Observed) and event.corrects:
            self._corrected.add(vehicle.name)
            vehicle.not_before_s = min(vehicle.not_before_s, event.at_us / 1e6)
        return []

    def told(self, event: CrewEvent) -> list[AnyCommand]:
        """Other settings, for planners that have them."""
        if not isinstance(event, SettingsTold):
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
                words = f"the rule {rule} has no such settings: nothing was changed"
                commands.append(Announce(name, words, "warning"))
        return commands

    def first_path(self, vehicle: Vehicle, here: Here) -> Floats:
        """To where the fire is said to be; it finds the front on its way."""
        return approach_path(self.scenario, self.landscape, (here.x_m, here.y_m))

    def news(self, vehicle: Vehicle, at_s: float, decision: Decision | None) -> list[AnyCommand]:
        """A new phase, a decision, and advice to a team's user."""
        planner = self.planners[vehicle.name]
        commands: list[AnyCommand] = []
        if vehicle.presence.airborne and planner.phase != self._phase[vehicle.name]:
            self._phase[vehicle.name] = planner.phase
            commands.append(say(vehicle, f"phase: {planner.phase}"))
        if decision is not None:
            commands.append(decided(vehicle.name, planner, decision))
            if decision.reversed:
                vehicle.due = "turn back"
            commands += self._advise(vehicle, planner, at_s)
        return commands

    def _advise(self, vehicle: Vehicle, planner: Planner, at_s: float) -> list[AnyCommand]:
        """Tell a team's user what it can keep up with, when that has changed."""
        if not isinstance(planner, Seat):
            return []
        team = planner.team
        if not self._adviser.is_due(team.flying, at_s):
            return []
        ring = team.ring()
        news = self._adviser.at(ring, team.fleet(ring, at_s).speed_m_s, at_s)
        return [] if news is None else [say(vehicle, f"team: {news[1]}", warning=news[0])]

    def lead(self, vehicle: Vehicle, here: Here) -> list[AnyCommand]:
        """Give way, or renew the mission if that is due."""
        if vehicle.pending is not None or _takes_off(vehicle):
            return []
        aside = self._out_of_the_way(vehicle, here)
        if aside is not None:
            return aside
        if vehicle.due != CLOSE_BELOW and self.spacing.comes_too_low(vehicle.name):
            vehicle.due = CLOSE_BELOW
        if vehicle.proposed is not None and vehicle.due != CLOSE_BELOW:
            return []  # until it is accepted, refused or withdrawn
        if vehicle.due == "turn back" and not self.spacing.may_turn_back(vehicle.name):
            return []
        if vehicle.due or here.at_s >= vehicle.not_before_s:
            vehicle.not_before_s = here.at_s + CHECK_EVERY_S
            return self._follow(vehicle, here)
        return []

    def _out_of_the_way(self, vehicle: Vehicle, here: Here) -> list[AnyCommand] | None:
        """Step aside, and stay there; None when the way is free."""
        waiting = self.spacing.gave_way_to(vehicle.name)
        other = self.spacing.give_way_to(vehicle.name)
        if other is None:
            if waiting is not None:
                vehicle.due = "the way is free"
            return None
        if other == waiting and not self.spacing.comes_too_low(vehicle.name):
            return []
        place = self.spacing.waits_at(vehicle.name)
        return [self._upload(vehicle, place, here, f"give way to {other}", keeps_apart=True)]

    def _follow(self, vehicle: Vehicle, here: Here) -> list[AnyCommand]:
        """Renew the rolling mission when it is no longer what the vehicle should fly."""
        planner = self.planners[vehicle.name]
        if planner.phase == "approach":
            if vehicle.flown_line is not None and not vehicle.due:
                return []
            path = self.first_path(vehicle, here)
            return [self._upload(vehicle, path, here, vehicle.due or "fly to the fire")]
        settings = self.scenario.mission
        if not vehicle.due and here.at_s - vehicle.uploaded_at_s < settings.least_upload_interval_s:
            return []
        cells = planner.path(here.row, here.col)
        if len(cells) < 2:
            return []
        path = np.column_stack(self.landscape.xy_of(cells[:, 0], cells[:, 1]))
        why = self._why_renew(vehicle, path, here)
        return [] if why is None else [self._upload(vehicle, path, here, why)]

    def _why_renew(self, vehicle: Vehicle, path: Floats, here: Here) -> str | None:
        settings = self.scenario.mission
        line = vehicle.flown_line
        if line is None:
            return "no trusted mission on board"
        if vehicle.due:
            return vehicle.due
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
        share = 1.0 if vehicle.name in self._corrected else COMPARED_SHARE
        self._corrected.discard(vehicle.name)
        near = path[along <= share * settings.horizon_m]
        if float(shapely.distance(shapely.points(near), line).max()) > settings.path_tolerance_m:
            return "the front is not where the mission leads"
        left_m = line.length - line.project(shapely.Point(here.x_m, here.y_m))
        if left_m < LEFT_SHARE * settings.horizon_m:
            return "the mission is nearly flown"
        return None

    def preview(self, vehicle: Vehicle, here: Here) -> tuple[MissionItem, ...] | None:
        """The mission it would be sent now; nothing is changed by asking."""
        planner = self.planners[vehicle.name]
        if planner.phase == "approach":
            path = self.first_path(vehicle, here)
        else:
            cells = planner.path(here.row, here.col)
            if len(cells) < 2:
                return None
            path = np.column_stack(self.landscape.xy_of(cells[:, 0], cells[:, 1]))
        return self.items(vehicle, path, here)

    def compared(self, name: str, here: Here) -> Compared | None:
        """The importances of the front's cells; None before a first lap, and of other planners."""
        planner = self.planners[name]
        if not isinstance(planner, PerimeterPlanner) or planner.phase != "monitor":
            return None
        return planner.compared(here.row, here.col, here.at_s)

    def settings(self) -> dict[str, float]:
        """As the perimeter planners have them."""
        for planner in self.planners.values():
            if isinstance(planner, PerimeterPlanner):
                return {name: getattr(planner.settings, name) for name in TUNED}
        return {}

    def _upload(
        self, vehicle: Vehicle, path: Floats, here: Here, why: str, keeps_apart: bool = False
    ) -> UploadMission:
        items = self.items(vehicle, path, here)
        keeps_apart = keeps_apart or why == CLOSE_BELOW
        return self._missions.upload(vehicle, path, items, here, why, keeps_apart)

    def items(self, vehicle: Vehicle, path_m: Floats, here: Here) -> tuple[MissionItem, ...]:
        """The mission along a path, above those of vehicles in lower layers."""
        return mission_along(
            path_m,
            self.planners[vehicle.name].clockwise,
            vehicle.section,
            self.landscape,
            from_ground=not vehicle.presence.airborne,
            landing=vehicle.landing.at(here.at_s),
            least_at=self.spacing.least_altitudes(vehicle.name),
            start_m=(here.x_m, here.y_m) if vehicle.presence.airborne else None,
        )


def _takes_off(vehicle: Vehicle) -> bool:
    """Whether its autopilot still takes off: another mission would end that, however low it is.

    ArduPlane then climbs at 1 to 4 m/s rather than 10, and a PX4 plane that took off soon after its
    start sinks to the ground (flown). Past its takeoff is who has gone on to the next item.
    """
    return vehicle.takes_off and vehicle.mode == "mission"


def _in_words(told: SettingsTold) -> str:
    return ", ".join(f"{name} = {value:g}" for name, value in told.given.items())
