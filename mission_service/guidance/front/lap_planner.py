"""The base class of planners for one vehicle: the map, the first lap, and the turns."""

from abc import ABC, abstractmethod

import numpy as np

from mission_service.guidance.fire_map import BEARINGS, FireMap
from mission_service.guidance.front.first_lap import (
    CameraView,
    LapProgress,
    append_view,
    recentred_map,
)
from mission_service.guidance.front.front_path import bearing_deg
from mission_service.guidance.protocol import Decision, Phase


class LapPlanner(ABC):
    """A planner that makes a decision in each new cell, after a first lap around the fire."""

    def __init__(self, fire_map: FireMap, clockwise: bool, ignition_known: bool) -> None:
        """Begin the approach; the map is recentred after the lap if the ignition is unknown."""
        self.phase: Phase = "approach"
        self.clockwise = clockwise
        self.reversals = 0
        self.map = fire_map
        self._ignition_known = ignition_known
        self._observations: list[CameraView] = []
        self._in_view = np.zeros(BEARINGS, dtype=bool)
        self._cell: tuple[int, int] | None = None
        self._lap = LapProgress()
        self._turned_at_s = -np.inf

    def left(self, at_s: float) -> None:
        """Do nothing: the planner has only one vehicle."""
        return

    def at(self, row: float, col: float, at_s: float) -> Decision | None:
        """Set the vehicle's position; return a decision in each new cell of the grid."""
        bearing, circling = bearing_deg(self.map, row, col), self.phase == "initial circle"
        if self._lap.update(bearing, self.clockwise, counts=circling):
            self._finish_initial_circle()
        cell = (round(row), round(col))
        new = cell != self._cell
        self._cell = cell
        if self.phase != "monitor" or not new:
            return None
        return self._decide(row, col, at_s)

    @abstractmethod
    def _decide(self, row: float, col: float, at_s: float) -> Decision:
        """Return the decision in a new cell; on a turn back, also reverse the flight direction."""

    def _survey(self, view: CameraView) -> None:
        """Update the map from a camera window; the first view of the fire begins the lap."""
        self._in_view = self.map.add_window(*view)
        if self.phase == "approach" and self._in_view.any():
            self.phase = "initial circle"
        if self.phase == "initial circle" and not self._ignition_known:
            append_view(self._observations, view)

    def _finish_initial_circle(self) -> None:
        """End the first lap (Islam & Hu, listing 2); recentre the map for an unknown ignition."""
        self.phase = "monitor"
        if not self._ignition_known:
            self._recentre()
            self._observations.clear()

    def _recentre(self) -> None:
        """Rebuild the map around the fire's centre from all views of the lap."""
        self.map, self._in_view = recentred_map(self.map, self._observations)

    def _turn_back(self, at_s: float) -> None:
        self.clockwise = not self.clockwise
        self.reversals += 1
        self._turned_at_s = at_s
