"""Run the experiments of Islam & Hu, section VI: one vehicle on six fires."""

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.spread.schemes import SchemeName
from mission_service.experiments.fires import HOUR_S, Burn
from mission_service.experiments.islam_hu.ideal_flight import Flight, fly
from mission_service.experiments.islam_hu.predictive_flight import fly_predictive
from mission_service.experiments.islam_hu.scenarios import (
    ALPHAS,
    COMPARED,
    ISLAM_HU,
    PLANNERS,
    changes_s,
    islam_hu_burn,
    islam_hu_planner,
)
from mission_service.experiments.islam_hu.without_aircraft import (
    front_errors,
    modelled,
    persistent,
)

Floats = NDArray[np.float64]


def run(
    out: Path | None,
    names: tuple[str, ...] = tuple(ISLAM_HU),
    progress: Callable[[str], None] = lambda text: None,
) -> dict[str, Any]:
    """Simulate all planners on all fires, on two cores; if ``out`` is given, draw figures there.

    Cells are 30 m wide. ``alpha_sweep`` contains the reversals of the damped rule for several
    alphas. ``distance_error`` also contains rows without aircraft: ``persistence`` (the front
    remains where it is at deployment) and ``model`` (the model alone, with the weather at the
    ignition). ``attention`` contains, for the damped rule with alpha 1, the reversals and the
    fraction of time north of the ignition, before and after the fire changes.
    """
    found: dict[str, Any] = {"alpha_sweep": [], "distance_error": [], "attention": []}
    cases = list(product(names, COMPARED))
    with ProcessPoolExecutor(2) as pool:
        parts = pool.map(on_one_fire, *zip(*cases, strict=True), [out] * len(cases))
        for number, ((name, scheme), part) in enumerate(zip(cases, parts, strict=True), 1):
            progress(f"{name}, {scheme}: flown ({number} of {len(cases)})")
            for key, rows in part.items():
                found[key] += rows
    return found


def on_one_fire(name: str, scheme: SchemeName, out: Path | None) -> dict[str, list[dict[str, Any]]]:
    """Simulate all flights over one fire."""
    burn = islam_hu_burn(name, scheme)
    which = {"scenario": name, "scheme": scheme}
    flights = {planner: fly(burn, make(burn)) for planner, make in PLANNERS.items()}
    flights["predictive"] = fly_predictive(burn)
    sweep = {
        alpha: flights["islam_hu_damped"]
        if alpha == 1.0
        else fly(burn, islam_hu_planner(burn, "islam_hu_damped", alpha))
        for alpha in ALPHAS
    }
    if out:
        from mission_service.experiments.islam_hu.figures import draw

        draw(out, burn, flights, sweep)
    return {
        "alpha_sweep": [
            {**which, "alpha": alpha, "reversals": len(flight.reversals)}
            for alpha, flight in sweep.items()
        ],
        "distance_error": [
            {**which, **row}
            for row in (
                *(
                    error_row(name, flight.max_error, flight.mean_error, len(flight.reversals))
                    for name, flight in flights.items()
                ),
                *without_aircraft(burn, flights["circling"]),
            )
        ],
        "attention": [{**which, **attention(burn, flights["islam_hu_damped"])}],
    }


def without_aircraft(burn: Burn, flight: Flight) -> list[dict[str, Any]]:
    """Return the errors of persistence and of the model alone, at the times of a flight."""
    found = []
    for name, expected in (("persistence", persistent(burn)), ("model", modelled(burn))):
        errors = front_errors(expected, burn, flight.at_s)
        found.append(error_row(name, errors.max(axis=1), errors.mean(axis=1)))
    return found


def error_row(
    planner: str, max_error: Floats, mean_error: Floats, reversals: int = 0
) -> dict[str, Any]:
    """Return a row of the table of distance errors; the errors are in cells, one for each time."""
    return {
        "planner": planner,
        "reversals": reversals,
        "mean_max_cells": round(float(max_error.mean()), 3),
        "mean_mean_cells": round(float(mean_error.mean()), 3),
    }


def attention(burn: Burn, flight: Flight) -> dict[str, float]:
    """Return the reversals and the share of time in the north, before and after the fire's change.

    The north is the area north of the ignition.
    """
    at_s = changes_s(burn)
    earlier, turns_earlier = flight.track[:, 0] < at_s, flight.reversals[:, 0] < at_s
    north = flight.track[:, 1] < burn.ignition[0]
    return {
        "changes_h": round(at_s / HOUR_S, 2),
        "reversals_before": int(np.count_nonzero(turns_earlier)),
        "reversals_after": int(np.count_nonzero(~turns_earlier)),
        "time_north_before": round(float(north[earlier].mean()), 3),
        "time_north_after": round(float(north[~earlier].mean()), 3),
    }
