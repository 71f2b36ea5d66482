"""Simulates the fire of a scenario for all combinations of values of some of its keys."""

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.outputs.front_files import fronts_geojson
from firemodel.spread.behaviour import behaviour_of
from firemodel.spread.edge import at_edge
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.config.sections import LandscapeSection
from mission_service.errors import ScenarioError
from mission_service.fire.setup import fire_of, landscape_in
from mission_service.runtime.progress import fire_progress
from mission_service.simulation.fire_alone import check_times, writing
from mission_service.simulation.result_files import (
    check_command,
    complete,
    numbered,
    reading,
    recipe_of,
    results_folder,
    whole_files,
)
from mission_service.simulation.task_pool import Run

MAX_RUNS = 10_000
SUFFIX = ".geojson"


@dataclass(frozen=True)
class Sweep:
    """The runs of a sweep: a scenario with overrides, and the values of each run."""

    scenario: str  # a file or the name of a shipped scenario, as for ``load_scenario``
    overrides: tuple[str, ...]
    keys: tuple[str, ...]
    values: tuple[tuple[str, ...], ...]  # (runs, keys)

    def load(self, number: int) -> Scenario:
        """Return the scenario of a run. Raises ScenarioError for an invalid combination."""
        pairs = zip(self.keys, self.values[number], strict=True)
        changes = tuple(f"{key}={value}" for key, value in pairs)
        try:
            return load_scenario(self.scenario, (*self.overrides, *changes))
        except ScenarioError as error:
            option, _, rest = str(error).partition(": ")
            if option.removeprefix("--set ") in changes:
                raise ScenarioError(f"--vary {option.removeprefix('--set ')}: {rest}") from None
            raise

    def label(self, number: int) -> str:
        """Return a text with the keys and values of a run."""
        pairs = zip(self.keys, self.values[number], strict=True)
        return ", ".join(f"{key}={value}" for key, value in pairs)


def sweep_of(scenario: str, overrides: tuple[str, ...], varied: Sequence[str]) -> Sweep:
    """Return the sweep over all combinations of ``KEY=VALUES``; the last key varies fastest.

    Raises ScenarioError for text in another form, a key that appears twice, or too many runs.
    """
    values = {}
    for text in varied:
        key, equals, given = text.partition("=")
        if not (equals and key and given):
            raise ScenarioError(f"--vary {text}: write it as KEY=VALUES, e.g. fire.precise=true")
        if key in values:
            raise ScenarioError(f"--vary {key}: appears twice; give all its values at once")
        values[key] = _values_in(text, given)
    runs = math.prod(len(each) for each in values.values())
    if runs > MAX_RUNS:
        raise ScenarioError(f"--vary: {runs} runs, more than {MAX_RUNS}; give fewer values")
    return Sweep(scenario, overrides, tuple(values), tuple(product(*values.values())))


def _values_in(text: str, given: str) -> tuple[str, ...]:
    """Return the values of a list ``3,5,8`` or of a range ``first:last:step``."""
    try:
        first, last, step = (Decimal(part) for part in given.split(":"))
    except (InvalidOperation, ValueError):
        found = tuple(part.strip() for part in given.split(","))
        if not all(found) or len(set(found)) < len(found):
            raise ScenarioError(f"--vary {text}: a value is empty or appears twice") from None
        return found
    if not (first.is_finite() and last.is_finite() and step.is_finite() and step > 0):
        raise ScenarioError(f"--vary {text}: give a range as FIRST:LAST:STEP with a positive step")
    if not first <= last:
        raise ScenarioError(f"--vary {text}: the first value is after the last; exchange them")
    count = int((last - first) / step) + 1
    if count > MAX_RUNS:
        raise ScenarioError(f"--vary {text}: {count} values, more than {MAX_RUNS}; give fewer")
    return tuple(str(first + place * step) for place in range(count))


