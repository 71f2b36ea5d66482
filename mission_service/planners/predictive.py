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
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firemodel.front_rates import FrontRates
from firemodel.landscape import Landscape
from firemodel.weather import Weather, WeatherStream
from mission_service.events import Observed
from mission_service.fire_map import BEARINGS, EAST, NORTH, FireMap, window_codes
from mission_service.planners.belief import Belief, FrontModel
from mission_service.planners.following import (
    PathSettings,
    bearing_deg,
    centre_of_area,
    continued,
    path_along,
    turned_deg,
)
from mission_service.planners.hedge import hedged
from mission_service.planners.protocol import Decision, Phase
from mission_service.planners.sweeps import NODES, PLANS, Ring, costs_of, ring_on

Floats = NDArray[np.float64]

ROUND_AGAIN_DEG = 360.0
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
    return FrontModel(FrontRates(landscape, WeatherStream([_from_the_start(known)])), landscape)


def _from_the_start(known: Weather) -> Weather:
    return Weather(
        0.0,
        0.0,
        0.0,
        known.dead_1h_pct,
        known.dead_10h_pct,
        known.dead_100h_pct,
        known.live_herb_pct,
        known.live_woody_pct,
    )


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
        self._shape = shape
        self._ignited_at_s = ignited_at_s
        self._cell_m = cell_m
        self.phase: Phase = "approach"
        self.clockwise = settings.clockwise_first
        self.reversals = 0
        self.map = FireMap(shape, *centre, ignited_at_s, RECENTRED_BASELINE_S)
        self.belief = Belief(shape, centre, model, np.full(BEARINGS, 0.5), ignited_at_s)
        self._observations: list[tuple[int, int, NDArray[np.uint8], float]] = []
        self._in_view = np.zeros(BEARINGS, dtype=bool)
        self._cell: tuple[int, int] | None = None
        self._bearing_deg: float | None = None
        self._swept_deg = 0.0
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
                    self._observations.append(seen)
                return
        self.belief.see(*seen)

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """Take in a wind measured in the air; from true north."""
        self.belief.wind(speed_m_s * self.settings.wind_20ft_share, from_deg, at_s)

    def left(self, at_s: float) -> None:
        """There is nobody else to take over."""

    def at(self, row: float, col: float, at_s: float) -> Decision | None:
        """The vehicle is here now; a decision whenever it has reached a new cell of the grid."""
        bearing = bearing_deg(self.map, row, col)
        if self.phase == "initial circle" and self._bearing_deg is not None:
            self._swept_deg += turned_deg(self._bearing_deg, bearing, self.clockwise)
            if self._swept_deg >= ROUND_AGAIN_DEG:
                bearing = self._finish_initial_circle(row, col)
        self._bearing_deg = bearing
        cell = (round(row), round(col))
        new = cell != self._cell
        self._cell = cell
        if self.phase != "monitor":
            return None
        self.belief.advance(at_s)
        return self._decide(round(bearing) % BEARINGS, at_s) if new else None

    def _finish_initial_circle(self, row: float, col: float) -> float:
        """Where the ignition is unknown, the fire's centre takes its place, and all is seen anew.

        Returns the vehicle's bearing.
        """
        self.phase = "monitor"
        if not self.settings.ignition_known:
            outer, _ = self.map.filled_outer()
            centre = centre_of_area(outer, self.map.centre_row, self.map.centre_col)
            self.map = FireMap(self._shape, *centre, self._ignited_at_s, RECENTRED_BASELINE_S)
            for seen in self._observations:
                self._in_view = self.map.observe(*seen)
            outer, _ = self.map.filled_outer()
            self.belief = self.belief.begun_anew(centre, outer, self._observations[0][3])
            for seen in self._observations:
                self.belief.see(*seen)
            self._observations.clear()
        return bearing_deg(self.map, row, col)

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
        if self.phase == "monitor":
            return self._path_on_belief(row, col)
        front = continued(self.map, self._in_view, row, col, self.clockwise)
        return path_along(front, self.map, row, col, self.clockwise, self.settings.path)

    def _path_on_belief(self, row: float, col: float) -> Floats:
        """Not smoothed, as ``following.path_along`` is: the tip of a narrow fire must be seen."""
        belief, settings = self.belief, self.settings.path
        start = round(bearing_deg(self.map, row, col))
        order = (start + (1 if self.clockwise else -1) * np.arange(BEARINGS * 5 // 6)) % BEARINGS
        front = np.maximum(belief.front[order], belief.burned[order] + 0.5)
        rows = belief.centre_row - front * NORTH[order]
        cols = belief.centre_col + front * EAST[order]
        far = np.hypot(rows - row, cols - col) >= settings.lead_cells
        first = int(np.argmax(far))
        rows, cols = rows[first:], cols[first:]
        along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(rows), np.diff(cols)))])
        keep = along <= settings.horizon_cells
        return np.column_stack([rows[keep], cols[keep]])
