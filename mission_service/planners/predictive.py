"""Watch one fire with one vehicle by prediction."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
from mission_service.planners.protocol import Decision, Phase
from mission_service.planners.sweeps import NODES, PLANS, Ring, costs_of

Floats = NDArray[np.float64]

ROUND_AGAIN_DEG = 360.0
HORIZON_LAPS = 2.0
DWELL_LAPS = 0.03
MARGIN = 0.03
FLOOR_CELLS = 0.5
LEAST_GROWTH_CELLS_S = 1e-5


@dataclass(frozen=True, slots=True)
class PredictiveSettings:
    """Lengths in cells, speeds in cells per second."""

    clockwise_first: bool
    ignition_known: bool
    speed_cells_s: float
    turn_radius_cells: float
    flies_in_wind: bool
    wind_20ft_share: float  # wind at 20 ft over the wind measured in the air
    path: PathSettings
    routing: bool = True


class PredictivePlanner:
    def __init__(
        self,
        settings: PredictiveSettings,
        shape: tuple[int, int],
        centre: tuple[float, float],
        ignited_at_s: float,
        model: FrontModel | None,
    ) -> None:
        self.settings = settings
        self._shape = shape
        self._ignited_at_s = ignited_at_s
        self.phase: Phase = "approach"
        self.clockwise = settings.clockwise_first
        self.reversals = 0
        self.map = FireMap(shape, *centre, ignited_at_s, 300.0)
        start = np.full(BEARINGS, 0.5)
        self.belief = Belief(shape, centre, model, start, ignited_at_s)
        self._in_view = np.zeros(BEARINGS, dtype=bool)
        self._cell: tuple[int, int] | None = None
        self._bearing_deg: float | None = None
        self._swept_deg = 0.0
        self._turned_at_s = -np.inf

    def observe(self, observed: Observed) -> None:
        window = window_codes(observed.cells)
        at_s = observed.at_us / 1e6
        self._in_view = self.map.observe(observed.row, observed.col, window, at_s)
        self.belief.see(observed.row, observed.col, window, at_s)
        if self.phase == "approach" and self._in_view.any():
            self.phase = "initial circle"

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        self.belief.wind(speed_m_s * self.settings.wind_20ft_share, from_deg, at_s)

    def left(self, at_s: float) -> None:
        """There is nobody else to take over."""

    def at(self, row: float, col: float, at_s: float) -> Decision | None:
        self.belief.advance(at_s)
        bearing = bearing_deg(self.map, row, col)
        if self.phase == "initial circle" and self._bearing_deg is not None:
            self._swept_deg += turned_deg(self._bearing_deg, bearing, self.clockwise)
            if self._swept_deg >= ROUND_AGAIN_DEG:
                self.phase = "monitor"
        self._bearing_deg = bearing
        cell = (round(row), round(col))
        if cell == self._cell or self.phase != "monitor":
            self._cell = cell
            return None
        self._cell = cell
        return self._decide(bearing, at_s)

    def _decide(self, bearing: float, at_s: float) -> Decision:
        settings = self.settings
        ring, node_of = self._ring()
        node = int(node_of[round(bearing) % BEARINGS])
        lap_s = float(ring.ahead_s.sum() + ring.back_s.sum()) / 2.0
        turn_s = np.pi * settings.turn_radius_cells / settings.speed_cells_s
        horizon_s = HORIZON_LAPS * lap_s
        back, front = np.empty(len(PLANS)), np.empty(len(PLANS))
        costs_of(PLANS, ring, node, self.clockwise, 0.0, turn_s, horizon_s, front)
        costs_of(PLANS, ring, node, not self.clockwise, turn_s, turn_s, horizon_s, back)
        stay, turn = float(front.min()), float(back.min())
        rested = at_s - self._turned_at_s >= max(DWELL_LAPS * lap_s, 2.0 * turn_s)
        turns = settings.routing and rested and turn < stay * (1.0 - MARGIN)
        if turns:
            self.clockwise = not self.clockwise
            self.reversals += 1
            self._turned_at_s = at_s
        return Decision(self.clockwise, turns, stay, turn, len(ring.error))

    def _ring(self) -> tuple[Ring, NDArray[np.int64]]:
        belief, settings = self.belief, self.settings
        front = belief.front
        north, east = front * NORTH, front * EAST
        to_north, to_east = np.roll(north, -1) - north, np.roll(east, -1) - east
        step = np.hypot(to_north, to_east)
        along = np.concatenate([[0.0], np.cumsum(step)])
        node_of = np.minimum((along[:-1] / along[-1] * NODES).astype(np.int64), NODES - 1)
        doubt = belief.doubt()
        left = FLOOR_CELLS * belief.slant()
        error = left + doubt * belief.unseen_advance()
        growth = doubt * belief.speed_cells_s + LEAST_GROWTH_CELLS_S
        most = [np.full(NODES, 1e-6) for _ in range(3)]
        for array, values in zip(most, (error, growth, left), strict=True):
            np.maximum.at(array, node_of, values)
        length = along[-1] / NODES
        time_s = np.full(NODES, length / settings.speed_cells_s)
        return Ring(time_s, time_s, *most), node_of

    def shape(self, row: float, col: float) -> Floats:
        return self.belief.front.copy()

    def path(self, row: float, col: float) -> Floats:
        if self.phase == "monitor":
            return self._path_on(self.belief.front, row, col)
        front = continued(self.map, self._in_view, row, col, self.clockwise)
        return path_along(front, self.map, row, col, self.clockwise, self.settings.path)

    def _path_on(self, front: Floats, row: float, col: float) -> Floats:
        belief, settings = self.belief, self.settings.path
        step = 1 if self.clockwise else -1
        start = round(bearing_deg(self.map, row, col))
        order = (start + step * np.arange(BEARINGS * 5 // 6)) % BEARINGS
        front = np.maximum(front, belief.burned + 0.5)
        north, east = front[order] * NORTH[order], front[order] * EAST[order]
        far = np.hypot(north - (belief.centre_row - row), east - (col - belief.centre_col))
        first = int(np.argmax(far >= settings.lead_cells)) if (far >= settings.lead_cells).any() else 0
        north, east = north[first:], east[first:]
        along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(north), np.diff(east)))])
        keep = along <= settings.horizon_cells
        return np.column_stack([belief.centre_row - north[keep], belief.centre_col + east[keep]])
