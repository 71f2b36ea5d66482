"""Defines ``mission-service log``, which describes and exports logged flights.

Heavy modules are imported only when a command runs.
"""

import json
from pathlib import Path
from typing import Any

import click

from mission_service.cli.options import JSON, OUT_FOLDER
from mission_service.cli.output_folder import refuse_run_folder, results_in

DEFAULT_FORMATS = ("geojson", "kml", "csv", "plan")
MAX_MISSIONS = 10  # more missions are summarised in one line

LOGS = click.argument(
    "logs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="LOG..."
)


@click.group()
def log() -> None:
    """Describe and export logged flights: .tlog, .bin (ArduPilot), .ulg (PX4) and journals."""


@log.command("info")
@LOGS
@JSON
def log_info(logs: tuple[Path, ...], as_json: bool) -> None:
    """Describe the vehicles, missions, modes and damaged parts of each LOG."""
    from mission_service.replay.flights.flown_vehicle import info_of
    from mission_service.replay.flights.journal_log import open_flight

    found = [info_of(open_flight(path)) for path in logs]
    if as_json:
        click.echo(json.dumps(found, indent=2))
        return
    for info in found:
        for line in _lines(info):
            click.echo(line)


def _lines(info: dict[str, Any]) -> list[str]:
    lines = [f"{info['log']}: {info['messages']} messages"]
    lines += [f"  DAMAGED: {each}" for each in info["damage"]]
    for vehicle in info["vehicles"]:
        begin = f"from {vehicle['begin_utc']}, " if vehicle["begin_utc"] else ""
        lines += [
            f"  vehicle {vehicle['vehicle']} ({vehicle['name']}), {vehicle['autopilot']}: {begin}"
            f"{vehicle['duration_s']:.0f} s, {vehicle['positions']} positions",
            f"    flown {vehicle['flown_m']} m, up to {vehicle['highest_above_start_m']} m above "
            f"its start, at most {vehicle['max_speed_m_s']} m/s",
        ]
        lines += _missions(vehicle["missions"])
        back = ", ".join(f"{at_s:.1f} s" for at_s in vehicle["turned_back_at_s"])
        lines += [
            f"    servo {each['servo']} to {each['pulse_us']} us at {each['at_s']:.1f} s"
            for each in vehicle["servo_steps"]
        ]
        lines += [f"    back to an earlier item at {back}"] if back else []
        lines.append(
            f"    {vehicle['items_reached']} items reached, "
            f"{vehicle['gripper_releases']} releases by gripper, link lost "
            f"{vehicle['links_lost']} times (for at most {vehicle['longest_silence_s']} s)"
        )
        lines += [
            f"    {each['at_s']:8.1f} s  {each['mode'] or 'unknown mode'}"
            f"{', armed' if each['armed'] else ''}"
            for each in vehicle["modes"]
        ]
    return lines


def _missions(missions: list[dict[str, Any]]) -> list[str]:
    if len(missions) <= MAX_MISSIONS:
        return [
            f"    mission of {each['items']} items at {each['at_s']:.1f} s" for each in missions
        ]
    items = [each["items"] for each in missions]
    return [
        f"    {len(missions)} missions of {min(items)} to {max(items)} items from "
        f"{missions[0]['at_s']:.1f} to {missions[-1]['at_s']:.1f} s"
    ]


@log.command("export")
@LOGS
@OUT_FOLDER
@click.option(
    "--format",
    "formats",
    multiple=True,
    type=click.Choice([*DEFAULT_FORMATS, "parquet", "mcap"]),
    default=DEFAULT_FORMATS,
    show_default=True,
    help="Format to write (repeatable). parquet and mcap need mission-service[export].",
)
def log_export(logs: tuple[Path, ...], out: Path, formats: tuple[str, ...]) -> None:
    """Export tracks (GeoJSON, KML), tables (CSV, Parquet), missions (.plan), or all data (MCAP)."""
    from mission_service.replay.flights.exports import check_libraries, export
    from mission_service.replay.flights.journal_log import open_flight

    check_libraries(formats)
    refuse_run_folder(out, logs)
    opened = [open_flight(path) for path in logs]
    try:
        with results_in(out, "repeat the command") as made:
            files = export(opened, made, formats)
    finally:
        for each in opened:
            for damage in each.damage:
                click.echo(f"{each.path}: DAMAGED: {damage}", err=True)
    plans = [name for name in files if name.endswith(".plan")]
    if len(plans) > MAX_MISSIONS:
        others = [name for name in files if name not in plans]
        files = [*others, f"{len(plans)} missions (.plan)"]
    click.echo(f"Wrote {', '.join(files) or 'no files'} to {out}/")
