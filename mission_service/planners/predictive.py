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

Floats = NDArray[np.float64]

ROUND_AGAIN_DEG = 360.0


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
        return None

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
