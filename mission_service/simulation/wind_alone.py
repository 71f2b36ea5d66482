"""Computes the wind over a scenario's terrain and writes it to files."""

import csv
import json
import math
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape
from firemodel.outputs.geotiff import write_raster
from firemodel.outputs.layer_legends import WIND_FROM_LAYER, WIND_SPEED_LAYER
from firemodel.outputs.whole_file import remove_parts, write_whole
from firemodel.physics.sunlight import sun_at
from firemodel.wind import (
    REFERENCE_M,
    FittedWind,
    MeasuredWind,
    TerrainWind,
    fit_wind,
    free_wind,
    local_wind,
    slope_flow,
    slope_wind,
    sunlit_flux_w_m2,
    wind_of_landscape,
)
from mission_service.config.scenario import Scenario
from mission_service.errors import ScenarioError
from mission_service.fire.scenario_fire import landscape_of, station_of, weather_of
from mission_service.simulation.fire_alone import writing
from mission_service.simulation.result_files import check_command

COLUMNS = ("lat_deg", "lon_deg", "above_ground_m", "speed_m_s", "from_deg")
SD_COLUMN = "sd_m_s"
NO_VALUE = -9999


class GivenWind(NamedTuple):
    """The source of the wind: speed and direction, measurements, or else the scenario's weather."""

    speed_m_s: float | None = None
    from_deg: float | None = None  # clockwise from true north
    measured: Path | None = None
    at_s: float | None = None
    slope_flow: bool = False  # add the slope flow due to sunlight at at_s


def run_wind(scenario: Scenario, folder: Path, given: GivenWind) -> dict[str, Any]:
    """Write the wind 20 ft above the vegetation and a summary to a folder; return the summary.

    Raises ScenarioError for a measurement file that cannot be used or a folder that cannot be
    written to, and FireModelError for a landscape without elevation.
    """
    check_command(folder, "fire wind")
    if given.slope_flow and scenario.time_zero is None:
        raise ScenarioError(
            f"{scenario.name}: --slope-flow needs time_zero, the calendar time of mission time 0"
        )
    landscape = landscape_of(scenario)
    measured = [] if given.measured is None else read_measured(given.measured, landscape)
    with ThreadPoolExecutor(2) as threads:  # the kernels release the GIL
        terrain = wind_of_landscape(landscape, threads.map)
    responses = terrain.responses(REFERENCE_M)
    about: dict[str, Any] = {}
    if measured:
        fitted = fit_wind(terrain, measured)
        wind, free = fitted.wind_of_cells(responses), fitted.mean
        about = _about_fit(terrain, measured, fitted)
    else:
        free = _free_wind(scenario, given, landscape, responses)
        wind = np.einsum("r,rcyx->cyx", free.astype(np.float32), responses)
    if given.slope_flow:
        flow = _slope_wind(scenario, landscape, terrain, given.at_s or 0.0)
        about |= {"slope_flow_m_s": _range_of(np.hypot(*flow))}
        wind = wind + flow
    speed, free_m_s = np.hypot(*wind), float(np.hypot(*free))
    from_deg = landscape.true_deg(math.degrees(math.atan2(-free[1], -free[0])))
    summary = {
        "scenario": scenario.name,
        "cells": int(speed.size),
        "solved_cell_size_m": terrain.grid.cell_m,
        "divergence": terrain.divergence,
        "steps": terrain.steps,
        "free_wind": {"speed_m_s": round(free_m_s, 3), "from_deg": round(from_deg % 360.0, 2)},
        **about,
        "speed_m_s": _range_of(speed),
        "speed_up": _range_of(speed / free_m_s) if free_m_s > 0.0 else None,
    }
    with writing(folder):
        remove_parts(folder)
        write_wind(folder, wind, landscape)
        write_whole(folder / "summary.json", json.dumps(summary, indent=2) + "\n")
    return summary


def write_wind(folder: Path, wind: NDArray[np.floating], landscape: Landscape) -> None:
    """Write the wind (2, y, x) towards grid north and east as GeoTIFFs and in WindNinja's format.

    The GeoTIFFs contain the direction from true north, the ASCII grids that from grid north.
    """
    north, east = wind
    speed = np.hypot(north, east)
    from_deg = np.rad2deg(np.arctan2(-east, -north)) % 360.0
    write_raster(folder / "wind_speed.tif", speed, landscape, WIND_SPEED_LAYER)
    true_deg = landscape.true_deg(from_deg) % 360.0
    write_raster(folder / "wind_from.tif", true_deg, landscape, WIND_FROM_LAYER)
    for name, values, form in (("wind_vel", speed, "%.3f"), ("wind_ang", from_deg, "%.1f")):
        write_whole(folder / f"{name}.asc", _ascii_grid(values, landscape, form))
        write_whole(folder / f"{name}.prj", _projection(landscape.crs) + "\n")


def _ascii_grid(values: NDArray[np.floating], landscape: Landscape, form: str) -> str:
    rows, cols = values.shape
    head = (
        f"ncols {cols}\nnrows {rows}\n"
        f"xllcorner {landscape.west_m!r}\nyllcorner {landscape.south_m!r}\n"
        f"cellsize {landscape.cell_size_m!r}\nNODATA_value {NO_VALUE}\n"
    )
    line = " ".join([form] * cols)
    return head + "".join(f"{line % tuple(row)}\n" for row in values.tolist())


