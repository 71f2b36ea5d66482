"""Forecasts each mapped perimeter of a fire from earlier perimeters, and scores the forecasts."""

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from firemodel.arrays import Floats, Mask
from firemodel.assimilation.estimate_forecast import likely_area
from firemodel.assimilation.fire_estimate import FireEstimate
from firemodel.assimilation.observation import BURNED, Observation, mapped_perimeter
from firemodel.assimilation.scores import coverage, critical_success, mean_distance_m, overlap
from firemodel.ensemble.member_fires import Each
from firemodel.errors import FireModelError
from firemodel.input_warnings import time_zero_warnings
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.readers.perimeter_files import Perimeter, read_perimeters
from firemodel.landscape.readers.shapes import box_of
from firemodel.outputs.geotiff import write_raster
from firemodel.outputs.layer_legends import PROBABILITY_LAYER
from firemodel.outputs.whole_file import write_whole
from firemodel.physics.weather import WeatherStream
from firemodel.spread.burning import burning_from_perimeter
from firemodel.spread.front import front_polygons
from mission_service.config.scenario import Scenario
from mission_service.errors import ScenarioError
from mission_service.fire.run_ensemble import new_estimate
from mission_service.fire.scenario_fire import (
    ignitions_of,
    landscape_of,
    weather_of,
)
from mission_service.runtime.progress import fire_progress
from mission_service.simulation.fire_alone import writing
from mission_service.simulation.forecast_picture import draw_forecast
from mission_service.simulation.result_files import check_command, whole_files

GROWN = 1.1  # minimum ratio of the areas of two perimeters of a growing fire
AHEAD_H = (1, 3, 6)  # lead times of the forecasts from the last perimeter
MAX_PICTURES = 40


class Step(NamedTuple):
    """One forecast from a perimeter to the next, and both perimeters as observed."""

    before: Observation
    after: Observation
    probability: Floats  # (y, x) the forecast burn probability
    likely: Mask  # (y, x) the forecast burned area
    free: Mask  # (y, x) the area burned in the model without assimilation


def assimilate(
    scenario: Scenario,
    observations: Path,
    folder: Path | None,
    threads: int,
    warn: Callable[[str], None],
) -> dict[str, Any]:
    """Process the perimeters of a file or folder one by one, and return scores of all forecasts.

    Each forecast uses only perimeters that are not later than the start of the forecast. The fire
    starts at the scenario's ignition, or without an ignition from the first perimeter.

    Args:
        scenario: The scenario: landscape, weather, [ensemble], [estimate].
        observations: A file or a folder of perimeters with their times (``read_perimeters``).
        folder: An existing folder for pictures, GeoTIFFs and the summary; None to write nothing.
        threads: The number of threads.
        warn: A function that is called with each warning.

    Raises:
        ScenarioError: The spread scheme is not ``anyangle``, or the ignitions have no date.
        FireModelError: No perimeter can be used.
    """
    if scenario.fire.scheme != "anyangle":
        raise ScenarioError(
            f"{scenario.name}: fire.scheme = {scenario.fire.scheme}: an estimate requires anyangle"
        )
    if folder is not None:
        check_command(folder, "fire assimilate")
    landscape = landscape_of(scenario)
    zone = scenario.time_zero.tzinfo if scenario.time_zero else None
    perimeters, warnings = read_perimeters(observations, landscape, zone or UTC)
    zero = scenario.time_zero or perimeters[0].at
    weather = weather_of(scenario)
    warnings += _warnings(scenario, perimeters, zero, weather)
    for line in warnings:
        warn(line)
    observed = list(_observations(scenario, landscape, perimeters, zero))
    with ThreadPoolExecutor(threads) as pool:
        estimate = new_estimate(scenario, landscape, weather)
        steps: list[Step] = []
        intervals = []
        with fire_progress(scenario.name, 0, len(observed)) as progress:
            for step in _steps(estimate, observed, pool.map, warnings, warn):
                if folder is not None and len(steps) < MAX_PICTURES:
                    steps.append(step)
                intervals.append(_scores(step, landscape, zero))
                progress(len(intervals))
        if not estimate.begun or (scenario.ignition and not intervals):
            raise FireModelError(f"{observations}: contains no usable perimeter; see the warnings")
        if not intervals and len(perimeters) > 1:
            warnings.append(
                f"{observations}: no perimeter agrees with the first, {perimeters[0].source}; if "
                f"the first is wrong, remove it"
            )
            warn(warnings[-1])
        forecast = estimate.forecast(estimate.time_s + AHEAD_H[-1] * 3600.0, pool.map)
    ahead = {hours: forecast.burn_probability(forecast.at_s + hours * 3600.0) for hours in AHEAD_H}
    cell_ha = landscape.cell_size_m**2 / 1e4
    summary = {
        "scenario": scenario.name,
        "members": scenario.estimate.members,
        "perimeters": len(perimeters),
        **_all_means(intervals),
        "expected_ha_after_last": {
            f"{hours}_h": round(float(probability.sum() * cell_ha), 1)
            for hours, probability in ahead.items()
        },
        "intervals": intervals,
        "warnings": warnings,
    }
    if folder is not None:
        with writing(folder), whole_files(folder) as part:
            _draw(steps, landscape, scenario.name, zero, part)
            _write_ahead(ahead, landscape, part)
            write_whole(part / "assimilation.json", json.dumps(summary, indent=2) + "\n")
            for picture in folder.glob("forecast_*.png"):  # pictures from an earlier run
                if not (part / picture.name).exists():
                    picture.unlink()
    return summary


