"""A team in flight: one on-board map for all vehicles, and a rule that directs each vehicle.

All cameras update the same map. The front is a ring of the map's 360 bearings. Whenever a vehicle
reaches a new bearing, the rule decides the vehicle's direction. In the first lap, every second
vehicle flies in the opposite direction. This lap ends when the map is complete or a vehicle has
flown around the fire.

The fleet given to the rule does not contain vehicles that have left (lost, recalled, or on the
ground), so the other vehicles close the gap at their next decisions. A vehicle that has left
returns to the fleet when it is flying and has the front in view.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission_service.events import Observed
from mission_service.guidance.fire_map import BEARINGS, EAST, NORTH, FireMap
from mission_service.guidance.front.first_lap import (
    CameraView,
    LapProgress,
    append_view,
    recentred_map,
    view_of,
)
from mission_service.guidance.front.front_path import (
    PathSettings,
    bearing_deg,
    extrapolated_front,
    path_along,
    reconstructed_front,
)
from mission_service.guidance.protocol import Decision, Phase
from mission_service.guidance.team.dead_reckoning import ReportedPosition, dead_reckoned_fleet
from mission_service.guidance.team.front_ring import ActiveFleet, FrontRing, TeamRule

Floats = NDArray[np.float64]

FRESH_S = 2.0  # newer reports need no dead reckoning (several reports arrive per second)
LOST_AFTER_S = 30.0
CARRIED_BACK = 30  # maximum drift of a vehicle in cells during a turn back


@dataclass(frozen=True, slots=True)
class TeamSettings:
    """The settings of a team in addition to its rule."""

    cell_m: float
    clockwise_first: bool
    ignition_known: bool
    baseline_s: float
    smoothing_deg: int
    path: PathSettings


@dataclass(frozen=True, slots=True)
class MemberPerformance:
    """The speed of a vehicle, and the duration of its turn back."""

    speed_m_s: float
    turn_s: float  # duration of a turn back, during which the rule makes no decision


class Team:
    """A team's map, rule and members; positions are rows and columns of the landscape's grid."""

    def __init__(
        self,
        rule: TeamRule,
        settings: TeamSettings,
        performances: Mapping[str, MemberPerformance],
        shape: tuple[int, int],
        centre: tuple[float, float],
        ignited_at_s: float,
    ) -> None:
        self.rule = rule
        self.settings = settings
        self.surveyed = False  # whether the first lap has ended
        self.map = FireMap(shape, *centre, ignited_at_s, settings.baseline_s)
        self._observations: list[CameraView] = []
        self._members = {
            name: TeamMember(self, number, performance)
            for number, (name, performance) in enumerate(performances.items())
        }

    def member(self, name: str) -> "TeamMember":
        """Return the planner of one vehicle."""
        return self._members[name]

    def add_view(self, observed: Observed) -> NDArray[np.bool_]:
        """Update the map from a camera window; return which bearings are in view (360)."""
        seen = view_of(observed)
        if not self.surveyed and not self.settings.ignition_known:
            append_view(self._observations, seen)
        return self.map.add_window(*seen)

    def end_survey(self) -> None:
        """End the first lap; the fire's centre replaces an unknown ignition point."""
        self.surveyed = True
        if not self.settings.ignition_known:
            self.map, _ = recentred_map(self.map, self._observations)
            self._observations.clear()

    def ring(self) -> FrontRing:
        """Return the map's front as a ring with one cell for each bearing."""
        cell_m = self.settings.cell_m
        outer, visited_at_s = self.map.filled_outer()
        north, east = outer * NORTH, outer * EAST
        return FrontRing(
            cell_m * np.hypot(np.roll(north, -1) - north, np.roll(east, -1) - east),
            cell_m * self.map.spread_rate_cells_s(self.settings.smoothing_deg),
            visited_at_s,
        )

    @property
    def flying(self) -> int:
        """The number of vehicles that fly along the front, according to the last reports."""
        return sum(member.flies for member in self._members.values())

    def fleet(self, ring: FrontRing, at_s: float) -> ActiveFleet:
        """Return the vehicles now flying along the front.

        A vehicle whose reports have stopped is dead-reckoned for ``LOST_AFTER_S``, then omitted.
        """
        reports = [
            ReportedPosition(
                member.number,
                member.bearing,
                member.clockwise,
                member.performance.speed_m_s,
                member.reported_at_s if at_s - member.reported_at_s > FRESH_S else at_s,
            )
            for member in self._members.values()
            if member.flies
        ]
        return dead_reckoned_fleet(reports, ring, at_s, LOST_AFTER_S)


