"""Bent's experiments (thesis, chapter 5): every planner with every negotiation, and benchmarks."""

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mission_service.experiments.ring_flight import fly_team
from mission_service.experiments.ring_history import EVERY_S, RingStep, ring_history
from mission_service.experiments.team_fires import uneven
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
from mission_service.guidance.team.ring import TeamRule

Floats = NDArray[np.float64]

SIZES = (2, 3, 4, 5, 6)
TOLD_EVERY = 20
PROCESSES = 2
# The thesis does not tell; its vehicles move as a model of firefighters does (2.3), and at this
# speed its costs come out: 64 and 3,000 on average.
SPEED_M_S = 1.5


class Case(NamedTuple):
    """One run; a benchmark has no negotiation, and its importance is only that of its cost."""

    planner: str
    negotiation: str | None
    importance: str
    uavs: int


@dataclass(frozen=True)
class Run:
    """What came of a case; the cost every 20 s, from deployment on."""

    case: Case
    cost: Floats
    min_separation_m: float

    @property
    def mean(self) -> float:
        """Of the cost over time."""
        return float(self.cost.mean())

    @property
    def std(self) -> float:
        """Of the cost over time."""
        return float(self.cost.std())

    def told(self) -> dict[str, Any]:
        """As in the JSON."""
        return {
            **self.case._asdict(),
            "mean_cost": self.mean,
            "std_cost": self.std,
            "min_separation_m": self.min_separation_m,
        }


def thesis_cases() -> list[Case]:
    """The thesis's 80 runs, and its 20 of benchmarks."""
    cases = [Case(*names) for names in product(PLANNERS, NEGOTIATIONS, IMPORTANCES, SIZES)]
    return cases + [
        Case(name, None, importance, uavs)
        for name, importance, uavs in product(BENCHMARKS, IMPORTANCES, SIZES)
    ]


def later_cases() -> list[Case]:
    """With the two ideas that the thesis leaves for later (6.1)."""
    cases = product(PLANNERS | LATER_PLANNERS, NEGOTIATIONS | LATER_NEGOTIATIONS)  # type: ignore[operator]
    return [
        Case(planner, negotiation, importance, uavs)
        for (planner, negotiation), importance, uavs in product(cases, IMPORTANCES, SIZES)
        if planner in LATER_PLANNERS or negotiation in LATER_NEGOTIATIONS
    ]


def balanced_cases() -> list[Case]:
    """team.balanced, beside them."""
    return [
        Case("balanced", None, importance, uavs) for importance in IMPORTANCES for uavs in SIZES
    ]


def team_size_cases() -> list[Case]:
    """What figure 5.3 shows besides: one vehicle."""
    return [Case("back-and-forth", "importance", "linear", 1)]


_shared: tuple[Sequence[RingStep], float] | None = None


def _share(history: Sequence[RingStep], speed_m_s: float) -> None:
    global _shared
    _shared = history, speed_m_s


def _flown(case: Case) -> Run:
    assert _shared is not None
    return fly_case(case, *_shared)


def rule_of(case: Case) -> TeamRule:
    """The rule that a case flies."""
    if case.planner == "balanced":
        return Balanced("exponential" if case.importance == "exponential" else "linear")
    return bent_rule(case.planner, case.negotiation, case.importance)


def fly_case(case: Case, history: Sequence[RingStep], speed_m_s: float) -> Run:
    """Fly one case over the ring of a fire."""
    rule = rule_of(case)
    flight = fly_team(history, rule, case.uavs, speed_m_s)
    cost = flight.exponential if case.importance == "exponential" else flight.linear
    return Run(case, cost, flight.min_separation_m)


def fly_cases(
    cases: Sequence[Case],
    history: Sequence[RingStep],
    speed_m_s: float,
    progress: Callable[[str], None] = lambda text: None,
) -> list[Run]:
    """Fly many, in processes of their own; in the order of the cases."""
    with ProcessPoolExecutor(PROCESSES, get_context("spawn"), _share, (history, speed_m_s)) as pool:
        found = []
        for run in pool.map(_flown, cases, chunksize=4):
            found.append(run)
            if len(found) % TOLD_EVERY == 0:
                progress(f"{len(found)} of {len(cases)} flights")
        return found


def run(
    out: Path | None,
    speed_m_s: float = SPEED_M_S,
    progress: Callable[[str], None] = lambda text: None,
) -> dict[str, Any]:
    """Everything the experiment tells; figures as PNG in ``out``, if given."""
    burn = uneven()
    history = ring_history(burn)
    thesis, later, single = thesis_cases(), later_cases(), team_size_cases()
    ours = balanced_cases()
    runs = fly_cases([*thesis, *later, *ours, *single], history, speed_m_s, progress)
    of_thesis, of_later = runs[: len(thesis)], runs[len(thesis) : len(thesis) + len(later)]
    of_ours = runs[len(thesis) + len(later) : -len(single)]
    if out:
        from mission_service.experiments.bent_figures import draw

        draw(out, of_thesis, runs[-len(single) :], EVERY_S)
    return {
        "fire": burn.name,
        "speed_m_s": speed_m_s,
        "hours": (burn.end_s - burn.deploy_s) / 3600.0,
        "perimeter_km": [float(step.step_m.sum()) / 1e3 for step in (history[0], history[-1])],
        "runs": [one.told() for one in of_thesis],
        "later": [one.told() for one in of_later],
        "balanced": [one.told() for one in of_ours],
    }
