"""A fire by itself: burn a scenario to its end and write what it did."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from firemodel.map import draw_map
from firemodel.writers import write_fronts, write_rasters
from mission_service.config import Scenario
from mission_service.errors import ScenarioError
from mission_service.fire_setup import fire_of, landscape_of
from mission_service.report import fire_progress

STEPS = 200  # of progress


def run_fire(scenario: Scenario, folder: Path, front_every_s: float) -> dict[str, Any]:
    """Write rasters, fronts, map and summary into a folder; returns the summary.

    Raises ScenarioError if the fire is taken over after the scenario's end.
    """
    landscape = landscape_of(scenario)
    fire = fire_of(scenario, landscape)
    start_s = fire.time_s
    if start_s >= scenario.duration_s:
        raise ScenarioError(
            f"{scenario.name}: fire.burning_at_s = {start_s:g} must be before duration_s"
        )
    with fire_progress(scenario.name, start_s, scenario.duration_s) as progress:
        for time_s in np.linspace(start_s, scenario.duration_s, STEPS + 1)[1:]:
            fire.advance(float(time_s))
            progress(float(time_s))
    write_rasters(folder, fire)
    times_s = [
        *np.arange(start_s + front_every_s, scenario.duration_s, front_every_s).tolist(),
        scenario.duration_s,
    ]
    write_fronts(folder / "fronts.geojson", fire, times_s, scenario.name, scenario.time_zero)
    arrival_s = np.where(fire.burned(), fire.arrival_time_s, np.inf)
    hours = scenario.duration_s / 3600.0
    draw_map(
        folder / "map.png",
        landscape,
        arrival_s,
        f"{scenario.name}: {scenario.fire.scheme}, {hours:.3g} h",
    )
    summary = {
        "scenario": scenario.name,
        "scheme": scenario.fire.scheme,
        "cells": landscape.fuel_model.size,
        "burned_cells": int(np.count_nonzero(fire.burned())),
        "burned_area_ha": round(fire.front(fire.time_s).area / 1e4, 2),
        "reached_edge": bool(_edge(fire.burned()).any()),
        "time_s": fire.time_s,
    }
    (folder / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    return summary


def _edge(cells: np.ndarray[Any, np.dtype[np.bool_]]) -> np.ndarray[Any, np.dtype[np.bool_]]:
    return np.concatenate([cells[0], cells[-1], cells[:, 0], cells[:, -1]])
