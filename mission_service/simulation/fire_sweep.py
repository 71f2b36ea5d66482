"""Simulates a scenario's fire for all combinations of the values given for some keys."""

import csv
import json
import math
from collections.abc import Callable, Iterator, Sequence
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
from firemodel.spread.edge import BEYOND_EDGE, at_edge
from firemodel.spread.schemes import SCHEMES
from mission_service.config.fire_sections import LandscapeSection
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.errors import OptionError, ScenarioError
from mission_service.fire.scenario_fire import (
    check_fire,
    fire_of,
    landscape_in,
    require_fire,
    warnings_on,
)
from mission_service.runtime.progress import fire_progress
from mission_service.simulation.fire_alone import check_times, writing
from mission_service.simulation.result_files import (
    USED,
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
EFFECTIVE = USED - {"name", "time_zero", "ensemble"} | {"seed"}
RUNS_AT_EDGE = (
    f"the fire reached the edge of the landscape in {{count}} of {{runs}} runs; {BEYOND_EDGE}"
)
SUFFIX = ".geojson"


@dataclass(frozen=True)
class Sweep:
    """The runs of a sweep: a scenario with overrides, and the values of the keys in each run."""

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
        except OptionError as error:
            problem = str(error).removeprefix("--set")
            if problem.lstrip(": ").startswith(self.keys):
                raise OptionError(f"--vary{problem}") from None
            raise

    def label(self, number: int) -> str:
        """Return the keys and values of a run as text."""
        pairs = zip(self.keys, self.values[number], strict=True)
        return ", ".join(f"{key}={value}" for key, value in pairs)


def sweep_of(scenario: str, overrides: tuple[str, ...], varied: Sequence[str]) -> Sweep:
    """Return the sweep over all combinations of ``KEY=VALUES``; the last key varies fastest.

    Raises OptionError for malformed text, a key that appears twice, or too many runs.
    """
    values = {}
    for text in varied:
        key, equals, given = text.partition("=")
        if not (equals and key and given):
            raise OptionError(f"--vary {text}: write it as KEY=VALUES, e.g. fire.precise=true")
        if key in values:
            raise OptionError(f"--vary {key}: appears twice; list all its values in one --vary")
        values[key] = _values_in(text, given)
    runs = math.prod(len(each) for each in values.values())
    if runs > MAX_RUNS:
        raise OptionError(f"--vary: {runs} runs, more than {MAX_RUNS}; specify fewer values")
    return Sweep(scenario, overrides, tuple(values), tuple(product(*values.values())))


def _values_in(text: str, given: str) -> tuple[str, ...]:
    """Return the values in a list ``3,5,8`` or a range ``first:last:step``."""
    try:
        first, last, step = (Decimal(part) for part in given.split(":"))
    except (InvalidOperation, ValueError):
        found = _entries(text, given)
        if not all(found) or len(set(found)) < len(found):
            raise OptionError(f"--vary {text}: a value is empty or appears twice") from None
        return found
    if not (first.is_finite() and last.is_finite() and step.is_finite() and step > 0):
        raise OptionError(f"--vary {text}: write a range as FIRST:LAST:STEP with a positive step")
    if not first <= last:
        raise OptionError(f"--vary {text}: the first value is above the last; swap them")
    count = int((last - first) / step) + 1
    if count > MAX_RUNS:
        raise OptionError(f"--vary {text}: {count} values, more than {MAX_RUNS}; specify fewer")
    return tuple(str(first + place * step) for place in range(count))


def _entries(text: str, given: str) -> tuple[str, ...]:
    """Return the entries of a list, separated by commas outside quotes and brackets."""
    found, depth, quote = [""], 0, ""
    for each in given:
        if quote:
            quote = "" if each == quote else quote
        elif each in "\"'":
            quote = each
        else:
            depth += (each in "[{") - (each in "]}")
        if each == "," and not (depth or quote):
            found.append("")
        else:
            found[-1] += each
    if depth or quote:
        raise OptionError(f"--vary {text}: a quote or bracket is not closed; close it")
    return tuple(entry.strip() for entry in found)


def run_sweep(sweep: Sweep, folder: Path, run: Run, warn: Callable[[str], None]) -> dict[str, Any]:
    """Simulate the runs that are missing in a folder, write the tables, and return a summary.

    Each run is stored as one file in the folder ``runs``, with the front at the end of the run and
    the results. If the command is stopped and repeated with the same scenario and values, only the
    missing runs are simulated. The inputs of all runs are checked before the first run.

    Args:
        sweep: The scenario and the values of the keys in each run.
        folder: An existing folder.
        run: A function that runs tasks (``task_pool``).
        warn: A function that is called once with each warning about the inputs.

    Raises:
        ScenarioError: A run's scenario is invalid, or a file cannot be written.
        OptionError: A key has no effect on the fire, or a value is invalid.
        MissionServiceError: The folder contains runs with other settings, or the cluster failed.
    """
    check_command(folder, "fire sweep")
    scenarios = [sweep.load(number) for number in range(len(sweep.values))]
    _check_effects(sweep, scenarios)
    warnings = list(dict.fromkeys(_checked(sweep, scenarios)))
    for line in warnings:
        warn(line)
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
    at_edge_count = sum(each["properties"]["reached_edge"] for each in features)
    if at_edge_count:
        warnings.append(RUNS_AT_EDGE.format(count=at_edge_count, runs=len(features)))
        warn(warnings[-1])
    return {
        "scenario": scenarios[0].name,
        "runs": len(scenarios),
        "burned_now": burned_now,
        "min_area_ha": min(areas_ha),
        "max_area_ha": max(areas_ha),
        "warnings": warnings,
    }


def _check_effects(sweep: Sweep, scenarios: list[Scenario]) -> None:
    """Raise OptionError for a varied key that has no effect on the fire of any run."""
    used = {name for each in scenarios for name in SCHEMES[each.fire.scheme].settings}
    unused = {
        f"fire.{name}" for each in SCHEMES.values() for name in each.settings if name not in used
    }
    if all(each.fire.scheme != "probabilistic" for each in scenarios):
        unused.add("seed")
    for key in sweep.keys:
        if key.partition(".")[0] not in EFFECTIVE or key in unused:
            raise OptionError(f"--vary {key}: has no effect on these fires; remove it")


def _checked(sweep: Sweep, scenarios: list[Scenario]) -> Iterator[str]:
    """Check the inputs of all runs and yield all warnings, including repeated ones."""
    for number, scenario in enumerate(scenarios):
        try:
            check_times(scenario)
            landscape = _landscape(scenario.landscape.model_dump_json())
            require_fire(scenario)
            check_fire(scenario, landscape)
            yield from warnings_on(scenario, landscape)
        except (FireModelError, ScenarioError) as error:
            raise ScenarioError(f"run {number} ({sweep.label(number)}): {error}") from None


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
        properties = feature["properties"]
        if not (isinstance(properties["area_ha"], float) and "reached_edge" in properties):
            raise ValueError("no area_ha")
    return feature


def _write(folder: Path, features: list[dict[str, Any]]) -> None:
    collection = {"type": "FeatureCollection", "features": features}
    (folder / "fronts.geojson").write_text(json.dumps(collection) + "\n", encoding="utf-8")
    hidden = {"IncidentName", "FeatureCategory", "MapMethod", "FeatureStatus", "PolygonDateTime"}
    names = [name for name in features[0]["properties"] if name not in hidden]
    names.sort(key=lambda name: name != "run")  # ``run`` is the first column
    with (folder / "sweep.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, names, extrasaction="ignore", lineterminator="\n")
        table.writeheader()
        table.writerows(each["properties"] for each in features)
