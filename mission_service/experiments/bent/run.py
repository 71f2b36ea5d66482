"""Run Bent's experiments (thesis, chapter 5): planners with negotiations, and benchmarks."""

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import chain, islice
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from mission_service.experiments.bent.ring_flight import fly_team
from mission_service.experiments.bent.ring_history import (
    EVERY_S,
    RingStep,
    Spread,
    ring_history,
)
from mission_service.experiments.bent.scenarios import (
    Case,
    Run,
    balanced_cases,
    later_cases,
    rule_of,
    team_size_cases,
    thesis_cases,
    uneven,
)

PROGRESS_EVERY = 20
PROCESSES = 2
# The thesis states no speed; the vehicles in it move like the firefighters of section 2.3. With
# maximum rates of spread this speed results in costs near the thesis's averages of 64 and 3,000.
SPEED_M_S = 3.3


_shared: tuple[Sequence[RingStep], float] | None = None


def _share(history: Sequence[RingStep], speed_m_s: float) -> None:
    global _shared
    _shared = history, speed_m_s


def _fly_shared(case: Case) -> Run:
    assert _shared is not None
    return fly_case(case, *_shared)


def fly_case(case: Case, history: Sequence[RingStep], speed_m_s: float) -> Run:
    """Fly one case along the ring of a fire."""
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
    """Fly many cases in separate processes, and return the results in the order of the cases."""
    with ProcessPoolExecutor(PROCESSES, get_context("spawn"), _share, (history, speed_m_s)) as pool:
        found = []
        for run in pool.map(_fly_shared, cases, chunksize=4):
            found.append(run)
            if len(found) % PROGRESS_EVERY == 0:
                progress(f"{len(found)} of {len(cases)} flights")
        return found


def run(
    out: Path | None,
    speed_m_s: float = SPEED_M_S,
    progress: Callable[[str], None] = lambda text: None,
    spread: Spread = "maximum",
) -> dict[str, Any]:
    """Fly all cases and return the result; if ``out`` is given, draw figures in that folder.

    ``spread`` selects the rate of spread used in the importance of a cell.
    """
    burn = uneven()
    history = ring_history(burn, spread=spread)
    groups = {"runs": thesis_cases(), "later": later_cases(), "balanced": balanced_cases()}
    single = team_size_cases()
    cases = [*chain(*groups.values()), *single]
    flown = iter(fly_cases(cases, history, speed_m_s, progress))
    runs = {name: list(islice(flown, len(group))) for name, group in groups.items()}
    if out:
        from mission_service.experiments.bent.figures import draw

        draw(out, runs["runs"], list(flown), EVERY_S)
    return {
        "fire": burn.name,
        "speed_m_s": speed_m_s,
        "spread": spread,
        "hours": (burn.end_s - burn.deploy_s) / 3600.0,
        "perimeter_km": [float(step.step_m.sum()) / 1e3 for step in (history[0], history[-1])],
        **{name: [one.as_row() for one in group] for name, group in runs.items()},
    }