class TeamMember:
    """The ``Planner`` of one vehicle in a team."""

    def __init__(self, team: Team, number: int, performance: MemberPerformance) -> None:
        self.number = number
        self.performance = performance
        self.flies = False  # whether the vehicle is in the air and has had the front in view
        self.reported_at_s = -np.inf
        self.bearing = 0  # the last cell of the ring that the vehicle reached
        # In the first lap successive members fly in opposite directions: half a lap is sufficient.
        self.clockwise = team.settings.clockwise_first == (number % 2 == 0)
        self.reversals = 0
        self._team = team
        self._found = False
        self._in_view = np.zeros(BEARINGS, dtype=bool)
        self._lap = LapProgress()
        self._turned_at_s = -np.inf

    @property
    def team(self) -> Team:
        """The team of this member."""
        return self._team

    @property
    def map(self) -> FireMap:
        """The on-board map, shared by all members."""
        return self._team.map

    @property
    def phase(self) -> Phase:
        """The phase: approach until the front is in view, then the first lap, then monitoring."""
        if not self._found:
            return "approach"
        return "monitor" if self._team.surveyed else "initial circle"

    def observe(self, observed: Observed) -> None:
        """Update the team's map from a camera window."""
        self._in_view = self._team.add_view(observed)
        self._found |= bool(self._in_view.any())

    def correct(self, observed: Observed) -> None:
        """Apply a window corrected by an operator to the team's map."""
        self._team.map.correct_window(*view_of(observed))

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """Do nothing: team rules do not use the wind."""

    def left(self, at_s: float) -> None:
        """Leave the fleet until the vehicle is flying and has the front in view again."""
        self.flies = False
        self._in_view = np.zeros(BEARINGS, dtype=bool)
        self._lap.bearing_deg = None

    def at(self, row: float, col: float, at_s: float) -> Decision | None:
        """Set the vehicle's position; return a decision in each new cell of the ring.

        The rule decides at every cell passed, but not during a turn back. After a turn the rule
        next decides at the first cell beyond the cell of the turn.
        """
        team = self._team
        self.reported_at_s = at_s
        self.flies |= bool(self._in_view.any())
        if not self.flies:
            return None
        before, bearing = self._lap.bearing_deg, bearing_deg(team.map, row, col)
        round_again = self._lap.update(bearing, self.clockwise, counts=not team.surveyed)
        if before is not None and not team.surveyed and (team.map.complete or round_again):
            team.end_survey()
            bearing = bearing_deg(team.map, row, col)
        place = round(bearing) % BEARINGS
        if before is None or not team.surveyed:
            self.bearing = place
            return None
        if at_s - self._turned_at_s < self.performance.turn_s:
            return None
        step = 1 if self.clockwise else -1
        passed = step * (place - self.bearing) % BEARINGS
        if passed == 0 or passed >= BEARINGS - CARRIED_BACK:
            return None
        if passed >= BEARINGS // 2:  # the vehicle has left the front in the meantime
            self.bearing, passed = (place - step) % BEARINGS, 1
        return self._decide(passed, step, at_s)

    def _decide(self, passed: int, step: int, at_s: float) -> Decision:
        """Apply the rule at each cell passed, until a turn back; return the decision."""
        ring = self._team.ring()
        turn = False
        for _ in range(passed):
            self.bearing = (self.bearing + step) % BEARINGS
            fleet = self._team.fleet(ring, at_s)
            which = fleet.member.tolist().index(self.number)
            turn = bool(self._team.rule.decide(ring, fleet, which, at_s)) != self.clockwise
            if turn:
                self.clockwise = not self.clockwise
                self.reversals += 1
                self._turned_at_s = at_s
                break
        return Decision(self.clockwise, turn, 0.0, 0.0, BEARINGS)

    def shape(self, row: float, col: float) -> Floats:
        """Return the reconstructed front: distances in cells on 360 bearings."""
        return reconstructed_front(self._team.map, self._in_view, row, col, self.clockwise)

    def path(self, row: float, col: float) -> Floats:
        """Return the path to fly along the front ahead: an array (n, 2) with row and column.

        During the first lap the unseen part of the front is extrapolated.
        """
        fire_map = self._team.map
        if self._team.surveyed:
            front = self.shape(row, col)
        else:
            front = extrapolated_front(fire_map, self._in_view, row, col, self.clockwise)
            front = np.where(np.isnan(fire_map.outer), front, fire_map.outer)
        settings = self._team.settings.path
        return path_along(front, fire_map, row, col, self.clockwise, settings)
