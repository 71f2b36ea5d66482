"""Simulates a scenario's fire many times with random errors, and writes probabilities."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from firemodel.ensemble.draws import Draw, latin_draws
from firemodel.ensemble.member_fires import Start, Window, burned_windows
from firemodel.ensemble.products import (
    arrival_quantiles_s,
    burn_probability,
    mean_flame_length_m,
)
from firemodel.ensemble.uncertainty import Uncertainty
from firemodel.landscape.landscape import Landscape
from firemodel.outputs.arrival_map import area_in_words, draw_arrival, time_in_words
from firemodel.outputs.geotiff import write_raster
from firemodel.outputs.layer_legends import (
    FLAME_LENGTH_LAYER,
    PROBABILITY_LAYER,
    arrival_layer,
)
from firemodel.outputs.whole_file import write_whole
from firemodel.physics.weather import WeatherStream
from firemodel.spread.edge import BEYOND_EDGE, reaches_edge
from firemodel.spread.fire_scheme import Burning, Closing, Ignition, check_ignitions
from firemodel.spread.schemes import SchemeName, new_fire
from mission_service.config.scenario import Scenario
from mission_service.fire.scenario_fire import (
    burning_of,
    closings_of,
    ignitions_of,
    landscape_of,
    require_fire,
    settings_of,
    uncertainty_of,
    warnings_on,
    weather_of,
)
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

QUANTILES = (0.1, 0.5, 0.9)
SUFFIX = ".npz"
MEMBER_AT_EDGE = f"the fire of one or more members reached the edge of the landscape; {BEYOND_EDGE}"


@dataclass(frozen=True)
class Job:
    """The data for simulating members.

    Each worker receives the data once and computes the start state once.
    """

    landscape: Landscape
    weather: WeatherStream
    burning: Burning | None
    ignitions: tuple[Ignition, ...]
    closings: tuple[Closing, ...]
    scheme: SchemeName
    settings: dict[str, Any]
    uncertainty: Uncertainty
    seed: int
    count: int
    until_s: float

    @cached_property
    def start_state(self) -> Start:
        """The start state that all members share, without the ignitions."""
        fire = new_fire(
            self.scheme,
            self.landscape,
            self.weather,
            [],
            self.burning,
            seed=self.seed,
            closings=self.closings,
            **self.settings,
        )
        return Start(fire, self.ignitions)

    @cached_property
    def draws(self) -> list[Draw]:
        """The random errors of all members."""
        return latin_draws(self.uncertainty, self.seed, self.count, self.start_state.fuels)


def job_of(scenario: Scenario, count: int) -> Job:
    """Return the job that simulates ``count`` members of a scenario's fire.

    Raises ScenarioError or FireModelError for a fire that cannot burn.
    """
    check_times(scenario)
    landscape = landscape_of(scenario)
    require_fire(scenario)
    burning, ignitions = burning_of(scenario, landscape), ignitions_of(scenario, landscape)
    check_ignitions(landscape, ignitions, burning.at_s if burning else 0.0)
    return Job(
        landscape,
        weather_of(scenario),
        burning,
        tuple(ignitions),
        tuple(closings_of(scenario, landscape)),
        scenario.fire.scheme,
        settings_of(scenario),
        uncertainty_of(scenario),
        scenario.seed,
        count,
        scenario.duration_s,
    )


def burned_member(number: int, job: Job) -> Window:
    """Return the result of one member of a job (a worker's task)."""
    return next(burned_windows(job.start_state, job.draws, [number], job.until_s, job.seed))


def run_members(
    scenario: Scenario, folder: Path, count: int, run: Run, warn: Callable[[str], None]
) -> dict[str, Any]:
    """Simulate the members that are missing in a folder, write the maps, and return the summary.

    Each member is stored in a file in the folder ``members``. If the command is stopped and
    repeated with the same scenario, only the missing members are simulated.

    Args:
        scenario: The scenario; its table [ensemble] defines the distributions of the errors.
        folder: An existing folder.
        count: The number of members.
        run: A function that runs tasks (``task_pool``).
        warn: A function that is called with each warning about the inputs.

    Raises:
        ScenarioError: No fire starts before the scenario's end, or a file cannot be written.
        MissionServiceError: The folder contains members with other settings, or the cluster failed.
    """
    check_command(folder, "fire run --members")
    job = job_of(scenario, count)
    warnings = warnings_on(scenario, job.landscape)
    for line in warnings:
        warn(line)
    with writing(folder):
        results = results_folder(folder / "members", {"members": count, **recipe_of([scenario])})
        with fire_progress(scenario.name, 0, count) as progress:
            complete(
                *(results, count, SUFFIX),
                lambda absent: run(burned_member, absent, job),
                _save,
                progress,
            )
        windows = list(_read(results, count, job.landscape.shape))
        with whole_files(folder) as part:
            summary = _write(scenario, job, windows, part)
            if summary["reached_edge"]:
                warnings.append(MEMBER_AT_EDGE)
                warn(MEMBER_AT_EDGE)
            summary["warnings"] = warnings
            write_whole(part / "summary.json", json.dumps(summary, indent=2) + "\n")
            return summary


def _save(window: Window, path: Path) -> None:
    np.savez(path, corner=[window.top, window.left], after_s=window.after_s, flame_m=window.flame_m)


def _read(folder: Path, count: int, shape: tuple[int, ...]) -> Iterator[Window]:
    for number in range(count):
        path = numbered(folder, number, SUFFIX)
        with reading(path), path.open("rb") as raw, np.load(raw) as file:
            top, left = file["corner"].tolist()
            window = Window(top, left, file["after_s"], file["flame_m"])
            if not _fits(window, shape):
                raise ValueError("its cells are not on the landscape")
        yield window


def _fits(window: Window, shape: tuple[int, ...]) -> bool:
    """Return whether a window lies within a landscape of this shape."""
    rows, cols = window.after_s.shape
    inside = min(window.top, window.left) >= 0
    inside = inside and window.top + rows <= shape[0] and window.left + cols <= shape[1]
    return inside and window.flame_m.shape == window.after_s.shape


def _write(scenario: Scenario, job: Job, windows: list[Window], folder: Path) -> dict[str, Any]:
    land, shape = job.landscape, job.landscape.shape
    start_s = job.burning.at_s if job.burning else 0.0
    probability = burn_probability(windows, shape, job.until_s - start_s).astype(np.float32)
    arrival_s = start_s + arrival_quantiles_s(windows, shape, QUANTILES)
    write_raster(folder / "burn_probability.tif", probability, land, PROBABILITY_LAYER)
    for share, time_s in zip(QUANTILES, arrival_s, strict=True):
        what = f"time by which the cell has burned in {100 * share:.0f} % of the members"
        layer = arrival_layer(start_s, job.until_s, scenario.time_zero, what)
        write_raster(folder / f"arrival_time_p{100 * share:.0f}_s.tif", time_s, land, layer)
    flame_layer = FLAME_LENGTH_LAYER._replace(
        description="mean flame length of the members in which fire reaches the cell"
    )
    flame_m = mean_flame_length_m(windows, shape)
    write_raster(folder / "flame_length_m.tif", flame_m, land, flame_layer)
    median_s = arrival_s[QUANTILES.index(0.5)].astype(np.float64)
    title = f"{scenario.name}: cells that burn in at least half of {job.count} members"
    area = area_in_words(np.count_nonzero(np.isfinite(median_s)) * land.cell_size_m**2)
    line = f"{time_in_words(job.until_s, scenario.time_zero)} · {area}"
    draw_arrival(folder / "map.png", land, median_s, title, line, layer)
    cell_ha = land.cell_size_m**2 / 1e4
    areas_ha = [np.count_nonzero(np.isfinite(w.after_s)) * cell_ha for w in windows]
    p10, p50, p90 = np.quantile(areas_ha, QUANTILES)
    return {
        "scenario": scenario.name,
        "scheme": job.scheme,
        "members": job.count,
        "seed": job.seed,
        "cells": land.fuel_model.size,
        "burned_area_mean_ha": round(float(np.mean(areas_ha)), 2),
        "burned_area_p10_ha": round(float(p10), 2),
        "burned_area_p50_ha": round(float(p50), 2),
        "burned_area_p90_ha": round(float(p90), 2),
        "reached_edge": reaches_edge(probability > 0.0),
        "time_s": job.until_s,
    }
