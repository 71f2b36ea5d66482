"""Lets vehicles take turns at one task: the next one takes off in time and resumes the task.

``relief/task_relief.py`` defines the roles. The vehicle on task must leave when its energy is
needed for the flight home (``EnergyWatch``). The next vehicle takes off so that it arrives
``overlap_s`` before this time, and flies to the vehicle on task, which then flies home. The next
vehicle continues to the place where the task was left, and takes over the planner and its map
there. A vehicle that is lost, taken over or ordered home leaves the task at once or after
``UNFIT_S``.

No vehicle takes off while ``Vehicle.waits_for_operator`` is set, which means that the sign-off is
missing.
"""

import math

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.ops import substring

from firemodel.landscape.landscape import Landscape
from mission_service import events
from mission_service.commands import AnyCommand, ShowRelief
from mission_service.config.relief_section import ReliefSection
from mission_service.core.energy_watch import EnergyWatch
from mission_service.core.relief_reports import (
    changed_alarm,
    changed_roles,
    lapse_alarm,
    next_vehicle,
)
from mission_service.guidance.protocol import Guidance
from mission_service.relief.meeting import meeting_point
from mission_service.relief.scenario_aircraft import time_to_task_s
from mission_service.relief.task_relief import TaskPlace, TaskRole, TaskVehicle, task_of
from mission_service.vehicles.vehicle_state import Vehicle, announce
from mission_service.vehicles.way_home import Vector

EVERY_S = 1.0
TAKEOFF_S = 45.0  # upload, arming and takeoff before the flight to the task
MAX_TAKEOFF_S = 180.0  # a vehicle not airborne after this time stays on the ground
UNFIT_S = 30.0  # time without link or control after which a vehicle leaves the task
NOTICE_S = 180.0  # before a due takeoff, an alarm is raised if no vehicle may take off
MEETING_M = 300.0  # horizontal distance at which the vehicle on task leaves
RUN_IN_M = 200.0  # length of the straight run-in to the place of the task
RESUMED_M, OVER_PLACE_M = 50.0, 20.0
# If something keeps the vehicle from flying over the place, for example closed airspace: the time
# since it last came nearer by APPROACH_M.
RESUME_LIMIT_S, APPROACH_M = 300.0, 20.0
MOVED_M, MOVED_SHARE = 100.0, 0.15  # a meeting point that has moved less is not sent again
FULL_PCT = 90.0
LEFT_ENOUGH_S = 300.0  # time on task with which a vehicle that was lost resumes
HELD_DOWN = ("return", "land", "hold")
AIRBORNE_ROLES = (TaskRole.RELIEVES, TaskRole.RESUMES, TaskRole.ON_TASK)


