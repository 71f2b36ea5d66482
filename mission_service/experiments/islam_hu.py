"""Islam & Hu, section VI: one vehicle on six fires."""

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from firemodel.spread.schemes import SchemeName
from mission_service.config.sections import PlannerSection
from mission_service.experiments.fires import (
    COMPARED,
    HOUR_S,
    ISLAM_HU,
    Burn,
    islam_hu_burn,
)
from mission_service.experiments.ideal_flight import Flight, fly
from mission_service.experiments.predictive_flight import fly_predictive
from mission_service.guidance.front.following import PathSettings
from mission_service.guidance.front.perimeter import PerimeterPlanner, PerimeterSettings, Rule
from mission_service.guidance.protocol import Planner

ALPHAS = (0.0, 0.8, 1.0, 1.2, 1.5, 5.0)
# What the paper prints: figs. 11 and 16, there on fires of its own.
PAPER_REVERSALS = {"slow-then-fast": (0, 8, 11, 15, 20, 43)}
PAPER_MEAN_MAX_CELLS = {
    "slow-then-fast": {"circling": 8.5, "literal": 7.3, "damped": 7.3},
    "fast": {"circling": 15.8, "literal": 12.2, "damped": 12.2},
}


def perimeter_planner(burn: Burn, rule: Rule, alpha: float = 1.0) -> PerimeterPlanner:
    """The planner of Islam & Hu for a fire whose ignition is known, with a scenario's defaults."""
    defaults = PlannerSection()
    settings = PerimeterSettings(
        rule=rule,
        alpha=alpha,
        clockwise_first=True,
        ignition_known=True,
        baseline_s=defaults.baseline_s,
        smoothing_deg=defaults.smoothing_deg,
        reversal_margin=defaults.reversal_margin,
        least_gain_cells=defaults.least_gain_cells,
        dwell_s=defaults.dwell_s,
        speed_cells_s=burn.speed_m_s / burn.landscape.cell_size_m,
        path=PathSettings(horizon_cells=80.0, lead_cells=5.0),  # paths are not flown
    )
    centre = (float(burn.ignition[0]), float(burn.ignition[1]))
    return PerimeterPlanner(settings, burn.arrival_s.shape, centre, 0.0)


PLANNERS: dict[str, Callable[[Burn], Planner]] = {
    "circling": lambda burn: perimeter_planner(burn, "circling"),
    "literal": lambda burn: perimeter_planner(burn, "literal"),
    "damped": lambda burn: perimeter_planner(burn, "damped"),
}


