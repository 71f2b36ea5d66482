"""Define the fire and the cases of Bent's experiments: planners, negotiations, team sizes."""

from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.physics.weather import WeatherStream
from mission_service.experiments.fires import (
    BRUSH,
    HOUR_S,
    SHORT_GRASS,
    Burn,
    burn,
    flat,
    of_two_fuels,
    wind,
)
from mission_service.guidance.team.balanced import Balanced
from mission_service.guidance.team.bent_rules import (
    BENCHMARKS,
    IMPORTANCES,
    LATER_NEGOTIATIONS,
    LATER_PLANNERS,
    NEGOTIATIONS,
    PLANNERS,
    bent_rule,
)
from mission_service.guidance.team.front_ring import TeamRule

Floats = NDArray[np.float64]

SPEED_M_S = 20.0
SIZES = (2, 3, 4, 5, 6)


def uneven() -> Burn:
    """Return a fire on brush (north) and grass (south) in a wind that changes twice."""
    weather = WeatherStream(
        (wind(0.0, 4.0, 30.0), wind(2.0 * HOUR_S, 6.0, 60.0), wind(3.5 * HOUR_S, 3.0, 20.0))
    )
    land = flat(of_two_fuels(BRUSH, SHORT_GRASS))
    return burn("uneven", "anyangle", land, weather, (75, 150), 5.0 * HOUR_S, SPEED_M_S)


class Case(NamedTuple):
    """The settings of one run.

    A benchmark has no negotiation. For a benchmark, ``importance`` selects only the cost.
    """

    planner: str
    negotiation: str | None
    importance: str
    uavs: int


@dataclass(frozen=True)
class Run:
    """The result of a case, with the cost every 20 s from deployment."""

    case: Case
    cost: Floats
    min_separation_m: float

    @property
    def mean(self) -> float:
        """The mean of the cost over time."""
        return float(self.cost.mean())

    @property
    def std(self) -> float:
        """The standard deviation of the cost over time."""
        return float(self.cost.std())

    def as_row(self) -> dict[str, Any]:
        """Return the result as a row of the JSON output."""
        return {
            **self.case._asdict(),
            "mean_cost": self.mean,
            "std_cost": self.std,
            "min_separation_m": self.min_separation_m,
        }


def thesis_cases() -> list[Case]:
    """Return the cases of the thesis: 80 combinations and 20 benchmarks."""
    cases = [Case(*names) for names in product(PLANNERS, NEGOTIATIONS, IMPORTANCES, SIZES)]
    return cases + [
        Case(name, None, importance, uavs)
        for name, importance, uavs in product(BENCHMARKS, IMPORTANCES, SIZES)
    ]


def later_cases() -> list[Case]:
    """Return the cases that use the two ideas proposed in the thesis as future work (6.1)."""
    cases = product(PLANNERS | LATER_PLANNERS, NEGOTIATIONS | LATER_NEGOTIATIONS)  # type: ignore[operator]
    return [
        Case(planner, negotiation, importance, uavs)
        for (planner, negotiation), importance, uavs in product(cases, IMPORTANCES, SIZES)
        if planner in LATER_PLANNERS or negotiation in LATER_NEGOTIATIONS
    ]


def balanced_cases() -> list[Case]:
    """Return the cases of the rule ``team.balanced``."""
    return [
        Case("balanced", None, importance, uavs) for importance in IMPORTANCES for uavs in SIZES
    ]


def team_size_cases() -> list[Case]:
    """Return the additional case of figure 5.3, which has one vehicle."""
    return [Case("back-and-forth", "importance", "linear", 1)]


def rule_of(case: Case) -> TeamRule:
    """Return the planner rule of a case."""
    if case.planner == "balanced":
        return Balanced("exponential" if case.importance == "exponential" else "linear")
    return bent_rule(case.planner, case.negotiation, case.importance)
