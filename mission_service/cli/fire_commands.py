"""Defines ``mission-service fire`` and ``bench``, which use only the fire model.

Heavy modules are imported only when a command runs.
"""

import json
import os
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import click

from mission_service.cli.options import (
    JSON,
    OUT_FOLDER,
    OVERRIDE,
    Cores,
    FiniteRange,
    Folder,
    cores_option,
    echo,
    echo_warning,
    is_given,
    refuse_given,
    seconds_option,
)
from mission_service.cli.output_folder import results_in

MAX_RUNS = 100_000
SCORED = ("estimate", "free", "persistence")


@click.group()
def fire() -> None:
    """Use the fire model alone, without vehicles."""


@fire.command("run")
@click.argument("scenario")
@OUT_FOLDER
@click.option(
    "--front-every",
    "front_every_s",
    type=FiniteRange(min=1.0),
    default=3600.0,
    show_default=True,
    help="Seconds between two fronts in the output.",
)
@click.option("--netcdf", is_flag=True, help="Also write fire.nc (NetCDF, CF conventions).")
@click.option(
    "--members",
    type=click.IntRange(1, MAX_RUNS),
    metavar="N",
    help="Simulate N times with random errors ([ensemble]); write probabilities, not fronts.",
)
@cores_option("threads")
@OVERRIDE
@JSON
def fire_run(
    scenario: str,
    out: Path,
    front_every_s: float,
    netcdf: bool,
    members: int | None,
    cores: Cores,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Simulate the fire of SCENARIO; write GeoTIFFs, fronts, a map and a summary to DIR.

    The fronts are GeoJSON and KML. QGIS applies the styles (.qml) beside the files.

    With --members, the GeoTIFFs are the burn probability, arrival times and the flame length. After
    an interruption, repeat the command, which then simulates only members missing in DIR/members.
    """
    from mission_service.config.scenario import load_scenario
    from mission_service.simulation.fire_alone import run_fire

    if members is None:
        refuse_given("workers", "scheduler", reason="without --members")
    else:
        refuse_given("front_every_s", "netcdf", reason="with --members")
    loaded = load_scenario(scenario, overrides)
    if members is None:
        with results_in(out, "repeat the command") as made:
            summary = run_fire(loaded, made, front_every_s, echo_warning, netcdf)
        written = "GeoTIFFs, fronts (GeoJSON, KML), map.png and summary.json"
    else:
        from mission_service.simulation.fire_members import run_members
        from mission_service.simulation.task_pool import tasks_on

        kept = f"the finished members are kept in {out}/members; repeat the command to continue"
        with results_in(out, kept) as made, tasks_on(*cores, "fire run") as run:
            summary = run_members(loaded, made, members, run, echo_warning)
        written = "GeoTIFFs, map.png and summary.json"
    echo(summary, as_json)
    if not as_json:
        click.echo(f"Wrote {written} to {out}/")


@fire.command("sweep")
@click.argument("scenario")
@OUT_FOLDER
@click.option(
    "--vary",
    "varied",
    multiple=True,
    required=True,
    metavar="KEY=VALUES",
    help="Values of a key: a list (3,5,8) or a range (2:10:2 means 2 to 10 in steps of 2); "
    "repeatable.",
)
@cores_option("threads")
@OVERRIDE
@JSON
def fire_sweep(
    scenario: str,
    out: Path,
    varied: tuple[str, ...],
    cores: Cores,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Simulate the fire of SCENARIO for all combinations of values; write sweep.csv and fronts.

    After an interruption, repeat the command, which then simulates only runs missing in DIR/runs.
    """
    from mission_service.simulation.fire_sweep import run_sweep, sweep_of
    from mission_service.simulation.task_pool import tasks_on

    if is_given("overrides"):
        _refuse_varied(overrides, varied)
    sweep = sweep_of(scenario, overrides, varied)
    kept = f"the finished runs are kept in {out}/runs; repeat the command to continue"
    with results_in(out, kept) as made, tasks_on(*cores, "fire sweep") as run:
        summary = run_sweep(sweep, made, run, echo_warning)
    echo(summary, as_json)
    if not as_json:
        click.echo(f"Wrote sweep.csv and fronts.geojson to {out}/")


def _refuse_varied(overrides: tuple[str, ...], varied: tuple[str, ...]) -> None:
    """Raise UsageError for a key that is both set and varied."""
    keys = {each.partition("=")[0] for each in varied}
    for each in overrides:
        if (key := each.partition("=")[0]) in keys:
            raise click.UsageError(f"--set {key} has no effect with --vary {key}; leave it out")


@fire.command("assimilate")
@click.argument("scenario")
@click.option(
    "--observations",
    required=True,
    type=click.Path(exists=True, path_type=Path),
    metavar="PATH",
    help="A file or folder of mapped perimeters with their times (PolygonDateTime).",
)
@click.option(
    "-o",
    "--out",
    type=Folder(),
    metavar="DIR",
    help="Write pictures of the forecasts, the forecast from the last perimeter, and all scores.",
)
@click.option("--workers", type=click.IntRange(1), help="Threads; by default one for each core.")
@OVERRIDE
@JSON
def fire_assimilate(
    scenario: str,
    observations: Path,
    out: Path | None,
    workers: int | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Forecast each mapped perimeter of a fire from the earlier ones, and score the forecasts.

    The output also contains the scores of two simpler forecasts: persistence (the last perimeter
    does not change) and the model alone. SCENARIO defines landscape and weather. Without an
    ignition, the fire starts from the first perimeter, at mission time 0 unless time_zero is given.
    """
    from mission_service.config.scenario import load_scenario
    from mission_service.simulation.fire_assimilation import assimilate

    loaded = load_scenario(scenario, overrides)
    threads = workers or os.cpu_count() or 1
    with nullcontext() if out is None else results_in(out, "nothing was written") as folder:
        summary = assimilate(loaded, observations, folder, threads, echo_warning)
    if as_json:
        click.echo(json.dumps(summary))
        return
    click.echo(interval_table(summary["intervals"]))
    for name in ("mean", "mean_after_first", "mean_growing", "mean_standing"):
        click.echo(f"{name}: {json.dumps(summary[name])}")


def interval_table(intervals: list[dict[str, Any]]) -> str:
    """Return one line of scores for each forecast."""
    lines = ["forecast      min   area ha    new ha   IoU (model, persistence)  error m   in band"]
    for number, each in enumerate(intervals, start=1):
        iou, model, unchanged = (each[f"iou_{name}"] for name in SCORED)
        error_m, model_m, unchanged_m = (each[f"mean_distance_m_{name}"] for name in SCORED)
        inside = "" if each["coverage_80"] is None else f"{each['coverage_80']:.2f}"
        lines.append(
            f"{number:8} {(each['to_s'] - each['from_s']) / 60.0:8.0f} {each['observed_ha']:9.1f}"
            f" {each['new_ha']:9.1f}   {iou:.3f} ({model:.3f}, {unchanged:.3f})"
            f"   {error_m:.0f} ({model_m:.0f}, {unchanged_m:.0f})   {inside}"
        )
    return "\n".join(lines)


@fire.command("wind")
@click.argument("scenario")
@OUT_FOLDER
@click.option(
    "--speed",
    "speed_m_s",
    type=FiniteRange(0.0, 100.0),
    metavar="M_S",
    help="Speed of the free wind, or of the wind at [terrain_wind]'s station (default: weather).",
)
@click.option(
    "--from",
    "from_deg",
    type=FiniteRange(0.0, 360.0),
    metavar="DEG",
    help="Direction from which this wind blows, clockwise from true north.",
)
@seconds_option("--at", "Mission time of the scenario's weather and of the sun (default: 0).")
@click.option(
    "--measured",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Measurements of stations and aircraft (CSV), to which the free wind is fitted.",
)
@click.option(
    "--slope-flow",
    is_flag=True,
    help="Add upslope and downslope flow at time_zero plus --at, by fire.air_temperature_c.",
)
@OVERRIDE
@JSON
def fire_wind(
    scenario: str, out: Path, overrides: tuple[str, ...], as_json: bool, **given: Any
) -> None:
    """Compute the wind over the terrain of SCENARIO; write grids and a summary to DIR.

    The grids are GeoTIFFs, and ASCII grids named as by WindNinja, for [wind_grids].

    The columns of FILE are lat_deg, lon_deg, above_ground_m, speed_m_s, from_deg (from true north)
    and optionally sd_m_s, the standard deviation of the error.
    """
    from mission_service.config.scenario import load_scenario
    from mission_service.simulation.wind_alone import GivenWind, run_wind

    wind = GivenWind(**given)
    if (wind.speed_m_s is None) != (wind.from_deg is None):
        raise click.UsageError("specify both --speed and --from, or neither")
    if wind.speed_m_s is not None and wind.measured is not None:
        raise click.UsageError("specify either --speed and --from, or --measured")
    if (
        wind.at_s is not None
        and not wind.slope_flow
        and (wind.speed_m_s is not None or wind.measured is not None)
    ):
        raise click.UsageError(
            "--at has no effect with a specified wind; add --slope-flow, or leave out --at"
        )
    with results_in(out, "repeat the command") as made:
        summary = run_wind(load_scenario(scenario, overrides), made, wind)
    echo(summary, as_json)
    if not as_json:
        click.echo(f"Wrote GeoTIFFs, ASCII grids and summary.json to {out}/")


@fire.command("info")
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@click.option("--crs", help="The CRS of rasters that have none, e.g. EPSG:32611.")
@click.option("--nodata", type=float, help="The value of cells without data, if no file states it.")
@click.option(
    "--unit",
    "units",
    multiple=True,
    metavar="LAYER=UNIT",
    help="The unit of a layer, e.g. slope=degrees (repeatable).",
)
@JSON
def fire_info(
    files: tuple[str, ...],
    crs: str | None,
    nodata: float | None,
    units: tuple[str, ...],
    as_json: bool,
) -> None:
    """Describe a landscape or a file of shapes. The exit code is 1 if problems are found.

    FILE is a raster or a file of shapes. For a landscape of several files, give LAYER=FILE for each
    layer: fuel, elevation, slope, aspect, canopy_cover, canopy_height, canopy_base,
    canopy_bulk_density.
    """
    from firemodel.landscape.info import in_text
    from mission_service.cli.landscape_summary import describe_files, json_of

    found = describe_files(files, crs, nodata, units)
    click.echo(json_of(found) if as_json else in_text(found))
    if found["problems"]:
        sys.exit(1)


@click.group()
def bench() -> None:
    """Measure computing times on this machine."""


@bench.command("fire")
@click.option("--largest", type=click.IntRange(min=200), default=4000, show_default=True)
@JSON
def bench_fire(largest: int, as_json: bool) -> None:
    """Measure the fire model on whole fires of 200², 1000² and 4000² cells and in steps of 10 s."""
    from mission_service.cli.bench_commands import bench_fire as run_bench

    found = run_bench(largest, (lambda line: None) if as_json else click.echo)
    if as_json:
        click.echo(json.dumps(found))