def _projection(crs: str) -> str:
    from pyproj import CRS

    return CRS.from_user_input(crs).to_wkt("WKT1_ESRI")


def _range_of(values: NDArray[np.floating]) -> dict[str, float]:
    found = {"min": values.min(), "mean": values.mean(dtype=np.float64), "max": values.max()}
    return {name: round(float(value), 3) for name, value in found.items()}


def _free_wind(
    scenario: Scenario, given: GivenWind, landscape: Landscape, responses: NDArray[np.float32]
) -> Floats:
    """Return the free wind (2) that results in the stated wind at the station, if any.

    The stated wind is that of the command, or otherwise that of the weather."""
    if given.speed_m_s is not None and given.from_deg is not None:
        speed_m_s, true_deg = given.speed_m_s, given.from_deg
    else:
        entry = weather_of(scenario).weather_at(given.at_s or 0.0)
        speed_m_s, true_deg = entry.wind_speed_m_s, entry.wind_from_deg
    wind = _vector(speed_m_s, landscape.grid_deg(true_deg))
    station = station_of(scenario, landscape)
    return wind if station is None else free_wind(responses, *station, wind)


def _slope_wind(
    scenario: Scenario, landscape: Landscape, terrain: TerrainWind, at_s: float
) -> NDArray[np.float32]:
    assert scenario.time_zero is not None
    temperature_c = scenario.fire.air_temperature_c
    sun = sun_at(*landscape.centre_lat_lon, scenario.time_zero, np.array([at_s]))
    flux = sunlit_flux_w_m2(terrain.grid, sun, landscape.grid_convergence_deg, temperature_c)
    return slope_wind(terrain, slope_flow(terrain.grid, flux, temperature_c), REFERENCE_M)


def _about_fit(
    terrain: TerrainWind, measured: list[MeasuredWind], fitted: FittedWind
) -> dict[str, Any]:
    """Return the errors of a fit at the measurement sites, and of fits without each site."""
    left_out = []
    for number, each in enumerate(measured) if len(measured) > 1 else ():
        others = [*measured[:number], *measured[number + 1 :]]
        mean = np.mean([_vector(other.speed_m_s, other.from_deg) for other in others], axis=0)
        local = _vector(each.speed_m_s, each.from_deg)
        left_out.append((_error(terrain, fit_wind(terrain, others), each), mean - local))
    about = {"measurements": len(measured)}
    errors = {"rms_error_m_s": [_error(terrain, fitted, each) for each in measured]}
    if left_out:
        errors["left_out_rms_error_m_s"] = [error for error, _ in left_out]
        errors["left_out_rms_error_of_mean_m_s"] = [error for _, error in left_out]
    return about | {name: _rms(found) for name, found in errors.items()}


def _error(terrain: TerrainWind, fitted: FittedWind, each: MeasuredWind) -> NDArray[np.floating]:
    place = (np.array([value]) for value in (each.row, each.col, each.above_ground_m))
    return fitted.wind_at(terrain, *place)[:, 0] - _vector(each.speed_m_s, each.from_deg)


def _vector(speed_m_s: float, from_deg: float) -> Floats:
    """Return a wind vector (2) towards north and east."""
    return np.asarray(local_wind(np.eye(2), speed_m_s, from_deg), dtype=np.float64)


def _rms(errors: list[NDArray[np.floating]]) -> float:
    return round(float(np.sqrt(np.mean([error @ error for error in errors]))), 3)


def read_measured(path: Path, landscape: Landscape) -> list[MeasuredWind]:
    """Return the measurements in a CSV file with the columns ``COLUMNS``, and optionally sd_m_s.

    Directions in the file are clockwise from true north. Raises ScenarioError for a file that
    cannot be read, and for a missing column, value or measurement; the message names the line.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ScenarioError(f"{path}: cannot be read as CSV: {error}") from None
    if not rows:
        raise ScenarioError(
            f"{path}: contains no measurements; the columns are {', '.join(COLUMNS)}"
        )
    return [_measured(f"{path}, line {line}", row, landscape) for line, row in enumerate(rows, 2)]


def _measured(where: str, row: dict[str, str | None], landscape: Landscape) -> MeasuredWind:
    values = []
    for name in (*COLUMNS, *([SD_COLUMN] if row.get(SD_COLUMN) else [])):
        text = row.get(name)
        try:
            value = float(text or "")
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise ScenarioError(f"{where}: {name} = {text!r}; this column must contain a number")
        values.append(value)
    lat_deg, lon_deg, above_m, speed_m_s, from_deg, *sd = values
    x_m, y_m = landscape.xy_of_lat_lon(lat_deg, lon_deg)
    if not landscape.contains(x_m, y_m):
        raise ScenarioError(f"{where}: lat {lat_deg}, lon {lon_deg} is outside the landscape")
    row_at, col_at = landscape.row_col_of(x_m, y_m)
    grid_deg = landscape.grid_deg(from_deg)
    return MeasuredWind(float(row_at), float(col_at), above_m, speed_m_s, grid_deg, *sd)
