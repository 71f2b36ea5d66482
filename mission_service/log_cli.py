"""``mission-service log``: what logged flights tell. Heavy imports wait."""

import json
from pathlib import Path
from typing import Any

import click

from mission_service.cli_parts import JSON, folder

DEFAULT_FORMATS = ("geojson", "kml", "csv", "plan")
LOGS = click.argument(
    "logs",
    nargs=-1,
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="LOG...",
)


@click.group()
def log() -> None:
    """Logged flights: .tlog, ArduPilot's .bin, PX4's .ulg."""


@log.command("info")
@LOGS
@JSON
def log_info(logs: tuple[Path, ...], as_json: bool) -> None:
    """What flew in each LOG, and what is damaged in it."""
    from autopilot_bridge.logs.reading import open_log
    from mission_service.flights.flown import info_of

    found = [info_of(open_log(path)) for path in logs]
    if as_json:
        click.echo(json.dumps(found, indent=2))
        return
    for told in found:
        for line in _lines(told):
            click.echo(line)


def _lines(told: dict[str, Any]) -> list[str]:
    lines = [f"{told['log']}: {told['messages']} messages"]
    lines += [f"  DAMAGED: {each}" for each in told["damage"]]
    for vehicle in told["vehicles"]:
        begun = f"from {vehicle['begin_utc']}, " if vehicle["begin_utc"] else ""
        lines += [
            f"  vehicle {vehicle['vehicle']}, {vehicle['autopilot']}: {begun}"
            f"{vehicle['duration_s']:.0f} s, {vehicle['positions']} positions",
            f"    flown {vehicle['flown_m']} m, up to {vehicle['highest_above_start_m']} m above "
            f"its start, at most {vehicle['most_speed_m_s']} m/s",
        ]
        lines += [
            f"    mission of {each['items']} items at {each['at_s']:.1f} s"
            for each in vehicle["missions"]
        ]
        back = ", ".join(f"{at_s:.1f} s" for at_s in vehicle["turned_back_at_s"])
        lines += [
            f"    servo {each['servo']} to {each['pulse_us']} us at {each['at_s']:.1f} s"
            for each in vehicle["servo_steps"]
        ]
        lines += [f"    back to an earlier item at {back}"] if back else []
        lines.append(
            f"    {vehicle['items_reached']} items reached, "
            f"{vehicle['gripper_releases']} releases by gripper, {vehicle['links_lost']} times no "
            f"link (at most {vehicle['longest_silence_s']} s)"
        )
        lines += [
            f"    {each['at_s']:8.1f} s  {each['mode'] or 'unknown mode'}"
            f"{', armed' if each['armed'] else ''}"
            for each in vehicle["modes"]
        ]
    return lines


@log.command("export")
@LOGS
@click.option(
    "-o", "--out", type=click.Path(file_okay=False, path_type=Path), required=True, metavar="DIR"
)
@click.option(
    "--format",
    "formats",
    multiple=True,
    type=click.Choice([*DEFAULT_FORMATS, "parquet", "mcap"]),
    default=DEFAULT_FORMATS,
    show_default=True,
    help="What to write (repeatable). parquet and mcap need mission-service[export].",
)
def log_export(logs: tuple[Path, ...], out: Path, formats: tuple[str, ...]) -> None:
    """Tracks as GeoJSON and KML, tables as CSV or Parquet, missions as .plan, all as MCAP."""
    from autopilot_bridge.logs.reading import open_log
    from mission_service.flights.exports import check_libraries, export

    check_libraries(formats)
    opened = [open_log(path) for path in logs]
    files = export(opened, folder(out), formats)
    for each in opened:
        for damage in each.damage:
            click.echo(f"{each.path}: DAMAGED: {damage}", err=True)
    click.echo(f"{', '.join(files) or 'nothing to write'} in {out}/")