def run(
    out: Path | None,
    names: tuple[str, ...] = tuple(ISLAM_HU),
    progress: Callable[[str], None] = lambda text: None,
) -> dict[str, Any]:
    """Fly all planners over all fires, on two cores; figures as PNG in ``out``, if given.

    Cells are 30 m. ``alpha_sweep`` is the damped rule; ``attention`` is its reversals and the
    share of time north of the ignition, at alpha 1, before and after the fire changes.
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
    """All flights over one fire."""
    burn = islam_hu_burn(name, scheme)
    which = {"scenario": name, "scheme": scheme}
    flights = {planner: fly(burn, make(burn)) for planner, make in PLANNERS.items()}
    flights["predictive"] = fly_predictive(burn)
    sweep = {
        alpha: flights["damped"]
        if alpha == 1.0
        else fly(burn, perimeter_planner(burn, "damped", alpha))
        for alpha in ALPHAS
    }
    if out:
        from mission_service.experiments.islam_hu_figures import draw

        draw(out, burn, flights, sweep)
    return {
        "alpha_sweep": [
            {**which, "alpha": alpha, "reversals": len(flight.reversals)}
            for alpha, flight in sweep.items()
        ],
        "distance_error": [
            {
                **which,
                "planner": planner,
                "reversals": len(flight.reversals),
                "mean_max_cells": round(float(flight.max_error.mean()), 3),
                "mean_mean_cells": round(float(flight.mean_error.mean()), 3),
            }
            for planner, flight in flights.items()
        ],
        "attention": [{**which, **attention(burn, flights["damped"])}],
    }


def changes_s(burn: Burn) -> float:
    """When a fire changes: other weather, or it comes to the southern fuel; else half-way."""
    fuel = burn.landscape.fuel_model
    if len(burn.weather.entries) > 1:
        return burn.weather.change_times()[0]
    if (fuel != fuel[0, 0]).any():
        return float(burn.arrival_s[fuel != fuel[0, 0]].min())
    return (burn.deploy_s + burn.end_s) / 2.0


def attention(burn: Burn, flight: Flight) -> dict[str, float]:
    """Reversals, and the share of time north of the ignition, before and after the change."""
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


def in_text(found: dict[str, Any]) -> str:
    """The result as tables for people."""
    return "\n\n".join((_reversals(found), _errors(found), _attention(found)))


def _reversals(found: dict[str, Any]) -> str:
    lines = [
        "Reversals in five hours, damped rule",
        "  fire            scheme    " + "".join(f"{f'α = {alpha:g}':>9}" for alpha in ALPHAS),
    ]
    for name, scheme in _fires(found):
        counts = [row["reversals"] for row in _of(found["alpha_sweep"], name, scheme)]
        lines.append(f"  {name:16}{scheme:10}" + "".join(f"{count:9}" for count in counts))
        if name in PAPER_REVERSALS and scheme == COMPARED[-1]:
            printed = "".join(f"{count:9}" for count in PAPER_REVERSALS[name])
            lines.append(f"  {'':16}{'paper':10}{printed}")
    return "\n".join(lines)


def _errors(found: dict[str, Any]) -> str:
    planners = [row["planner"] for row in _of(found["distance_error"], *_fires(found)[0])]
    lines = [
        "Distance error in cells over 360 angles, α = 1: mean over time of the maximum (change",
        "against circling); then of the mean. Of the convex hull of what was seen (section VI.E);",
        "predictive: of the front it believes in",
        "  fire            scheme    "
        + "".join(f"{planner:>15}" for planner in planners)
        + "   "
        + "".join(f"{planner:>11}" for planner in planners),
    ]
    for name, scheme in _fires(found):
        rows = _of(found["distance_error"], name, scheme)
        worst = {row["planner"]: row["mean_max_cells"] for row in rows}
        lines.append(
            f"  {name:16}{scheme:10}{_beside_circling(worst, planners)}   "
            + "".join(f"{row['mean_mean_cells']:11.2f}" for row in rows)
        )
        if name in PAPER_MEAN_MAX_CELLS and scheme == COMPARED[-1]:
            printed = _beside_circling(PAPER_MEAN_MAX_CELLS[name], planners)
            lines.append(f"  {'':16}{'paper':10}{printed}".rstrip())
    return "\n".join(lines)


def _beside_circling(worst: dict[str, float], planners: list[str]) -> str:
    text = f"{worst['circling']:15.1f}"
    for planner in planners[1:]:
        cell = ""
        if planner in worst:
            change = 100.0 * (worst[planner] / worst["circling"] - 1.0)
            cell = f"{worst[planner]:.1f} ({change:+.0f} %)"
        text += f"{cell:>15}"
    return text


def _attention(found: dict[str, Any]) -> str:
    lines = [
        "Attention of the damped rule, α = 1, before and after the fire changes",
        "  fire            scheme     changes   reversals    time north of the ignition",
    ]
    for row in found["attention"]:
        turns = f"{row['reversals_before']} → {row['reversals_after']}"
        north = f"{row['time_north_before']:.0%} → {row['time_north_after']:.0%}"
        fire = f"{row['scenario']:16}{row['scheme']:10}"
        lines.append(f"  {fire}{row['changes_h']:6.1f} h{turns:>12}    {north}")
    return "\n".join(lines)


def _fires(found: dict[str, Any]) -> list[tuple[str, str]]:
    return [(row["scenario"], row["scheme"]) for row in found["attention"]]


def _of(rows: list[dict[str, Any]], name: str, scheme: str) -> list[dict[str, Any]]:
    return [row for row in rows if (row["scenario"], row["scheme"]) == (name, scheme)]
