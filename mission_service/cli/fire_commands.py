"""Defines ``mission-service fire`` and ``bench``, which use only the fire model.

Heavy modules are imported only when a command runs.
"""

import json
import math
import sys
from pathlib import Path

import click

from mission_service.cli.options import JSON, OUT_FOLDER, OVERRIDE, echo, echo_warning, folder


@click.group()
def fire() -> None:
    """Use the fire model alone, without vehicles."""


@fire.command("run")
@click.argument("scenario")
@OUT_FOLDER
@click.option(
    "--front-every",
    "front_every_s",
    type=click.FloatRange(min=1.0),
    default=3600.0,
    show_default=True,
    help="Seconds between two fronts in the output.",
)
@click.option("--netcdf", is_flag=True, help="Also write fire.nc (NetCDF, CF conventions).")
@OVERRIDE
@JSON
def fire_run(
    scenario: str,
    out: Path,
    front_every_s: float,
    netcdf: bool,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Simulate the fire of SCENARIO; write GeoTIFFs, fronts, a map and a summary to DIR.

    The fronts are GeoJSON and KML. QGIS applies the styles (.qml) beside the files.
    """
    from mission_service.config.scenario import load_scenario
    from mission_service.simulation.fire_alone import run_fire

    if math.isnan(front_every_s):
        raise click.UsageError("--front-every nan: give seconds")
    loaded = load_scenario(scenario, overrides)
    summary = run_fire(loaded, folder(out), front_every_s, echo_warning, netcdf)
    echo(summary, as_json)
    if not as_json:
        click.echo(f"GeoTIFFs, fronts (GeoJSON, KML), map.png and summary.json in {out}/")


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
    """Describe a landscape or a file of shapes. The exit code is 1 if it has problems.

    FILE is a raster or a file of shapes. For the layers of a landscape, give LAYER=FILE for each of
    them: fuel, elevation, slope, aspect, canopy_cover, canopy_height, canopy_base.
    """
    from firemodel.landscape.info import in_text
    from mission_service.cli.landscape_summary import describe_files

    found = describe_files(files, crs, nodata, units)
    click.echo(json.dumps(found) if as_json else in_text(found))
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