def run_sweep(
    scenario: str, overrides: tuple[str, ...], varied: Sequence[str], folder: Path, run: Run
) -> dict[str, Any]:
    """Simulate the runs that are missing in a folder, write the tables, and return a summary.

    Each run is stored in a file in the folder ``runs``: the front at the end, with the results. If
    the command is stopped and repeated with the same scenario and values, only the missing runs are
    simulated.

    Args:
        scenario: A file or the name of a shipped scenario.
        overrides: Changes of keys, ``key=value``, for all runs.
        varied: The values of keys, ``KEY=VALUES`` (see ``sweep_of``).
        folder: An existing folder.
        run: Runs the tasks, see ``task_pool``.

    Raises:
        ScenarioError: A run's scenario is invalid, or a file cannot be written.
        MissionServiceError: The folder has runs of other settings, or the cluster failed.
    """
    check_command(folder, "fire sweep")
    sweep = sweep_of(scenario, overrides, varied)
    scenarios = [sweep.load(number) for number in range(len(sweep.values))]
    for each in scenarios:
        check_times(each)
    recipe = {"keys": sweep.keys, "values": sweep.values, **recipe_of(scenarios)}
    with writing(folder):
        results = results_folder(folder / "runs", recipe)
        with fire_progress(scenarios[0].name, 0, len(scenarios)) as progress:
            burned_now = complete(
                *(results, len(scenarios), SUFFIX),
                lambda absent: run(swept_run, absent, sweep),
                lambda text, path: path.write_text(text, encoding="utf-8"),
                progress,
            )
        features = [_read(numbered(results, n, SUFFIX)) for n in range(len(scenarios))]
        with whole_files(folder) as part:
            _write(part, features)
    areas_ha = [each["properties"]["area_ha"] for each in features]
    return {
        "scenario": scenarios[0].name,
        "runs": len(scenarios),
        "burned_now": burned_now,
        "min_area_ha": min(areas_ha),
        "max_area_ha": max(areas_ha),
    }


def swept_run(number: int, sweep: Sweep) -> str:
    """Return the result of one run as a GeoJSON feature (a worker's task)."""
    scenario = sweep.load(number)
    try:
        fire = fire_of(scenario, _landscape(scenario.landscape.model_dump_json()))
        fire.advance(scenario.duration_s)
    except (FireModelError, ScenarioError) as error:
        raise ScenarioError(f"run {number} ({sweep.label(number)}): {error}") from None
    collection = fronts_geojson(fire, [fire.time_s], scenario.name, scenario.time_zero)
    feature: dict[str, Any] = collection["features"][0]
    flame_m = behaviour_of(fire).flame_length_m[fire.burned()]
    feature["properties"] |= {
        "run": number,
        **dict(zip(sweep.keys, sweep.values[number], strict=True)),
        "burned_cells": flame_m.size,
        "mean_flame_length_m": round(float(np.mean(flame_m)), 3) if flame_m.size else 0.0,
        "max_flame_length_m": round(float(np.max(flame_m)), 3) if flame_m.size else 0.0,
        "reached_edge": at_edge(fire) is not None,
    }
    return json.dumps(feature) + "\n"


@lru_cache(maxsize=4)
def _landscape(section: str) -> Landscape:
    return landscape_in(LandscapeSection.model_validate_json(section))


def _read(path: Path) -> dict[str, Any]:
    with reading(path):
        feature: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return feature


def _write(folder: Path, features: list[dict[str, Any]]) -> None:
    collection = {"type": "FeatureCollection", "features": features}
    (folder / "fronts.geojson").write_text(json.dumps(collection) + "\n", encoding="utf-8")
    hidden = {"IncidentName", "FeatureCategory", "MapMethod", "FeatureStatus", "PolygonDateTime"}
    names = [name for name in features[0]["properties"] if name not in hidden]
    names.sort(key=lambda name: name != "run")  # the first column
    with (folder / "sweep.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, names, extrasaction="ignore", lineterminator="\n")
        table.writeheader()
        table.writerows(each["properties"] for each in features)
