"""The planner of Islam & Hu: the vehicle turns back if the front behind it is more important.

As in listing 1, the vehicle first flies one lap to fill the on-board map. Then, at every new cell,
the planner reconstructs the fire's shape, compares the importance of the two halves of the
perimeter (the back window and the front window), and turns the vehicle back or keeps the direction.

The planner has three rules. ``islam_hu`` is the paper's rule. A vehicle with this rule oscillates
if the spread is very uneven, for two reasons: each turn makes the other window more important, and
spread rates are computed from two views only seconds apart. ``islam_hu_damped`` differs in three
points:

- Spread rates are computed from views at least ``baseline_s`` apart and averaged over neighbouring
  bearings, so that a difference of one cell does not become a high rate.
- The vehicle turns back only if the importance of the back window exceeds that of the front window
  by the fraction ``reversal_margin``, and by ``min_gain_cells`` of unseen spread (the resolution of
  the map) for each cell of the window.
- After a turn the vehicle keeps the direction for ``dwell_s``: the time to turn around and to bring
  other cells into view.

With ``circling`` the vehicle never turns back; this rule is the baseline of section VI.E.
"""

from dataclasses import dataclass, replace
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from mission_service.config.scenario import Scenario
from mission_service.config.sections import PlannerSection, VehicleSection
from mission_service.events import Observed, SettingsChanged
from mission_service.guidance.fire_map import BEARINGS, FireMap
from mission_service.guidance.front.cell_importance import ring_importance, window_importance
from mission_service.guidance.front.first_lap import (
    view_of,
)
from mission_service.guidance.front.front_path import (
    PathSettings,
    bearing_deg,
    extrapolated_front,
    path_along,
    reconstructed_front,
)
from mission_service.guidance.front.front_shape import ring_of_cells, steps_between
from mission_service.guidance.front.lap_planner import LapPlanner
from mission_service.guidance.front.planners import path_settings
from mission_service.guidance.protocol import Compared, Decision, Ground

Floats = NDArray[np.float64]
Rule = Literal["islam_hu_damped", "islam_hu", "circling"]


@dataclass(frozen=True, slots=True)
class PerimeterSettings:
    """The settings of the rule; lengths are in cells and speeds in cells per second."""

    rule: Rule
    alpha: float
    clockwise_first: bool
    ignition_known: bool
    baseline_s: float
    smoothing_deg: int
    reversal_margin: float
    min_gain_cells: float
    dwell_s: float
    speed_cells_s: float
    path: PathSettings


class PerimeterPlanner(LapPlanner):
    """The planner of one vehicle; positions are rows and columns of the landscape's grid."""

    def __init__(
        self,
        settings: PerimeterSettings,
        shape: tuple[int, int],
        centre: tuple[float, float],
        ignited_at_s: float,
    ) -> None:
        self.settings = settings
        baseline_s = 0.0 if settings.rule == "islam_hu" else settings.baseline_s
        fire_map = FireMap(shape, *centre, ignited_at_s, baseline_s)
        super().__init__(fire_map, settings.clockwise_first, settings.ignition_known)

    def observe(self, observed: Observed) -> None:
        """Update the map from a camera window."""
        self._survey(view_of(observed))

    def correct(self, observed: Observed) -> None:
        """Apply a window of the fire corrected by an operator."""
        self.map.correct_window(*view_of(observed))

    def tune(self, event: SettingsChanged) -> None:
        """Apply changed settings to all later decisions."""
        self.settings = replace(self.settings, **event.given)

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """Do nothing: the paper's rule does not use the wind."""

    def shape(self, row: float, col: float) -> Floats:
        """Return the reconstructed front: distances in cells on 360 bearings."""
        return reconstructed_front(self.map, self._in_view, row, col, self.clockwise)

    def importance(self, row: float, col: float, at_s: float) -> Floats:
        """Return the importance (n, in cells) of each cell of the reconstructed front (listing 3).

        Index 0 is the vehicle's cell, and the index increases against the direction of flight.
        """
        settings = self.settings
        _, visited_at_s = self.map.filled_outer()
        north, east, bearing = ring_of_cells(
            self.shape(row, col), round(bearing_deg(self.map, row, col)) % BEARINGS, self.clockwise
        )
        smoothing = 0 if settings.rule == "islam_hu" else settings.smoothing_deg
        return ring_importance(
            self.map.spread_rate_cells_s(smoothing)[bearing],
            at_s - visited_at_s[bearing],
            steps_between(north, east),
            settings.speed_cells_s,
            settings.alpha,
        )

    def compared(self, row: float, col: float, at_s: float) -> Compared:
        """Return the importance and the position of each cell of the front."""
        values = self.importance(row, col, at_s)
        bearing = round(bearing_deg(self.map, row, col)) % BEARINGS
        north, east, _ = ring_of_cells(self.shape(row, col), bearing, self.clockwise)
        rows = self.map.centre_row - np.asarray(north)
        return Compared(
            rows, self.map.centre_col + np.asarray(east), values, *window_importance(values)
        )

    def _decide(self, row: float, col: float, at_s: float) -> Decision:
        importance = self.importance(row, col, at_s)
        back, front = window_importance(importance)
        turn = self._turns_back(back, front, importance.size // 2, at_s)
        if turn:
            self._turn_back(at_s)
        return Decision(self.clockwise, turn, back, front, importance.size)

    def _turns_back(self, back: float, front: float, window_cells: int, at_s: float) -> bool:
        settings = self.settings
        if settings.rule == "circling":
            return False
        if settings.rule == "islam_hu":
            return back > front
        rested = at_s - self._turned_at_s >= settings.dwell_s
        min_gain = max(front * settings.reversal_margin, window_cells * settings.min_gain_cells)
        return rested and back - front > min_gain

    def path(self, row: float, col: float) -> Floats:
        """Return the path to fly along the front ahead: an array (n, 2) with row and column.

        The path follows the visible front and, beyond the view, the reconstructed front. During the
        initial circle, a straight line extends the visible front.
        """
        front_by = reconstructed_front if self.phase == "monitor" else extrapolated_front
        front = front_by(self.map, self._in_view, row, col, self.clockwise)
        return path_along(front, self.map, row, col, self.clockwise, self.settings.path)


def perimeter_settings(
    planner: PlannerSection, speed_cells_s: float, path: PathSettings
) -> PerimeterSettings:
    """Return the planner's settings from a scenario."""
    return PerimeterSettings(
        rule=cast(Rule, planner.rule),
        alpha=planner.alpha,
        clockwise_first=planner.first_direction == "clockwise",
        ignition_known=planner.ignition_known,
        baseline_s=planner.baseline_s,
        smoothing_deg=planner.smoothing_deg,
        reversal_margin=planner.reversal_margin,
        min_gain_cells=planner.min_gain_cells,
        dwell_s=planner.dwell_s,
        speed_cells_s=speed_cells_s,
        path=path,
    )


def islam_hu_planner(
    scenario: Scenario, section: VehicleSection, ground: Ground
) -> PerimeterPlanner:
    """Return the planner of one vehicle, with the scenario's rule."""
    cell_m = ground.landscape.cell_size_m
    speed_cells_s, path = section.airspeed_m_s / cell_m, path_settings(scenario, cell_m)
    settings = perimeter_settings(scenario.planner, speed_cells_s, path)
    return PerimeterPlanner(settings, ground.landscape.shape, ground.centre, ground.burns_from_s)
