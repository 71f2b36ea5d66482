"""Simulates a scenario's fire without vehicles and writes the results to files."""

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from firemodel.spread.arrival_map import draw_map
from firemodel.spread.fire_scheme import Fire
from firemodel.spread.writers import write_fronts, write_rasters
from mission_service.config.scenario import Scenario
from mission_service.errors import ScenarioError
from mission_service.fire.setup import fire_of, landscape_of
from mission_service.runtime.progress import fire_progress

STEPS = 200  # progress reports of a run
MAX_FRONTS = 10_000


def run_fire(scenario: Scenario, folder: Path, front_every_s: float) -> dict[str, Any]:
    """Write the rasters, fronts, map and summary to a folder, and return the summary.

    Raises ScenarioError if no fire starts before the scenario's end, for more than ``MAX_FRONTS``
    fronts, or for a folder that cannot be written to.
    """
    check_times(scenario)
    landscape = landscape_of(scenario)
    fire = fire_of(scenario, landscape)
    start_s = fire.time_s
    times_s = _times_s(start_s, scenario.duration_s, front_every_s)
    with fire_progress(scenario.name, start_s, scenario.duration_s) as progress:
        for time_s in np.linspace(start_s, scenario.duration_s, STEPS + 1)[1:]:
            fire.advance(float(time_s))
            progress(float(time_s))
    with writing(folder):
        return _write(scenario, landscape, fire, folder, times_s)


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Report an OSError within the context as a ScenarioError that names the file or folder."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or " ".join(str(error).split())
        raise ScenarioError(f"{error.filename or folder}: cannot be written: {reason}") from None


def check_times(scenario: Scenario) -> None:
    """Raise ScenarioError unless a fire burns before the scenario's end."""
    section, end_s = scenario.fire, scenario.duration_s
    given = section.perimeter or section.arrival
    first_s = min((ignition.at_s for ignition in scenario.ignition), default=0.0)
    if first_s >= end_s and not given:
        raise ScenarioError(
            f"{scenario.name}: the first ignition is at_s = {first_s:g}, which must be before "
            f"duration_s = {end_s:g}"
        )
    if (given or section.initial_cells) and section.burning_at_s >= end_s:
        raise ScenarioError(
            f"{scenario.name}: fire.burning_at_s = {section.burning_at_s:g} must be before "
            "duration_s"
        )


def _times_s(start_s: float, end_s: float, every_s: float) -> list[float]:
    """Return the times of the written fronts: every ``every_s`` after the start, and the end."""
    count = max(math.ceil((end_s - start_s) / every_s - 1e-9), 1)
    if count > MAX_FRONTS:
        raise ScenarioError(
            f"--front-every {every_s:g} gives {count} fronts until {end_s:g} s, more than "
            f"{MAX_FRONTS}; give {math.ceil((end_s - start_s) / MAX_FRONTS)} or more"
        )
    return [start_s + number * every_s for number in range(1, count)] + [end_s]


def _write(
    scenario: Scenario, landscape: Landscape, fire: Fire, folder: Path, times_s: list[float]
) -> dict[str, Any]:
    write_rasters(folder, fire)
    write_fronts(folder / "fronts.geojson", fire, times_s, scenario.name, scenario.time_zero)
    arrival_s = np.where(fire.burned(), fire.arrival_time_s, np.inf)
    draw_map(
        folder / "map.png",
        landscape,
        arrival_s,
        f"{scenario.name}: {scenario.fire.scheme}, {in_words(scenario.duration_s)}",
    )
    summary = {
        "scenario": scenario.name,
        "scheme": scenario.fire.scheme,
        "cells": landscape.fuel_model.size,
        "burned_cells": int(np.count_nonzero(fire.burned())),
        "burned_area_ha": round(fire.front(fire.time_s).area / 1e4, 2),
        "reached_edge": reaches_edge(fire.burned()),
        "time_s": fire.time_s,
    }
    (folder / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    return summary


def in_words(time_s: float) -> str:
    """Return a duration in hours or minutes."""
    return f"{time_s / 3600.0:.3g} h" if time_s >= 3600.0 else f"{time_s / 60.0:.3g} min"


def reaches_edge(cells: NDArray[np.bool_]) -> bool:
    """Return True if a mask (y, x) has a cell at the edge of the grid."""
    return bool(np.concatenate([cells[0], cells[-1], cells[:, 0], cells[:, -1]]).any())