def _warnings(
    scenario: Scenario, perimeters: Sequence[Perimeter], zero: datetime, weather: WeatherStream
) -> list[str]:
    """Return warnings about inputs that are not used, and about dates that are inconsistent."""
    lines = [
        f"{scenario.name}: fire.{key} is not used; the fire begins with the ignition or the first "
        "perimeter"
        for key in ("perimeter", "arrival")
        if getattr(scenario.fire, key) is not None
    ]
    early = sum(each.at < zero for each in perimeters)
    if early:
        lines.append(
            f"{scenario.name}: {early} of {len(perimeters)} perimeters are before time_zero = "
            f"{zero.isoformat()}, from which the weather is known; correct time_zero"
        )
    return [*lines, *time_zero_warnings(weather, zero)]


def _observations(
    scenario: Scenario, landscape: Landscape, perimeters: Sequence[Perimeter], zero: datetime
) -> Iterator[Observation]:
    """Yield any ignition and then the perimeters, each with its mission time."""
    if scenario.ignition and scenario.time_zero is None:
        raise ScenarioError(
            f"{scenario.name}: without time_zero (the date of mission time 0) the ignition has no "
            f"date; set time_zero, or remove the ignition"
        )
    error_m = scenario.estimate.perimeter_error_m
    if scenario.ignition:
        cells = ignitions_of(scenario, landscape)
        at_s = max(each[2] for each in cells)
        area = shapely.union_all([_square(landscape, row, col) for row, col, _ in cells])
        yield mapped_perimeter(area, landscape, at_s, error_m, "ignition")
    for each in perimeters:
        at_s = (each.at - zero).total_seconds()
        found = mapped_perimeter(each.area, landscape, at_s, error_m, each.source)
        yield found._replace(area=_inside(each.area, landscape))


def _inside(area: BaseGeometry, landscape: Landscape) -> BaseGeometry:
    """Return the part of an area that is on the landscape, where the fires are compared."""
    box = box_of(landscape)
    if box.covers(area):
        return area
    parts = shapely.get_parts(area.intersection(box))
    return shapely.MultiPolygon([part for part in parts if part.geom_type == "Polygon"])


def _square(landscape: Landscape, row: int, col: int) -> BaseGeometry:
    x_m, y_m = (float(value) for value in landscape.xy_of(row, col))
    return shapely.Point(x_m, y_m).buffer(landscape.cell_size_m / 2, cap_style="square")


