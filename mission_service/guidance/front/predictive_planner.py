"""The predictive planner, which guides one vehicle to the least certain parts of the front.

``front_estimate`` predicts the advance of each part of the front since that part was last seen, and
``front_mixture`` reduces the effect of a wrong fire model. The expected error of a part grows at
the part's speed times the standard deviation of its factor (the measured rate of spread divided by
the modelled rate). At every new cell of the grid, ``sweeps`` rolls out (simulates) plans of sweeps
and laps on the estimated front. Some plans keep the direction, and some turn back now. The cost of
a plan is a measure of the error. The vehicle turns back if the best plan that turns back costs
clearly less than the best plan that keeps the direction.

The roll-outs include the time of turns and the effect of the measured wind on the vehicle. A
landscape and a wind improve the prediction but are not required.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape, turned
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.front_rates import FrontRates
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.events import Observed
from mission_service.fire.scenario_fire import weather_of
from mission_service.guidance.fire_map import BEARINGS, FireMap
from mission_service.guidance.front.cell_importance import window_importance
from mission_service.guidance.front.first_lap import (
    view_of,
)
from mission_service.guidance.front.front_estimate import FrontEstimate, FrontModel
from mission_service.guidance.front.front_mixture import FrontMixture
from mission_service.guidance.front.front_path import (
    PathSettings,
    bearing_deg,
    extrapolated_front,
    path_along,
)
from mission_service.guidance.front.lap_planner import LapPlanner
from mission_service.guidance.front.planners import path_settings
from mission_service.guidance.front.robust_front import robust_front
from mission_service.guidance.front.sweeps import NODES, PLANS, CoarseRing, costs_of, fill_ring
from mission_service.guidance.protocol import Compared, Decision, Ground

Floats = NDArray[np.float64]

HORIZON_LAPS = 2.0
REST_LAPS = 0.03  # minimum interval between turns, in laps
# Fraction of the cost that a turn must save. With 0.25, turns increased the error on random fires.
MIN_GAIN = 0.5
TURN_BACK = 7.0 / 3.0 * math.pi  # length of the shortest path to the opposite course, in turn radii
LEFT_CELLS = 0.5  # error of a front in view, normal to the front
RECENTRED_BASELINE_S = 300.0


@dataclass(frozen=True, slots=True)
class PredictiveSettings:
    """The settings of the planner; lengths are in cells and speeds in cells per second.

    ``wind_20ft_share`` is the wind speed 20 ft above the vegetation divided by the wind speed that
    the vehicle measures. ``flies_in_wind`` is True if the wind carries the vehicle.
    """

    clockwise_first: bool
    ignition_known: bool
    speed_cells_s: float
    turn_radius_cells: float
    flies_in_wind: bool
    wind_20ft_share: float
    path: PathSettings


def model_of(landscape: Landscape, weather: Weather) -> FrontModel:
    """Return the on-board fire model, with a landscape and fuel moistures but without wind."""
    calm = replace(weather, at_s=0.0, wind_speed_m_s=0.0, wind_from_deg=0.0, wind_field=None)
    weather_stream = WeatherStream([calm])
    return FrontModel(FrontRates(landscape, weather_stream), landscape, weather_stream)


class PredictivePlanner(LapPlanner):
    """A predictive ``Planner``; positions are rows and columns of the landscape's grid."""

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
        fire_map = FireMap(shape, *centre, ignited_at_s, RECENTRED_BASELINE_S)
        super().__init__(fire_map, settings.clockwise_first, settings.ignition_known)
        self._cell_m = cell_m
        self._convergence_deg = 0.0 if model is None else model.landscape.grid_convergence_deg
        self.fronts = FrontMixture(shape, centre, model, np.full(BEARINGS, 0.5), ignited_at_s)
        self._ring = CoarseRing(*(np.zeros(NODES) for _ in range(5)))
        self._node_of = np.zeros(BEARINGS, dtype=np.int64)
        self._costs = np.zeros(len(PLANS))

    @property
    def estimate(self) -> FrontEstimate:
        """The model's estimate, with its factors and wind."""
        return self.fronts.modelled

    def observe(self, observed: Observed) -> None:
        """Update the map and the estimate from a camera window."""
        seen = view_of(observed)
        if self.phase != "monitor":
            self._survey(seen)
            if not self.settings.ignition_known:
                return
        else:
            self.map.add_window(*seen)  # for the alarm about an unmonitored front
        self.fronts.add_window(*seen)

    def correct(self, observed: Observed) -> None:
        """Apply a window of the fire corrected by an operator."""
        seen = view_of(observed)
        self.map.correct_window(*seen)
        self.fronts.correct_window(*seen)

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """Add a wind measurement; the wind blows from ``from_deg``, clockwise from true north."""
        self.fronts.add_wind(speed_m_s * self.settings.wind_20ft_share, from_deg, at_s)

    def _recentre(self) -> None:
        """Rebuild the map and the estimate around the fire's centre from all views of the lap."""
        super()._recentre()
        centre = (self.map.centre_row, self.map.centre_col)
        outer, _ = self.map.filled_outer()
        self.fronts = self.fronts.reset_around(centre, outer, self._observations[0][3])
        for seen in self._observations:
            self.fronts.add_window(*seen)

    def _decide(self, row: float, col: float, at_s: float) -> Decision:
        self.fronts.advance(at_s)
        bearing = round(bearing_deg(self.map, row, col)) % BEARINGS
        settings = self.settings
        length = self._fill_ring()
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
        turns = rested and back < on * (1.0 - MIN_GAIN)
        if turns:
            self._turn_back(at_s)
        # The importance of turning back is the cost of keeping the direction.
        return Decision(self.clockwise, turns, on, back, round(length))

    def compared(self, row: float, col: float, at_s: float) -> Compared:
        """Return the expected error (in cells) and the position of the front on 360 bearings."""
        first, step = round(bearing_deg(self.map, row, col)), -1 if self.clockwise else 1
        # Bearings starting at the vehicle's bearing, against the direction of flight.
        places = (first + step * np.arange(BEARINGS)) % BEARINGS
        estimate = self.estimate
        values = self._error(estimate.factor_sd())[places]
        front, bearing_rad = self.fronts.front[places], np.radians(places)
        return Compared(
            estimate.centre_row - front * np.cos(bearing_rad),
            estimate.centre_col + front * np.sin(bearing_rad),
            values,
            *window_importance(values),
        )

    def _error(self, factor_sd: Floats) -> Floats:
        """Return the expected error in cells of the estimated front on each bearing."""
        return LEFT_CELLS * self.estimate.slant() + factor_sd * self.estimate.unseen_advance()

    def _fill_ring(self) -> float:
        """Fill the ring from the estimate; return the ring's length in cells."""
        estimate, settings = self.estimate, self.settings
        factor_sd = estimate.factor_sd()
        left = LEFT_CELLS * estimate.slant()
        wind = np.zeros(2)  # towards grid north and east
        if settings.flies_in_wind and estimate.wind_m_s is not None:
            north_m_s, east_m_s = estimate.wind_m_s
            wind = np.array(turned(north_m_s, east_m_s, -self._convergence_deg))
            wind = wind / settings.wind_20ft_share / self._cell_m
        length: float = fill_ring(
            self.fronts.front,
            self._error(factor_sd),
            factor_sd * estimate.speed_cells_s,
            left,
            settings.speed_cells_s,
            wind,
            self._node_of,
            self._ring,
        )
        return length

    def shape(self, row: float, col: float) -> Floats:
        """Return the robust shape of the estimated front: distances in cells on 360 bearings."""
        return robust_front(self.fronts.front)

    def path(self, row: float, col: float) -> Floats:
        """Return the path to fly along the front ahead: an array (n, 2) with row and column.

        The path follows the estimated front. Before the ``monitor`` phase, the path follows the
        visible front, extended by a straight line.
        """
        settings = self.settings.path
        # The path is not smoothed, so that the tip of a narrow fire comes into view.
        if self.phase == "monitor":
            front = self.fronts.front
            return path_along(front, self.estimate, row, col, self.clockwise, settings, 0)
        front = extrapolated_front(self.map, self._in_view, row, col, self.clockwise)
        return path_along(front, self.map, row, col, self.clockwise, settings)


def predictive_planner(
    scenario: Scenario, section: VehicleSection, ground: Ground
) -> PredictivePlanner:
    """Return the planner of one vehicle, with the landscape and the initial fuel moistures."""
    planner, cell_m = scenario.planner, ground.landscape.cell_size_m
    settings = PredictiveSettings(
        clockwise_first=planner.first_direction == "clockwise",
        ignition_known=planner.ignition_known,
        speed_cells_s=section.airspeed_m_s / cell_m,
        turn_radius_cells=section.turn_radius_m / cell_m,
        flies_in_wind=True,
        wind_20ft_share=1.0,  # the estimate's factors compensate for a wrong fraction
        path=path_settings(scenario, cell_m),
    )
    return PredictivePlanner(
        settings,
        ground.landscape.shape,
        ground.centre,
        ground.burns_from_s,
        cell_m,
        model_of(ground.landscape, weather_of(scenario).weather_at(ground.burns_from_s)),
    )
