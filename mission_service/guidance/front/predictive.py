"""One vehicle on one fire, by prediction: believe where the front is, fly where that is least sure.

The front is believed to be where it was last seen plus what it has advanced since (``belief``).
How much a part of it may be wrong grows with its speed times the doubt about that speed, which the
belief learns from how far its predictions were off. At every new cell of the grid plans of sweeps
and circles are flown ahead on that front (``sweeps``), those that go on and those that turn back
now; the vehicle turns if the best of the latter leaves the smaller error.

The vehicle needs room to turn and flies in the wind it measures. A landscape and wind make the
prediction better but are not needed.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.front_rates import FrontRates
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.events import Observed
from mission_service.fire.setup import weather_of
from mission_service.guidance.fire_map import BEARINGS, FireMap, window_codes
from mission_service.guidance.front.belief import Belief, FrontModel
from mission_service.guidance.front.first_lap import Lap, Seen, recentred, remember
from mission_service.guidance.front.following import (
    PathSettings,
    bearing_deg,
    continued,
    path_along,
)
from mission_service.guidance.front.hedge import hedged
from mission_service.guidance.front.planners import path_settings
from mission_service.guidance.front.sweeps import NODES, PLANS, Ring, costs_of, ring_on
from mission_service.guidance.protocol import Decision, Ground, Phase

Floats = NDArray[np.float64]

HORIZON_LAPS = 2.0
REST_LAPS = 0.03  # after a turn, until the next one may be
LEAST_GAIN = 0.25  # share of the cost for which to turn
TURN_BACK = 7.0 / 3.0 * math.pi  # radii: the shortest way to fly the other way at the same place
LEFT_CELLS = 0.5  # error across a front in view
RECENTRED_BASELINE_S = 300.0


@dataclass(frozen=True, slots=True)
class PredictiveSettings:
    """Lengths in cells, speeds in cells per second.

    ``wind_20ft_share`` is the wind 20 ft above the vegetation over the one measured in the air.
    ``flies_in_wind``: the wind carries the vehicle; otherwise it flies as if there were none.
    """

    clockwise_first: bool
    ignition_known: bool
    speed_cells_s: float
    turn_radius_cells: float
    flies_in_wind: bool
    wind_20ft_share: float
    path: PathSettings


def model_of(landscape: Landscape, known: Weather) -> FrontModel:
    """The fire model on board: the landscape and the moistures of one time, no wind."""
    calm = replace(known, at_s=0.0, wind_speed_m_s=0.0, wind_from_deg=0.0)
    return FrontModel(FrontRates(landscape, WeatherStream([calm])), landscape)


class PredictivePlanner:
    """A ``Planner``; positions are float (row, col) of the landscape's grid."""

    def __init__(
        self,
        settings: PredictiveSettings,
        shape: tuple[int, int],
        centre: tuple[float, float],
        ignited_at_s: float,
        cell_m: float,
        model: FrontModel | None,
    ) -> None:
        self.settings = settings
        self._cell_m = cell_m
        self.phase: Phase = "approach"
        self.clockwise = settings.clockwise_first
        self.reversals = 0
        self.map = FireMap(shape, *centre, ignited_at_s, RECENTRED_BASELINE_S)
        self.belief = Belief(shape, centre, model, np.full(BEARINGS, 0.5), ignited_at_s)
        self._observations: list[Seen] = []
        self._in_view = np.zeros(BEARINGS, dtype=bool)
        self._cell: tuple[int, int] | None = None
        self._lap = Lap()
        self._turned_at_s = -np.inf
        self._ring = Ring(*(np.zeros(NODES) for _ in range(5)))
        self._node_of = np.zeros(BEARINGS, dtype=np.int64)
        self._costs = np.zeros(len(PLANS))

    def observe(self, observed: Observed) -> None:
        """Take in what the camera saw."""
        seen = (observed.row, observed.col, window_codes(observed.cells), observed.at_us / 1e6)
        if self.phase != "monitor":
            self._in_view = self.map.observe(*seen)
            if self.phase == "approach" and self._in_view.any():
                self.phase = "initial circle"
            if not self.settings.ignition_known:
                if self.phase == "initial circle":
                    remember(self._observations, seen)
                return
        self.belief.see(*seen)

    def correct(self, told: Observed) -> None:
        """Take in what people say of a window of the fire."""
        window = (told.row, told.col, window_codes(told.cells), told.at_us / 1e6)
        self.map.correct(*window)
        self.belief.correct(*window)

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """Take in a wind measured in the air; from true north."""
        self.belief.wind(speed_m_s * self.settings.wind_20ft_share, from_deg, at_s)

    def left(self, at_s: float) -> None:
        """There is nobody else to take over."""

    def at(self, row: float, col: float, at_s: float) -> Decision | None:
        """The vehicle is here now; a decision whenever it has reached a new cell of the grid."""
        bearing = bearing_deg(self.map, row, col)
        circling = self.phase == "initial circle"
        if self._lap.reach(bearing, self.clockwise, counts=circling):
            self._finish_initial_circle()
            bearing = bearing_deg(self.map, row, col)
        cell = (round(row), round(col))
        new = cell != self._cell
        self._cell = cell
        if self.phase != "monitor":
            return None
        self.belief.advance(at_s)
        return self._decide(round(bearing) % BEARINGS, at_s) if new else None

    def _finish_initial_circle(self) -> None:
        """An unknown ignition is replaced by the fire's centre, and all is seen anew."""
        self.phase = "monitor"
        if not self.settings.ignition_known:
            self.map, self._in_view = recentred(self.map, self._observations)
            centre = (self.map.centre_row, self.map.centre_col)
            outer, _ = self.map.filled_outer()
            self.belief = self.belief.begun_anew(centre, outer, self._observations[0][3])
            for seen in self._observations:
                self.belief.see(*seen)
            self._observations.clear()

    def _decide(self, bearing: int, at_s: float) -> Decision:
        settings = self.settings
        length = self._look_round()
        node, ring = int(self._node_of[bearing]), self._ring
        lap_s = float(ring.ahead_s.sum() + ring.back_s.sum()) / 2.0
        turn_s = TURN_BACK * settings.turn_radius_cells / settings.speed_cells_s
        costs = []
        for clockwise, delay_s in ((self.clockwise, 0.0), (not self.clockwise, turn_s)):
            ahead_s = HORIZON_LAPS * lap_s
            costs_of(PLANS, ring, node, clockwise, delay_s, turn_s, ahead_s, self._costs)
            costs.append(float(self._costs.min()) / ahead_s)
        on, back = costs
        rested = at_s - self._turned_at_s >= max(REST_LAPS * lap_s, 2.0 * turn_s)
        turns = rested and back < on * (1.0 - LEAST_GAIN)
        if turns:
            self.clockwise = not self.clockwise
            self.reversals += 1
            self._turned_at_s = at_s
        # What speaks for turning back is what going on would cost.
        return Decision(self.clockwise, turns, on, back, round(length))

    def _look_round(self) -> float:
        """Fill in the ring from the belief; returns its length."""
        belief, settings = self.belief, self.settings
        doubt = belief.doubt()
        left = LEFT_CELLS * belief.slant()
        wind = np.zeros(2)
        if settings.flies_in_wind and belief.wind_m_s is not None:
            wind = belief.wind_m_s / settings.wind_20ft_share / self._cell_m
        length: float = ring_on(
            belief.front,
            left + doubt * belief.unseen_advance(),
            doubt * belief.speed_cells_s,
            left,
            settings.speed_cells_s,
            wind,
            self._node_of,
            self._ring,
        )
        return length

    def shape(self, row: float, col: float) -> Floats:
        """The believed front: its distance in cells on 360 bearings (see ``hedge``)."""
        return hedged(self.belief.front)

    def path(self, row: float, col: float) -> Floats:
        """Where to fly: (n, 2) float (row, col) along the front ahead, in the flying direction.

        The believed front; during the initial circle the line on which the visible one ends.
        """
        settings = self.settings.path
        if self.phase == "monitor":  # not smoothed: the tip of a narrow fire must be seen
            front = self.belief.front
            return path_along(front, self.belief, row, col, self.clockwise, settings, 0)
        front = continued(self.map, self._in_view, row, col, self.clockwise)
        return path_along(front, self.map, row, col, self.clockwise, settings)


def predictive_planner(
    scenario: Scenario, section: VehicleSection, ground: Ground
) -> PredictivePlanner:
    """The planner of one vehicle; it has the landscape and the moistures at the beginning."""
    told, cell_m = scenario.planner, ground.landscape.cell_size_m
    settings = PredictiveSettings(
        clockwise_first=told.first_direction == "clockwise",
        ignition_known=told.ignition_known,
        speed_cells_s=section.airspeed_m_s / cell_m,
        turn_radius_cells=section.turn_radius_m / cell_m,
        flies_in_wind=True,
        wind_20ft_share=1.0,  # a wrong share is learned as part of the fire's spread
        path=path_settings(scenario, cell_m),
    )
    return PredictivePlanner(
        settings,
        ground.landscape.shape,
        ground.centre,
        ground.burns_from_s,
        cell_m,
        model_of(ground.landscape, weather_of(scenario).at(ground.burns_from_s)),
    )
