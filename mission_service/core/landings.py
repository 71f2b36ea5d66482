"""Lands vehicles at home, one at a time per field, by a mission or by a return. Pure.

A plane or a VTOL lands by an uploaded mission that only lands (``missions/landing_mission.py``), a
multirotor by the autopilot's return. ``vehicles/landing_state.py`` defines the phases. On the final
leg of a landing, a hold does not stop the vehicle, because a plane would fly it at a height of a
few metres: each order to stop is a go-around, which ends in a hold at a safe height.
"""

import math
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from firemodel.landscape.landscape import Landscape
from mission_service.commands import (
    AnyCommand,
    ClearAlarm,
    GoAround,
    Hold,
    Land,
    RaiseAlarm,
    Return,
    ShowLanding,
)
from mission_service.core.airspace_guard import AirspaceGuard
from mission_service.core.decision_engine import DecisionEngine
from mission_service.errors import ScenarioError
from mission_service.events import CommandFinished, MissionProgress, UploadFinished
from mission_service.missions.landing_mission import LandingMission, landing_mission
from mission_service.position_fix import PositionFix
from mission_service.vehicles.availability import GOING_HOME, MISSION, named_mode
from mission_service.vehicles.endurance import must_return
from mission_service.vehicles.home_altitude import corrected, home_error_m
from mission_service.vehicles.landing_state import LIMITS_S, LandingPhase
from mission_service.vehicles.missions_sent import MissionsSent
from mission_service.vehicles.traffic import TrafficManager
from mission_service.vehicles.vehicle_state import Vehicle, announce

LANDING = "landing"  # kind of the alarm
FIELD_M = 300.0  # homes within this distance share a field
RETRY_S, MAX_FAILURES = 5.0, 3
HOLD_AGAIN_S, START_AGAIN_S = 3.0, 10.0
# The final leg begins at approach height; above this limit, another item is being flown.
FINAL_BELOW_M, LOW_M = 15.0, 15.0
COPTER_FINAL_M, COPTER_NEAR_M = 15.0, 30.0  # height, and distance from home, of the final descent
COPTER_AROUND_M = 30.0  # height above home after a copter's go-around
REACHED_M = 10.0  # go-around height counts as reached this far below it
HOME_WITHIN_M = 500.0
LANDS_BELOW_M = 40.0  # below this height in a return, the autopilot is landing
CIRCLES_WITHIN_M = 5.0  # deviation from the return height while ArduPlane circles above home


def lands_below_m(vehicle: Vehicle) -> float:
    """Return the height (m) below which a vehicle in a return is landing.

    ArduPlane circles above home at its return height, which may be low (quadplanes in SITL: 20 m).
    """
    height_m = vehicle.return_flight.height_m
    if not vehicle.section.is_arduplane or height_m is None:
        return LANDS_BELOW_M
    return min(LANDS_BELOW_M, max(height_m - CIRCLES_WITHIN_M, 0.0))