def _steps(
    estimate: FireEstimate,
    observed: Sequence[Observation],
    each: Each,
    warnings: list[str],
    warn: Callable[[str], None],
) -> Iterator[Step]:
    """Forecast and assimilate the observations, except those that contradict the fire."""
    before: Observation | None = None
    for after in observed:
        step = None
        if before is not None and after.at_s > before.at_s:
            forecast = estimate.forecast(after.at_s, each)
            start = burning_from_perimeter([before.area], estimate.landscape, before.at_s)
            free = estimate.model.restarted(start)
            free.advance(after.at_s)
            probability = forecast.burn_probability(after.at_s)
            step = Step(before, after, probability, likely_area(probability), free.burned())
        try:
            estimate.assimilate(after, each)
        except FireModelError as error:
            warnings.append(f"{error}; it is skipped")
            warn(warnings[-1])
            continue
        before = after
        if step is not None:
            yield step


def _scores(step: Step, landscape: Landscape, zero: datetime) -> dict[str, Any]:
    """Return the scores of one forecast, of persistence and of the model alone."""
    before, after, probability, likely, free = step
    burned, observed = before.state == BURNED, after.state == BURNED
    cell_ha = landscape.cell_size_m**2 / 1e4

    def distance(mask: Mask) -> float:
        # The outline follows the cell edges.
        area = front_polygons(np.where(mask, 0.0, 1.0), 0.5, landscape)
        return round(mean_distance_m(area, after.area), 1)

    return {
        "from": (zero + timedelta(seconds=before.at_s)).isoformat(),
        "to": (zero + timedelta(seconds=after.at_s)).isoformat(),
        "from_s": before.at_s,
        "to_s": after.at_s,
        "observed_ha": round(after.area.area / 1e4, 1),
        "new_ha": round(np.count_nonzero(observed & ~burned) * cell_ha, 1),
        "new_ha_estimate": round(np.count_nonzero(likely & ~burned) * cell_ha, 1),
        "iou_estimate": round(overlap(likely, observed), 4),
        "iou_free": round(overlap(free, observed), 4),
        "iou_persistence": round(overlap(burned, observed), 4),
        "new_area_csi_estimate": _rounded(critical_success(burned, likely, observed)),
        "new_area_csi_free": _rounded(critical_success(burned, free, observed)),
        "mean_distance_m_estimate": distance(likely),
        "mean_distance_m_free": distance(free),
        "mean_distance_m_persistence": round(mean_distance_m(before.area, after.area), 1),
        "coverage_80": _rounded(coverage(probability, observed)),
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)


def _all_means(intervals: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the means of the scores over all intervals, and over three subsets of them."""
    growing = [each for each in intervals if each["iou_persistence"] < 1.0 / GROWN]
    standing = [each for each in intervals if each["iou_persistence"] >= 1.0 / GROWN]
    return {
        "mean": _means(intervals),
        "mean_after_first": _means(intervals[1:]),
        "mean_growing": _means(growing),
        "mean_standing": _means(standing),
    }


def _means(intervals: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the number of intervals and the mean of each score over the intervals."""
    names = ("iou_", "new_area_csi_", "mean_distance_m_", "coverage_")
    found: dict[str, Any] = {"intervals": len(intervals)}
    for key in intervals[0] if intervals else ():
        values = [each[key] for each in intervals if each[key] is not None]
        if key.startswith(names) and values:
            found[key] = round(float(np.mean(values)), 4)
    return found


def _draw(
    steps: Sequence[Step], landscape: Landscape, name: str, time_zero: datetime, folder: Path
) -> None:
    """Draw a picture of each of the first forecasts."""
    for number, step in enumerate(steps, start=1):
        draw_forecast(folder / f"forecast_{number:02}.png", landscape, step, name, time_zero)


def _write_ahead(ahead: dict[int, Floats], landscape: Landscape, folder: Path) -> None:
    """Write the burn probability (y, x) some hours after the last perimeter as GeoTIFFs."""
    for hours, probability in ahead.items():
        layer = PROBABILITY_LAYER._replace(
            description=f"probability that the cell has burned {hours} h after the last perimeter"
        )
        values = probability.astype(np.float32)
        write_raster(folder / f"burn_probability_{hours}h.tif", values, landscape, layer)
