"""A team in flight: one on-board map for all its vehicles, and a rule that directs each of them.

What one camera sees, all know. The front is a ring of the map's 360 bearings; whenever a vehicle
comes to a new one, the rule is asked which way it flies on. The vehicles share the first lap: half
of them fly the other way round, and it is over when the map is complete.

A vehicle that has left (lost, recalled, on the ground) is not in the fleet that the rule sees, so
the others close the gap at their next decision. It is back once it flies and has the front in view.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission_service.events import Observed
from mission_service.guidance.fire_map import BEARINGS, EAST, NORTH, FireMap, window_codes
from mission_service.guidance.front.dead_reckoning import Heard, fleet_of
from mission_service.guidance.front.first_lap import Lap, Seen, recentred, remember
from mission_service.guidance.front.following import (
    PathSettings,
    bearing_deg,
    continued,
    path_along,
    reconstructed,
)
from mission_service.guidance.protocol import Decision, Phase
from mission_service.guidance.team.ring import Fleet, Ring, TeamRule

Floats = NDArray[np.float64]

FRESH_S = 2.0  # positions come several times a second
LOST_AFTER_S = 30.0
CARRIED_BACK = 30  # cells at most, while it turns back


@dataclass(frozen=True, slots=True)
class TeamSettings:
    """What a team is told besides its rule."""

    cell_m: float
    clockwise_first: bool
    ignition_known: bool
    baseline_s: float
    smoothing_deg: int
    path: PathSettings


@dataclass(frozen=True, slots=True)
class Flyer:
    """What a team has to know of one of its vehicles."""

    speed_m_s: float
    turn_s: float  # to turn back; meanwhile it is not asked to turn again


class Team:
    """The map, the rule and the seats. Positions are float (row, col) of the landscape's grid."""

    def __init__(
        self,
        rule: TeamRule,
        settings: TeamSettings,
        flyers: Mapping[str, Flyer],
        shape: tuple[int, int],
        centre: tuple[float, float],
        ignited_at_s: float,
    ) -> None:
        self.rule = rule
        self.settings = settings
        self.surveyed = False  # the first lap is over
        self.map = FireMap(shape, *centre, ignited_at_s, settings.baseline_s)
        self._observations: list[Seen] = []
        self._seats = {
            name: Seat(self, number, flyer) for number, (name, flyer) in enumerate(flyers.items())
        }

    def seat(self, name: str) -> "Seat":
        """The planner of one vehicle."""
        return self._seats[name]

    def see(self, observed: Observed) -> NDArray[np.bool_]:
        """Take in what a camera saw; returns the bearings (360) in its view."""
        window = window_codes(observed.cells)
        seen = (observed.row, observed.col, window, observed.at_us / 1e6)
        if not self.surveyed and not self.settings.ignition_known:
            remember(self._observations, seen)
        return self.map.observe(*seen)

    def end_survey(self) -> None:
        """The first lap is done; an unknown ignition is replaced by the fire's centre."""
        self.surveyed = True
        if not self.settings.ignition_known:
            self.map, _ = recentred(self.map, self._observations)
            self._observations.clear()

    def ring(self) -> Ring:
        """The front as the map has it, a cell for each bearing."""
        cell_m = self.settings.cell_m
        outer, visited_at_s = self.map.filled_outer()
        north, east = outer * NORTH, outer * EAST
        return Ring(
            cell_m * np.hypot(np.roll(north, -1) - north, np.roll(east, -1) - east),
            cell_m * self.map.spread_rate_cells_s(self.settings.smoothing_deg),
            visited_at_s,
        )

    @property
    def flying(self) -> int:
        """How many fly the front, as far as is known."""
        return sum(seat.flies for seat in self._seats.values())

    def fleet(self, ring: Ring, at_s: float) -> Fleet:
        """The vehicles that fly the front now.

        One that has been silent is reckoned to have flown on, and after a while not to fly.
        """
        heard = [
            Heard(
                seat.number,
                seat.bearing,
                seat.clockwise,
                seat.flyer.speed_m_s,
                seat.heard_at_s if at_s - seat.heard_at_s > FRESH_S else at_s,
            )
            for seat in self._seats.values()
            if seat.flies
        ]
        return fleet_of(heard, ring, at_s, LOST_AFTER_S)