class Landings:
    """The part of the core that lands vehicles; ``Vehicle.landing_state`` stores the phases."""

    def __init__(
        self,
        landscape: Landscape,
        decision_engine: DecisionEngine,
        vehicles: dict[str, Vehicle],
        traffic: TrafficManager,
        missions: MissionsSent,
        airspace: AirspaceGuard,
    ) -> None:
        self.landscape = landscape
        self.decision_engine = decision_engine
        self.vehicles = vehicles
        self.traffic = traffic
        self._missions = missions
        self._airspace = airspace

    # Orders -----------------------------------------------------------------------------------

    def obstacle(self, vehicle: Vehicle) -> str:
        """Return why a vehicle cannot be ordered to land; "" without an obstacle."""
        availability = vehicle.availability
        if not availability.airborne or availability.fix is None:
            return "it is on the ground"
        if not availability.online:
            return "its link is lost: order land again when the link is restored"
        if not availability.position_good:
            return "it has no position fix"
        if availability.mode in GOING_HOME and availability.height_m < lands_below_m(vehicle):
            return f"it is already landing in {named_mode(availability.mode)}"
        if vehicle.section.kind == "copter":
            return self._airspace.return_obstacle(vehicle, availability.fix)
        try:
            mission = self.mission_from(vehicle, availability.fix)
        except ScenarioError as error:
            return str(error)
        return self._airspace.mission_obstacle(vehicle, mission.items)

    def land(self, vehicle: Vehicle, why: str, at_s: float) -> list[AnyCommand]:
        """Begin a landing, or wait until the field is free; ``obstacle`` must be empty."""
        vehicle.ordered, vehicle.hold_again_at_s = "", None
        vehicle.end_intentions()
        vehicle.waits_for_operator = True
        vehicle.landing_state.failures = 0
        words = announce(vehicle, f"landing: {why}")
        cleared = self.end(vehicle)
        first = self._first_at_field(vehicle, at_s)
        if first is None:
            return [words, *cleared, *self._land(vehicle, at_s)]
        shown = self._enter(vehicle, LandingPhase.WAITING, at_s)
        waits = announce(vehicle, f"waits to land until {first} has landed")
        return [words, *cleared, *shown, waits, *self._hold_in_mission(vehicle, at_s)]

    def must_go_around(self, vehicle: Vehicle) -> bool:
        """Return whether a vehicle that is ordered to hold must first go around."""
        return vehicle.landing_state.landing_phase in (
            LandingPhase.FINAL,
            LandingPhase.GOING_AROUND,
        )

    def go_around(self, vehicle: Vehicle, why: str, at_s: float) -> list[AnyCommand]:
        """Break off a landing on its final leg; the vehicle then holds."""
        words = announce(vehicle, f"goes around: {why}", warning=True)
        if vehicle.landing_state.landing_phase is LandingPhase.GOING_AROUND:
            return [words]
        vehicle.end_intentions()
        vehicle.sent_home = vehicle.going_home = False
        shown = self._enter(vehicle, LandingPhase.GOING_AROUND, at_s)
        return [words, *shown, self._around(vehicle)]

    def leave_queue(self, vehicle: Vehicle) -> list[AnyCommand]:
        """End a landing that has not begun, so that no other vehicle waits for it.

        No command is sent to the vehicle, which counts as held until an operator's order.
        """
        if vehicle.landing_state.landing_phase not in (LandingPhase.WAITING, LandingPhase.SENDING):
            return []
        vehicle.drop_upload()
        vehicle.end_intentions()
        vehicle.ordered, vehicle.hold_again_at_s = "hold", None
        return self.end(vehicle, holds=True)

    def end(self, vehicle: Vehicle, holds: bool = False) -> list[AnyCommand]:
        """End any landing because of an order, a touchdown or a mode change."""
        state = vehicle.landing_state
        commands: list[AnyCommand] = []
        if state.active:
            commands += self._enter(vehicle, LandingPhase.NONE, state.since_s, holds)
        if state.alarm:
            state.alarm = False
            commands.append(ClearAlarm(vehicle.name, LANDING))
        return commands

    # Events -----------------------------------------------------------------------------------

    def _lands_after_return(self, vehicle: Vehicle, fix: PositionFix) -> bool:
        """Return whether a vehicle that returned must land: it was relieved or has no time left.

        Planes circle above home, with ArduPlane until the battery is empty. The other autopilots
        land. Below ``lands_below_m``, a plane is still climbing, or its autopilot is landing it.
        """
        section, availability = vehicle.section, vehicle.availability
        found, relieved = vehicle.energy.estimate, vehicle.lands_after_return
        circles = section.winged and (section.stack == "ardupilot" or relieved)
        circles &= availability.mode == "return" and availability.airborne
        circles &= availability.height_m >= lands_below_m(vehicle)
        circles &= not vehicle.landing_state.active
        if not circles or found is None or availability.in_failsafe:
            return False
        if vehicle.landing_state.alarm or not availability.position_good:
            return False
        near = math.dist((fix.x_m, fix.y_m), vehicle.home_m) <= HOME_WITHIN_M
        return near and (relieved or found.time_on_task_s <= 0.0)

    def _land_after_return(self, vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        """Begin the landing of a vehicle that has returned; raise an alarm if it cannot land."""
        obstacle = self.obstacle(vehicle)
        if obstacle:
            return self._raise(vehicle, f"it circles above home and cannot land: {obstacle}")
        relieved = vehicle.lands_after_return
        return self.land(vehicle, "relieved" if relieved else "no time left on task", at_s)

    def found_flying(self, vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        """Continue a landing because the vehicle is flying the landing mission on board again."""
        state = vehicle.landing_state
        if not _landing_accepted(vehicle) or state.active or not vehicle.availability.airborne:
            return []
        vehicle.ordered, vehicle.hold_again_at_s = "", None
        return [
            *self._enter(vehicle, LandingPhase.APPROACH, at_s),
            announce(vehicle, "flies its landing mission"),
        ]

    def progressed(self, vehicle: Vehicle, event: MissionProgress) -> None:
        """Record the current item of the landing mission."""
        vehicle.landing_state.seq = event.current_seq

    def uploaded(self, vehicle: Vehicle, event: UploadFinished) -> list[AnyCommand]:
        """Start the landing mission after its upload, or repeat a failed upload."""
        state = vehicle.landing_state
        if state.landing_phase is not LandingPhase.SENDING:
            return []
        if event.outcome != "accepted":
            return self._failed(
                vehicle, f"its mission {event.outcome}: {event.reason}", event.at_us
            )
        state.seq = 0
        return self._fly(vehicle, event.at_us / 1e6)

    def command_finished(self, vehicle: Vehicle, event: CommandFinished) -> list[AnyCommand]:
        """Handle a refused start of the landing mission, or a refused go-around."""
        phase = vehicle.landing_state.landing_phase
        if event.accepted:
            return []
        if event.command == "fly landing" and phase is LandingPhase.SENDING:
            if _landing_accepted(vehicle) and vehicle.mode == MISSION:
                return []  # it flies the landing mission
            return self._failed(vehicle, f"its start was refused: {event.reason}", event.at_us)
        if event.command == "go around" and phase is LandingPhase.GOING_AROUND:
            shown = self._enter(vehicle, LandingPhase.FINAL, event.at_us / 1e6)
            words = f"go-around refused: {event.reason}; it continues to land"
            return [*shown, *self._raise(vehicle, words)]
        return []

    def moved(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        """Advance or begin the landing of a vehicle at its new position."""
        state = vehicle.landing_state
        if vehicle.unconfirmed is not None:
            return []  # wait until its mission is read back
        if self._lands_after_return(vehicle, fix):
            return self._land_after_return(vehicle, fix.at_s)
        commands = self._MOVED[state.landing_phase](self, vehicle, fix)
        if (
            state.active
            and not state.alarm
            and fix.at_s - state.since_s > LIMITS_S[state.landing_phase]
        ):
            lasted_s = LIMITS_S[state.landing_phase]
            words = f"the landing phase {state.shown!r} has lasted {lasted_s:.0f} s"
            commands += self._raise(vehicle, words)
        return commands

    def read_back(self, vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        """Compare the landing with the mode and the mission read back after a restart."""
        state = vehicle.landing_state
        in_landing = vehicle.mode == MISSION and _landing_accepted(vehicle)
        if not state.active:
            continues = in_landing and not vehicle.ordered
            return self.found_flying(vehicle, at_s) if continues else []
        if in_landing or self.must_go_around(vehicle):
            return []
        if vehicle.section.kind == "copter" and state.landing_phase is LandingPhase.APPROACH:
            return [] if vehicle.mode in GOING_HOME else [Return(vehicle.name)]
        why = "the service was restarted, and the vehicle does not fly the landing mission"
        return self._stop(vehicle, why, at_s)

    # Phases -----------------------------------------------------------------------------------

    def _none(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        return []

    def _waiting(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        availability = vehicle.availability
        fit = availability.position_good and not availability.in_failsafe
        closed = self._airspace.flight_obstacle(vehicle, fix) if fit else ""
        if closed:
            return self._stop(vehicle, closed, fix.at_s)
        if must_return(vehicle):
            vehicle.sent_home = True
            self.decision_engine.recall(vehicle.name, fix.at_s)
            blocked = self._airspace.return_obstacle(vehicle, fix)
            if blocked:  # the airspace guard routes it home
                why = f"landing ended: its low energy requires a return, and {blocked}"
                return [
                    announce(vehicle, why, warning=True),
                    *self.end(vehicle),
                    Return(vehicle.name),
                ]
            words = announce(
                vehicle, "returns because of low energy, and waits at home for its landing"
            )
            return [words, Return(vehicle.name)]
        if fit and self._first_at_field(vehicle, fix.at_s) is None:
            obstacle = self.obstacle(vehicle)
            if obstacle:
                return self._stop(vehicle, obstacle, fix.at_s)
            return self._land(vehicle, fix.at_s)
        again_at_s = vehicle.landing_state.again_at_s
        if again_at_s is not None and fix.at_s < again_at_s:
            return []
        return self._hold_in_mission(vehicle, fix.at_s)

    def _sending(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        state = vehicle.landing_state
        on_board = vehicle.pending is None and _landing_accepted(vehicle)
        # Also if its start counted as refused, because the acknowledgement was late or lost:
        flies_landing = on_board and vehicle.mode == MISSION and not state.held
        if state.again_at_s is not None and not flies_landing:
            if fix.at_s < state.again_at_s or vehicle.availability.in_failsafe:
                return []
            state.again_at_s, state.held = None, False
            return self._send(vehicle, fix)
        if not on_board and not vehicle.awaits_mission:
            return self._failed(vehicle, "its mission was not sent", round(fix.at_s * 1e6))
        if not on_board:
            return []
        if flies_landing:
            return self._enter(vehicle, LandingPhase.APPROACH, fix.at_s)
        if fix.at_s < state.start_again_at_s or vehicle.availability.in_failsafe:
            return []
        return self._fly(vehicle, fix.at_s)

    def _approach(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        state, height_m = vehicle.landing_state, vehicle.availability.height_m
        away_m = math.dist((fix.x_m, fix.y_m), vehicle.home_m)
        if vehicle.section.kind == "copter":
            final = height_m <= COPTER_FINAL_M and away_m <= COPTER_NEAR_M
        else:
            mission = state.mission
            assert mission is not None
            near = away_m <= mission.final_m and height_m <= mission.height_m + FINAL_BELOW_M
            low = height_m < mission.height_m - LOW_M
            # A VTOL begins its landing item at approach height.
            begun = vehicle.section.kind != "vtol" and state.seq >= mission.final_seq
            final = near and (begun or low)
        return self._enter(vehicle, LandingPhase.FINAL, fix.at_s) if final else []

    def _final(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        state = vehicle.landing_state
        if state.mission is None or state.seq <= state.mission.final_seq:
            return []
        if vehicle.section.stack == "px4" or vehicle.section.kind == "copter":
            return []
        words = announce(vehicle, "goes around: its autopilot aborted the landing", warning=True)
        return [words, *self._enter(vehicle, LandingPhase.GOING_AROUND, fix.at_s)]

    def _going_around(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        mission = vehicle.landing_state.mission
        copter = vehicle.section.kind == "copter" or mission is None
        height_m = COPTER_AROUND_M if copter or mission is None else mission.height_m
        if vehicle.availability.height_m < height_m - REACHED_M:
            return []
        vehicle.ordered, vehicle.hold_again_at_s = "hold", None
        words = f"holds at {height_m:.0f} m above home after its go-around; order land or resume"
        return [*self.end(vehicle, holds=True), announce(vehicle, words)]

    _MOVED: ClassVar[dict[LandingPhase, Callable[..., list[AnyCommand]]]] = {
        LandingPhase.NONE: _none,
        LandingPhase.WAITING: _waiting,
        LandingPhase.SENDING: _sending,
        LandingPhase.APPROACH: _approach,
        LandingPhase.FINAL: _final,
        LandingPhase.GOING_AROUND: _going_around,
    }

    # Parts ------------------------------------------------------------------------------------

    def _enter(
        self, vehicle: Vehicle, phase: LandingPhase, at_s: float, holds: bool = False
    ) -> list[AnyCommand]:
        """Change the phase; return the command that shows it."""
        vehicle.landing_state.enter(phase, at_s, vehicle.name)
        shown = ShowLanding(vehicle.name, phase.value, holds)
        self.decision_engine.show_landing(shown, at_s)
        return [shown]

    def _first_at_field(self, vehicle: Vehicle, at_s: float) -> str | None:
        """Return the vehicle whose landing this vehicle must wait for, if any."""
        own = vehicle.landing_state
        for other in self.vehicles.values():
            state = other.landing_state
            if other is vehicle or math.dist(other.home_m, vehicle.home_m) > FIELD_M:
                continue
            if not other.availability.may_still_land(at_s):
                continue
            waits_longer = state.landing_phase is LandingPhase.WAITING
            if own.landing_phase is LandingPhase.WAITING:
                waits_longer &= state.turn(other.name) < own.turn(vehicle.name)
            if state.uses_field or waits_longer:
                return other.name
        return None

    def _land(self, vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        fix = vehicle.availability.fix
        assert fix is not None
        if vehicle.section.winged:
            shown = self._enter(vehicle, LandingPhase.SENDING, at_s)
            return [*shown, *self._send(vehicle, fix)]
        vehicle.sent_home = True
        self.decision_engine.recall(vehicle.name, at_s)
        return [*self._enter(vehicle, LandingPhase.APPROACH, at_s), Return(vehicle.name)]

    def _send(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        """Return the upload of the landing mission."""
        try:
            mission = self.mission_from(vehicle, fix)
        except ScenarioError as error:
            return self._stop(vehicle, str(error), fix.at_s)
        vehicle.landing_state.mission = mission
        path = np.array([(fix.x_m, fix.y_m), vehicle.home_m])
        why = f"land on course {mission.course_deg:.0f}"
        error_m = home_error_m(vehicle)
        if error_m:
            side = "above" if error_m > 0.0 else "below"
            why += f", {abs(error_m):.1f} m {side} the autopilot's altitude of home"
        return [self._missions.upload(vehicle, path, mission.items, fix, why, lands=True)]

    def mission_from(self, vehicle: Vehicle, fix: PositionFix) -> LandingMission:
        """Return the mission that lands a plane from a position. Raises ScenarioError."""
        wind, measured = (
            vehicle.landing.wind_at(fix.at_s),
            vehicle.availability.recent_wind(fix.at_s),
        )
        if measured is not None:
            wind = (measured.speed_m_s, measured.from_deg)
        min_at = self.traffic.min_altitudes(vehicle.name)
        place = (fix.x_m, fix.y_m)
        closed = vehicle.landing.closed
        mission = landing_mission(vehicle.section, self.landscape, wind, place, min_at, closed)
        return mission._replace(items=corrected(mission.items, vehicle))

    def _fly(self, vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        """Start the mission on board, unless the vehicle is already flying it."""
        vehicle.landing_state.start_again_at_s = at_s + START_AGAIN_S
        return [] if vehicle.mode == MISSION else [Land(vehicle.name)]

    def _failed(self, vehicle: Vehicle, why: str, at_us: int) -> list[AnyCommand]:
        """Send the mission again after a failure; after several failures, stop the landing."""
        state, at_s = vehicle.landing_state, at_us / 1e6
        state.failures += 1
        if state.failures >= MAX_FAILURES:
            return self._stop(vehicle, why, at_s)
        state.again_at_s, state.held = at_s + RETRY_S, vehicle.mode == MISSION
        words = f"landing: {why}; trying again in {RETRY_S:.0f} s"
        return [announce(vehicle, words, warning=True), *self._hold_in_mission(vehicle, None)]

    def _stop(self, vehicle: Vehicle, why: str, at_s: float) -> list[AnyCommand]:
        """Stop a landing before its final leg: the vehicle returns again or holds."""
        returns = vehicle.sent_home
        shown = self._enter(vehicle, LandingPhase.NONE, at_s, holds=not returns)
        alarm = self._raise(vehicle, f"landing ended: {why}")
        if returns:
            self.decision_engine.recall(vehicle.name, at_s)
            back: list[AnyCommand] = [] if vehicle.mode == "return" else [Return(vehicle.name)]
            return [*alarm, *shown, *back]
        vehicle.ordered, vehicle.hold_again_at_s = "hold", at_s + HOLD_AGAIN_S
        return [*alarm, *shown, Hold(vehicle.name)]

    def _raise(self, vehicle: Vehicle, words: str) -> list[AnyCommand]:
        vehicle.landing_state.alarm = True
        alarm = RaiseAlarm(vehicle.name, LANDING, words, "severe")
        return [announce(vehicle, words, warning=True), alarm]

    def _hold_in_mission(self, vehicle: Vehicle, at_s: float | None) -> list[AnyCommand]:
        """Hold a vehicle that is flying its mission; if ``at_s`` is given, schedule a repeat."""
        if at_s is not None:
            vehicle.landing_state.again_at_s = at_s + HOLD_AGAIN_S
        return [Hold(vehicle.name)] if vehicle.mode == MISSION else []

    def _around(self, vehicle: Vehicle) -> GoAround:
        """Return the go-around, to the landing mission's position; multirotors climb in place."""
        availability, mission = vehicle.availability, vehicle.landing_state.mission
        fix = availability.fix
        assert fix is not None
        home_amsl_m = fix.altitude_m - availability.height_m
        if vehicle.section.kind == "copter" or mission is None:
            lat_deg, lon_deg = self.landscape.lat_lon_of(fix.x_m, fix.y_m)
            place = (float(lat_deg), float(lon_deg))
            return GoAround(vehicle.name, *place, home_amsl_m + COPTER_AROUND_M)
        return GoAround(vehicle.name, *mission.around, home_amsl_m + mission.height_m)


def _landing_accepted(vehicle: Vehicle) -> bool:
    """Return whether the mission that the vehicle accepted last is a landing mission."""
    return vehicle.accepted is not None and vehicle.accepted.lands