class Reliefs:
    """The reliefs of the group of vehicles in ``[relief]``."""

    def __init__(
        self,
        section: ReliefSection,
        landscape: Landscape,
        vehicles: dict[str, Vehicle],
        guidance: Guidance,
        energy: EnergyWatch,
    ) -> None:
        self._section = section
        self._landscape = landscape
        self._vehicles = {name: vehicles[name] for name in section.vehicles}
        self._guidance = guidance
        self._energy = energy
        self.task = task_of(section.vehicles)
        self._ordered_down: set[str] = set()  # by an operator, until the next order to fly
        self._checked_at_s = -math.inf
        for vehicle in self._vehicles.values():
            signed_off = section.standing_signoff or vehicle.section.autostart
            vehicle.waits_for_operator |= not signed_off

    # Events -----------------------------------------------------------------------------------

    def record_request(self, event: events.AnyOperatorEvent) -> None:
        """Record orders that keep vehicles on the ground, and service restarts."""
        if isinstance(event, events.Aborted):
            self._ordered_down |= set(self._vehicles)
        elif isinstance(event, events.ClearingOrdered):  # those in the air are ordered by name
            for name, vehicle in self._vehicles.items():
                self.task.members[name].released &= vehicle.availability.airborne
        elif isinstance(event, events.OrderGiven) and event.by != events.SERVICE:
            named = set(self._vehicles) & (
                {event.vehicle} if event.vehicle else set(self._vehicles)
            )
            for name in sorted(named):
                self._vehicles[name].lands_after_return = False
            if event.order in HELD_DOWN:
                self._ordered_down |= named
            elif event.order != "go-around":  # an order to fly
                self._ordered_down -= named
                for name in sorted(named):
                    self.task.members[name].flies_by_order = True
        elif isinstance(event, events.Resumed):
            self.task.alarm, self._checked_at_s = None, -math.inf
            for member in self.task.members.values():
                member.unfit_since_s = member.shown = None

    def stays_on_ground(self, vehicle: Vehicle) -> bool:
        """Return whether a vehicle stays on the ground because its takeoff is not yet due.

        A vehicle that has landed has the role LEAVES until its next position report.
        """
        member = self.task.members.get(vehicle.name)
        on_ground = not vehicle.availability.airborne
        return on_ground and member is not None and member.role not in AIRBORNE_ROLES

    def moved(self, vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        """Advance the roles at a vehicle's position report; each vehicle acts at its own report."""
        member = self.task.members.get(vehicle.name)
        if member is None:
            return []
        if member.role is TaskRole.ON_TASK:
            self._guidance.send_to(vehicle.name, None)
            self._record_place(vehicle)
        commands = self._resumed(member, vehicle, at_s)
        if 0.0 <= at_s - self._checked_at_s < EVERY_S:
            return commands
        self._checked_at_s = at_s
        for name, each in self._vehicles.items():
            commands += self._watched(self.task.members[name], each, at_s)
        commands += self._advance(at_s)
        alarm = lapse_alarm(self.task, self._vehicles, self._needs_next(at_s), at_s)
        commands += changed_alarm(self.task, alarm, self._vehicles)
        standing = self._section.standing_signoff
        return [*commands, *changed_roles(self.task, self._vehicles, standing, at_s)]

    def _record_place(self, vehicle: Vehicle) -> None:
        """Record the place of the task while the vehicle is following its planner."""
        fix, availability = vehicle.availability.fix, vehicle.availability
        serves = availability.flies and not vehicle.ordered and not vehicle.going_home
        if fix is None or not serves or not self._guidance.task_begun(vehicle.name):
            return
        speed_m_s = math.hypot(fix.east_m_s, fix.north_m_s)
        if speed_m_s > 1.0:
            course = fix.east_m_s / speed_m_s, fix.north_m_s / speed_m_s
            self.task.place = TaskPlace(fix.x_m, fix.y_m, *course)

    # Roles of each vehicle --------------------------------------------------------------------

    def _watched(self, member: TaskVehicle, vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        """Change the role of a vehicle that has landed, is leaving or does not take off."""
        availability = vehicle.availability
        on_ground = not (availability.airborne or availability.armed)
        if availability.taken_over or (availability.airborne and availability.in_failsafe):
            member.released = False  # its pilot or its autopilot lands it
        match member.role:
            case TaskRole.STANDS_BY:
                if availability.airborne:
                    return self._leave(member, vehicle, at_s)
                return self._signed_off_by_scenario(member, vehicle, at_s)
            case TaskRole.RELIEVES if not availability.airborne:
                return self._takes_off(member, vehicle, at_s)
            case TaskRole.LEAVES if availability.flies and not (
                vehicle.ordered or vehicle.sent_home
            ):
                return self._regained(member, vehicle, at_s)
            case _ if on_ground and availability.online:
                return self._landed(member, vehicle, at_s)
            case TaskRole.LEAVES:
                return []
        if availability.recalled or availability.landing != "none":
            return self._leave(member, vehicle, at_s)
        if availability.flies or (vehicle.ordered and availability.online):
            member.unfit_since_s = None
        elif member.unfit_since_s is None:
            member.unfit_since_s = at_s
        elif at_s - member.unfit_since_s >= UNFIT_S:
            return self._leave(member, vehicle, at_s)
        return []

    def _leave(self, member: TaskVehicle, vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        was_on_task = member.role is TaskRole.ON_TASK
        released = (vehicle.sent_home or vehicle.going_home) and not vehicle.availability.taken_over
        member.released = released and member.name not in self._ordered_down
        vehicle.lands_after_return = member.released
        member.flies_by_order = False
        member.change_role(TaskRole.LEAVES, at_s)
        self._guidance.send_to(member.name, None)
        place = self.task.place
        if not was_on_task or place is None:
            return []
        self.task.left_at_s = at_s
        lat_deg, lon_deg = self._landscape.lat_lon_of(place.x_m, place.y_m)
        words = f"leaves the task at {float(lat_deg):.5f}, {float(lon_deg):.5f}"
        return [announce(vehicle, words)]

    def _landed(self, member: TaskVehicle, vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        member.change_role(TaskRole.STANDS_BY, at_s)
        self._guidance.send_to(member.name, None)
        return []

    def _regained(self, member: TaskVehicle, vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        """Let a vehicle that flies again resume the task, or fly home if another one has the task.

        A vehicle that an operator ordered to fly is not sent home until its energy requires this.
        """
        found = vehicle.energy.estimate
        free = self.task.one_with(*AIRBORNE_ROLES) is None
        if free and not vehicle.going_home and found and found.time_on_task_s > LEFT_ENOUGH_S:
            member.change_role(TaskRole.RESUMES, at_s)
            return self._begin_to_resume(member, vehicle)
        if member.flies_by_order:
            return []
        vehicle.going_home = vehicle.lands_after_return = True  # the core orders its return
        member.released = member.name not in self._ordered_down
        return []

    def _takes_off(self, member: TaskVehicle, vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        """End a takeoff that needs a new sign-off or takes too long."""
        late = at_s - member.since_s > MAX_TAKEOFF_S
        if not late and not vehicle.waits_for_operator:
            return []
        vehicle.waits_for_operator = True
        vehicle.end_intentions()
        self._landed(member, vehicle, at_s)
        words = "has not taken off for its relief: it waits for an operator's order to start"
        return [announce(vehicle, words, warning=True)]

    def _signed_off_by_scenario(
        self, member: TaskVehicle, vehicle: Vehicle, at_s: float
    ) -> list[AnyCommand]:
        """Permit the next takeoff of a vehicle with a full battery, under the standing sign-off."""
        vehicle.battery.settle(at_s)
        charge_pct, availability = vehicle.battery.level_pct(at_s), vehicle.availability
        full = availability.online and charge_pct is not None and charge_pct >= FULL_PCT
        if not full:
            member.full_since_s = None
        elif member.full_since_s is None:
            member.full_since_s = at_s
        permitted = self._section.standing_signoff and member.released
        permitted &= not (availability.armed or member.name in self._ordered_down)
        since_s = member.full_since_s
        if not (permitted and vehicle.waits_for_operator) or since_s is None:
            return []
        if at_s - since_s < self._section.ready_after_s:
            return []
        vehicle.waits_for_operator = member.released = False
        words = f"ready at {charge_pct:.0f} % battery, under the scenario's standing sign-off"
        return [announce(vehicle, words)]

    # The task ---------------------------------------------------------------------------------

    def _advance(self, at_s: float) -> list[AnyCommand]:
        """Send the next vehicle to the task, and let the one on task leave."""
        task = self.task
        present = task.one_with(TaskRole.ON_TASK)
        relief = task.one_with(TaskRole.RELIEVES, TaskRole.RESUMES)
        if relief is None:
            return self._begin(present, at_s)
        vehicle = self._vehicles[relief.name]
        if relief.role is TaskRole.RESUMES:
            return []
        if present is not None:
            return self._approach(relief, present, at_s)
        if not vehicle.availability.airborne:
            return []
        if task.place is None:
            return self._take_task(relief, vehicle, at_s, "begins the task")
        relief.change_role(TaskRole.RESUMES, at_s)
        return self._begin_to_resume(relief, vehicle)

    def _begin(self, present: TaskVehicle | None, at_s: float) -> list[AnyCommand]:
        """Begin the takeoff of the next vehicle when it is due."""
        name, place = next_vehicle(self.task, self._vehicles, at_s), self.task.place
        if name is None:
            return []
        if present is not None and self._due_in_s(present, name, at_s) > 0.0:
            return []
        if present is None and place is not None:
            wind_m_s = self._energy.wind_m_s(self._vehicles[name], at_s)
            if math.isinf(self._flight_s(name, (place.x_m, place.y_m), wind_m_s)):
                return []
        member, vehicle = self.task.members[name], self._vehicles[name]
        member.change_role(TaskRole.RELIEVES, at_s)
        member.released, member.nearest_m = False, math.inf
        vehicle.flown_line, vehicle.start_again_at_s = None, at_s
        if present is not None:
            self._guidance.send_to(name, self._meeting(vehicle, self._vehicles[present.name]))
            return [announce(vehicle, f"takes off to relieve {present.name}")]
        if place is not None:
            self._guidance.send_to(name, self._path_to_place())
        return [announce(vehicle, "takes off for the task")]

    def _approach(self, relief: TaskVehicle, present: TaskVehicle, at_s: float) -> list[AnyCommand]:
        """Fly the next vehicle to the one on task, which leaves when they have met."""
        vehicle, other = self._vehicles[relief.name], self._vehicles[present.name]
        fix, other_fix = vehicle.availability.fix, other.availability.fix
        if fix is None or other_fix is None or not vehicle.availability.flies:
            return []
        apart_m = math.dist((fix.x_m, fix.y_m), (other_fix.x_m, other_fix.y_m))
        if self.task.place is None or apart_m > MEETING_M:
            self._guidance.send_to(relief.name, self._meeting(vehicle, other))
            return []
        other.going_home = True  # the core orders its return
        commands: list[AnyCommand] = [announce(other, f"relieved by {relief.name}")]
        commands += self._leave(present, other, at_s)
        relief.change_role(TaskRole.RESUMES, at_s)
        return [*commands, *self._begin_to_resume(relief, vehicle)]

    def _begin_to_resume(self, member: TaskVehicle, vehicle: Vehicle) -> list[AnyCommand]:
        member.nearest_m = member.approach_m = math.inf
        if self.task.place is not None:
            self._guidance.send_to(member.name, self._path_to_place())
        return [announce(vehicle, "flies to the place where the task was left")]

    def _resumed(self, member: TaskVehicle, vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        """Let a vehicle take over the task when it is over the place where the task was left."""
        fix, place = vehicle.availability.fix, self.task.place
        if member.role is not TaskRole.RESUMES or fix is None or not vehicle.availability.flies:
            return []
        if place is None:
            return self._take_task(member, vehicle, at_s, "begins the task")
        distance_m = place.distance_m(fix.x_m, fix.y_m)
        recedes = distance_m > member.nearest_m
        member.nearest_m = min(member.nearest_m, distance_m)
        over = distance_m <= OVER_PLACE_M or (recedes and member.nearest_m <= RESUMED_M)
        if distance_m < member.approach_m - APPROACH_M:
            member.approach_m, member.approach_s = distance_m, at_s
        late = at_s - max(member.since_s, member.approach_s) > RESUME_LIMIT_S
        if not (over or late):
            return []
        words = f"resumes the task {member.nearest_m:.0f} m from where it was left"
        return self._take_task(member, vehicle, at_s, words)

    def _take_task(
        self, member: TaskVehicle, vehicle: Vehicle, at_s: float, words: str
    ) -> list[AnyCommand]:
        member.change_role(TaskRole.ON_TASK, at_s)
        before, self.task.holder = self.task.holder, member.name
        member.shown = ("on task", "on task")
        shown = ShowRelief(member.name, "on task", "on task", takes_over_from=before)
        return [announce(vehicle, words), shown]

    # Places and times -------------------------------------------------------------------------

    def _meeting(self, vehicle: Vehicle, present: Vehicle) -> NDArray[np.float64]:
        """Return the meeting point (1, 2), or the one last sent if this is near."""
        fix, other_fix = vehicle.availability.fix, present.availability.fix
        assert fix is not None
        assert other_fix is not None
        own, other = (fix.x_m, fix.y_m), (other_fix.x_m, other_fix.y_m)
        path = [other]
        if present.flown_line is not None:
            line = present.flown_line
            ahead = substring(line, line.project(shapely.Point(other)), line.length)
            path += [(float(x_m), float(y_m)) for x_m, y_m in ahead.coords]
        speed_m_s = vehicle.section.airspeed_m_s
        point = meeting_point(path, present.section.airspeed_m_s, own, speed_m_s)
        sent = self._guidance.sent_to(vehicle.name)
        near_m = max(MOVED_M, MOVED_SHARE * math.dist(own, point))
        if sent is not None and math.dist(sent[-1], point) < near_m:
            return sent
        return np.array([point])

    def _path_to_place(self) -> NDArray[np.float64]:
        """Return the path over the place where the task was left, and then along the front."""
        place = self.task.place
        assert place is not None
        path = np.array([place.before(RUN_IN_M), (place.x_m, place.y_m)])
        ahead = self._guidance.task_path(self.task.holder, place.x_m, place.y_m)
        return path if ahead is None else np.vstack([path, ahead])

    def _due_in_s(self, present: TaskVehicle, name: str, at_s: float) -> float:
        """Return the seconds until the next vehicle must take off; infinity if it cannot arrive."""
        other = self._vehicles[present.name]
        found, fix = other.energy.estimate, other.availability.fix
        if found is None or fix is None:
            return math.inf
        out_s = self._flight_s(name, (fix.x_m, fix.y_m), self._energy.wind_m_s(other, at_s))
        if math.isinf(out_s):
            return math.inf
        return found.time_on_task_s - TAKEOFF_S - out_s - self._section.overlap_s

    def _flight_s(self, name: str, task_m: Vector, wind_m_s: Vector) -> float:
        """Return the duration (s) of a flight to a place; infinity if the wind prevents it."""
        vehicle = self._vehicles[name]
        where = (self._landscape, vehicle.home_m, task_m)
        return time_to_task_s(vehicle.section, *where, wind_m_s)

    def _needs_next(self, at_s: float) -> bool:
        """Return whether the next vehicle should take off soon."""
        present = self.task.one_with(TaskRole.ON_TASK)
        if present is None:
            return True
        others = [name for name in self._vehicles if name != present.name]
        return min(self._due_in_s(present, name, at_s) for name in others) <= NOTICE_S
