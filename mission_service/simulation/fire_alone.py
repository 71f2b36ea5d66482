"""Simulates a scenario's fire without vehicles and writes the results to files."""

import json
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from firemodel.arrays import Floats
from firemodel.outputs.arrival_map import draw_map
from firemodel.outputs.front_files import write_fronts
from firemodel.outputs.geotiff import write_raster, write_rasters
from firemodel.outputs.layer_legends import WARM_HEIGHT_LAYER
from firemodel.outputs.netcdf import check_netcdf, write_netcdf
from firemodel.outputs.whole_file import remove_parts, write_whole
from firemodel.physics.plume import warm_height_m
from firemodel.spread.behaviour import behaviour_of
from firemodel.spread.edge import at_edge
from firemodel.spread.fire_scheme import Fire
from mission_service.config.scenario import Scenario
from mission_service.errors import ScenarioError
from mission_service.fire.scenario_fire import fire_of, landscape_of, warnings_on
from mission_service.runtime.progress import fire_progress
from mission_service.simulation.result_files import check_command

STEPS = 200  # number of progress reports in a run
MAX_FRONTS = 10_000
WARM_HEIGHT = "warm_height_m.tif"


def run_fire(
    scenario: Scenario,
    folder: Path,
    front_every_s: float,
    warn: Callable[[str], None],
    netcdf: bool = False,
) -> dict[str, Any]:
    """Write the rasters, fronts, map and summary to a folder, and return the summary.

    ``warn`` is called with each warning as soon as the cause is found. If ``netcdf`` is True,
    fire.nc is also written, with the state of the fire at the times of the fronts.

    Raises ScenarioError if no fire starts before the scenario's end, for more than ``MAX_FRONTS``
    fronts, or for a folder that cannot be written to.
    """
    if netcdf:
        check_netcdf()
    check_times(scenario)
    check_command(folder, "fire run")
    landscape = landscape_of(scenario)
    fire = fire_of(scenario, landscape)
    start_s = fire.time_s
    times_s = _times_s(start_s, scenario.duration_s, front_every_s)
    lines = warnings_on(scenario, landscape)
    for line in lines:
        warn(line)
    with fire_progress(scenario.name, start_s, scenario.duration_s) as progress:
        for time_s in np.linspace(start_s, scenario.duration_s, STEPS + 1)[1:]:
            fire.advance(float(time_s))
            progress(float(time_s))
    if (reached := at_edge(fire)) is not None:
        lines.append(str(reached))
        warn(str(reached))
    warm_m = warm_heights_m(fire, scenario.mission.max_warming_k)
    for line in heat_warnings(scenario, warm_m):
        lines.append(line)
        warn(line)
    with writing(folder):
        remove_parts(folder)
        path = folder / "fire.nc"
        path.unlink(missing_ok=True)  # the file from an earlier run
        if netcdf:
            write_netcdf(path, fire, times_s, scenario.name, scenario.time_zero)
        for suffix in (".tif", ".qml"):  # the files from an earlier run
            (folder / WARM_HEIGHT).with_suffix(suffix).unlink(missing_ok=True)
        if warm_m is not None:
            write_raster(folder / WARM_HEIGHT, warm_m, landscape, WARM_HEIGHT_LAYER)
        return _write(scenario, fire, folder, times_s, lines)


def warm_heights_m(fire: Fire, max_warming_k: float | None) -> Floats | None:
    """Return the height (y, x) up to which the front warms the air by more than a limit.

    The height is in m above the ground, in calm air, which gives an upper limit. Unburned cells are
    NaN. Without a limit, the result is None.
    """
    if max_warming_k is None:
        return None
    return warm_height_m(behaviour_of(fire).intensity_kw_m, 0.0, max_warming_k)


def heat_warnings(scenario: Scenario, warm_m: Floats | None) -> list[str]:
    """Return a warning for each vehicle whose altitude is in warm air above some cells."""
    if warm_m is None or not (warm_m > 0.0).any():
        return []
    limit_k, highest_m = scenario.mission.max_warming_k, float(np.nanmax(warm_m))
    found = []
    for vehicle in scenario.vehicles:
        cells = int(np.count_nonzero(warm_m > vehicle.altitude_agl_m))
        if cells:
            found.append(
                f"{vehicle.name}: altitude_agl_m = {vehicle.altitude_agl_m:g}: the air above "
                f"{cells} of {np.count_nonzero(warm_m > 0.0)} burned cells is more than "
                f"{limit_k:g} K warmer when the front is there, "
                f"up to {highest_m:.0f} m above the ground"
            )
    return found


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
    """Return the times of the fronts to write: every ``every_s`` from the start, and the end."""
    count = max(math.ceil((end_s - start_s) / every_s - 1e-9), 1)
    if count > MAX_FRONTS:
        raise ScenarioError(
            f"--front-every {every_s:g} gives {count} fronts until {end_s:g} s, more than "
            f"{MAX_FRONTS}; specify {math.ceil((end_s - start_s) / MAX_FRONTS)} or more"
        )
    return [start_s + number * every_s for number in range(1, count)] + [end_s]


def _write(
    scenario: Scenario, fire: Fire, folder: Path, times_s: list[float], warnings: list[str]
) -> dict[str, Any]:
    landscape = fire.landscape
    write_rasters(folder, fire, scenario.time_zero)
    write_fronts(folder / "fronts.geojson", fire, times_s, scenario.name, scenario.time_zero)
    title = f"{scenario.name}: {scenario.fire.scheme}"
    draw_map(folder / "map.png", fire, title, scenario.time_zero)
    summary = {
        "scenario": scenario.name,
        "scheme": scenario.fire.scheme,
        "cells": landscape.fuel_model.size,
        "burned_cells": int(np.count_nonzero(fire.burned())),
        "burned_area_ha": round(fire.front(fire.time_s).area / 1e4, 2),
        "interpolated_area_ha": round(fire.interpolated_ha, 2),
        "reached_edge": at_edge(fire) is not None,
        "time_s": fire.time_s,
        "warnings": warnings,
        "time_zero": scenario.time_zero and scenario.time_zero.isoformat(),
    }
    write_whole(folder / "summary.json", json.dumps(summary, indent=2) + "\n")
    return summary
