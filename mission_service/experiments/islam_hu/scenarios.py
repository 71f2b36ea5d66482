"""Define six fires like those in the paper, with two spread schemes, and the paper's planners."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.schemes import SchemeName
from mission_service.config.sections import PlannerSection
from mission_service.experiments.fires import (
    BRUSH,
    HOUR_S,
    SHORT_GRASS,
    TALL_GRASS,
    TIMBER_LITTER,
    Burn,
    burn,
    dry_wind,
    flat,
    of_one_fuel,
    of_two_fuels,
    wind,
)
from mission_service.guidance.front.front_path import PathSettings
from mission_service.guidance.front.islam_hu_planner import (
    PerimeterPlanner,
    Rule,
    perimeter_settings,
)
from mission_service.guidance.protocol import Planner

COMPARED: tuple[SchemeName, ...] = ("devs8", "anyangle")
ALPHAS = (0.0, 0.8, 1.0, 1.2, 1.5, 5.0)
# The numbers in figs. 11 and 16 of the paper, for the paper's own fires.
PAPER_REVERSALS = {"slow-then-fast": (0, 8, 11, 15, 20, 43)}
PAPER_MEAN_MAX_CELLS = {
    "slow-then-fast": {"circling": 8.5, "islam_hu": 7.3, "islam_hu_damped": 7.3},
    "fast": {"circling": 15.8, "islam_hu": 12.2, "islam_hu_damped": 12.2},
}


@dataclass(frozen=True)
class FireScenario:
    """One of the fires of Islam & Hu, section VI."""

    fuel: NDArray[np.int16]
    weather: tuple[Weather, ...]
    ignition: tuple[int, int]
    speed_m_s: float  # at this speed, circling has an error of 7 to 16 cells, as in the paper


ISLAM_HU_END_S = 6 * HOUR_S
# The fires are, in order, those of figs. 9, 11 and 14a; 13a and 14b; 13b; 13c; 12a; 12b. The paper
# does not state the weather: these values were tuned until the error of circling and the behaviour
# of the damped rule were as in the paper. In "wind-turns" the later wind is stronger; with winds of
# equal speed the damped rule made few reversals in the south. "slow-even" is tall grass in a light
# wind; without wind, no real vehicle would be slow enough for the fire.
ISLAM_HU: dict[str, FireScenario] = {
    "slow-then-fast": FireScenario(
        of_one_fuel(BRUSH), (wind(0.0, 4.0, 45.0), wind(3 * HOUR_S, 11.0, 45.0)), (35, 165), 4.2
    ),
    "fast": FireScenario(of_one_fuel(BRUSH), (wind(0.0, 8.0, 45.0),), (35, 165), 3.4),
    "slow-even": FireScenario(of_one_fuel(TALL_GRASS), (dry_wind(0.0, 0.9, 45.0),), (90, 110), 2.8),
    "wind-turns": FireScenario(
        of_one_fuel(BRUSH), (wind(0.0, 6.0, 180.0), wind(3 * HOUR_S, 9.0, 0.0)), (77, 100), 4.5
    ),
    "brush-grass": FireScenario(
        of_two_fuels(BRUSH, SHORT_GRASS), (dry_wind(0.0, 3.3, 0.0),), (60, 100), 3.2
    ),
    "brush-litter": FireScenario(
        of_two_fuels(BRUSH, TIMBER_LITTER), (wind(0.0, 8.0, 0.0),), (20, 100), 3.5
    ),
}


def islam_hu_burn(name: str, scheme: SchemeName) -> Burn:
    """Return the fire of Islam & Hu, section VI, with this name in ``ISLAM_HU``."""
    scenario = ISLAM_HU[name]
    return burn(
        name,
        scheme,
        flat(scenario.fuel),
        WeatherStream(scenario.weather),
        scenario.ignition,
        ISLAM_HU_END_S,
        scenario.speed_m_s,
    )


def islam_hu_planner(burn: Burn, rule: Rule, alpha: float = 1.0) -> PerimeterPlanner:
    """Return the planner of Islam & Hu for a known ignition, with the defaults of scenarios."""
    # This experiment does not use the planner's paths.
    path = PathSettings(horizon_cells=80.0, lookahead_cells=5.0)
    speed_cells_s = burn.speed_m_s / burn.landscape.cell_size_m
    settings = perimeter_settings(PlannerSection(rule=rule, alpha=alpha), speed_cells_s, path)
    centre = (float(burn.ignition[0]), float(burn.ignition[1]))
    return PerimeterPlanner(settings, burn.arrival_s.shape, centre, 0.0)


PLANNERS: dict[str, Callable[[Burn], Planner]] = {
    "circling": lambda burn: islam_hu_planner(burn, "circling"),
    "islam_hu": lambda burn: islam_hu_planner(burn, "islam_hu"),
    "islam_hu_damped": lambda burn: islam_hu_planner(burn, "islam_hu_damped"),
}


def changes_s(burn: Burn) -> float:
    """Return the time at which weather or fuel changes, or else the midpoint of the flight.

    The fuel changes when the fire reaches the southern fuel.
    """
    fuel = burn.landscape.fuel_model
    if len(burn.weather.entries) > 1:
        return burn.weather.change_times()[0]
    if (fuel != fuel[0, 0]).any():
        return float(burn.arrival_s[fuel != fuel[0, 0]].min())
    return (burn.deploy_s + burn.end_s) / 2.0