class Seat:
    """One vehicle's place in a team: a ``Planner``."""

    def __init__(self, team: Team, number: int, flyer: Flyer) -> None:
        self.number = number
        self.flyer = flyer
        self.flies = False  # in the air, heard, and the front was in view
        self.heard_at_s = -np.inf
        self.bearing = 0  # the cell of the ring to which it has come
        # On the first lap neighbours by number fly opposite ways: half a lap shows all.
        self.clockwise = team.settings.clockwise_first == (number % 2 == 0)
        self.reversals = 0
        self._team = team
        self._found = False
        self._in_view = np.zeros(BEARINGS, dtype=bool)
        self._lap = Lap()
        self._turned_at_s = -np.inf

    @property
    def team(self) -> Team:
        """The team it sits in."""
        return self._team

    @property
    def map(self) -> FireMap:
        """The on-board map, of all."""
        return self._team.map

    @property
    def phase(self) -> Phase:
        """On its way until it has seen the front; then the team's first lap, then monitoring."""
        if not self._found:
            return "approach"
        return "monitor" if self._team.surveyed else "initial circle"

    def observe(self, observed: Observed) -> None:
        """Take in what the camera saw, for all."""
        self._in_view = self._team.see(observed)
        self._found |= bool(self._in_view.any())

    def correct(self, told: Observed) -> None:
        """Take in what people say of a window of the fire, for all."""
        window = window_codes(told.cells)
        self._team.map.correct(told.row, told.col, window, told.at_us / 1e6)

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """The rules of teams do not ask for the wind."""

    def left(self, at_s: float) -> None:
        """Out of the fleet until it flies and sees the front again."""
        self.flies = False
        self._in_view = np.zeros(BEARINGS, dtype=bool)
        self._lap.bearing_deg = None

    def at(self, row: float, col: float, at_s: float) -> Decision | None:
        """The vehicle is here now; a decision whenever it has come to a new cell of the ring.

        The rule is asked at every cell that was passed, but not while the vehicle turns back: then
        it comes to a new cell when it has passed the one where it turned.
        """
        team = self._team
        self.heard_at_s = at_s
        self.flies |= bool(self._in_view.any())
        if not self.flies:
            return None
        before, bearing = self._lap.bearing_deg, bearing_deg(team.map, row, col)
        round_again = self._lap.reach(bearing, self.clockwise, counts=not team.surveyed)
        if before is not None and not team.surveyed and (team.map.complete or round_again):
            team.end_survey()
            bearing = bearing_deg(team.map, row, col)
        place = round(bearing) % BEARINGS
        if before is None or not team.surveyed:
            self.bearing = place
            return None
        if at_s - self._turned_at_s < self.flyer.turn_s:
            return None
        step = 1 if self.clockwise else -1
        passed = step * (place - self.bearing) % BEARINGS
        if passed == 0 or passed >= BEARINGS - CARRIED_BACK:
            return None
        if passed >= BEARINGS // 2:  # it has been elsewhere
            self.bearing, passed = (place - step) % BEARINGS, 1
        return self._decide(passed, step, at_s)

    def _decide(self, passed: int, step: int, at_s: float) -> Decision:
        """Ask at each cell, until the rule turns it back."""
        ring = self._team.ring()
        turn = False
        for _ in range(passed):
            self.bearing = (self.bearing + step) % BEARINGS
            fleet = self._team.fleet(ring, at_s)
            which = fleet.seat.tolist().index(self.number)
            turn = bool(self._team.rule.decide(ring, fleet, which, at_s)) != self.clockwise
            if turn:
                self.clockwise = not self.clockwise
                self.reversals += 1
                self._turned_at_s = at_s
                break
        return Decision(self.clockwise, turn, 0.0, 0.0, BEARINGS)

    def shape(self, row: float, col: float) -> Floats:
        """The reconstructed fire: distance of the front in cells for each of 360 bearings."""
        return reconstructed(self._team.map, self._in_view, row, col, self.clockwise)

    def path(self, row: float, col: float) -> Floats:
        """Where to fly: (n, 2) float (row, col) along the front ahead, in flying direction.

        During the first lap what no vehicle has seen is the line on which the visible front ends.
        """
        fire_map = self._team.map
        if self._team.surveyed:
            front = self.shape(row, col)
        else:
            front = continued(fire_map, self._in_view, row, col, self.clockwise)
            front = np.where(np.isnan(fire_map.outer), front, fire_map.outer)
        settings = self._team.settings.path
        return path_along(front, fire_map, row, col, self.clockwise, settings)
