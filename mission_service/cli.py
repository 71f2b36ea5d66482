"""The command line. Heavy imports wait until a command needs them."""

import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from mission_service import __version__
from mission_service.cli_parts import JSON
from mission_service.cli_parts import folder as _folder
from mission_service.experiment_cli import experiment

OVERRIDE = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change one key of the scenario, e.g. planner.alpha=1.5 (repeatable).",
)
LINK = click.option(
    "--link",
    default="udpin:127.0.0.1:14550",
    show_default=True,
    help="udpin, udpout, tcp or tcpin:HOST:PORT, or serial:DEVICE:BAUD.",
)
SIGNING_KEY = click.option(
    "--signing-key",
    metavar="file:PATH|env:NAME",
    help="Where the key is with which frames are signed and checked (MAVLink 2 signing).",
)
TLOG = click.option(
    "--tlog",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Add the link's traffic to this .tlog recording.",
)
TIMEOUT = click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(min=0.1),
    default=30.0,
    show_default=True,
    help="Give up after this many seconds.",
)


class Guarded(click.Group):
    """A group whose commands end known errors in one line and exit code 1."""

    def invoke(self, ctx: click.Context) -> Any:
        from autopilot_bridge.errors import BridgeError
        from firemodel.errors import FireModelError
        from mission_service.errors import MissionServiceError

        known = (MissionServiceError, FireModelError, BridgeError)
        try:
            return super().invoke(ctx)
        except known as error:
            raise click.ClickException(str(error)) from None
        except BaseExceptionGroup as group:
            ours, others = group.split(known)
            if ours is None or others is not None:
                raise
            raise click.ClickException(str(_first(ours))) from None


def _first(error: BaseException) -> BaseException:
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error


@click.group(cls=Guarded, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="mission-service")
def main() -> None:
    """Fire model, planners and MAVLink missions for PX4 and ArduPilot."""


main.add_command(experiment)


@main.command()
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default=Path("out"))
@click.option("--speedup", type=click.FloatRange(1, 100), default=30.0, show_default=True)
@OVERRIDE
@JSON
def demo(out: Path, speedup: float, overrides: tuple[str, ...], as_json: bool) -> None:
    """Mock autopilots and the daemon over UDP on loopback, faster than real time."""
    from mission_service.config import load_scenario
    from mission_service.demo import run_demo

    scenario = load_scenario("demo", overrides)
    _finish(run_demo(scenario, _folder(out), speedup, _now(), _reporter(as_json)), out, as_json)


@main.command()
@click.argument("scenario")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), required=True)
@OVERRIDE
@JSON
def sim(scenario: str, out: Path, overrides: tuple[str, ...], as_json: bool) -> None:
    """Fly SCENARIO (a file, or a shipped one by name) in virtual time."""
    from mission_service.config import flying, load_scenario
    from mission_service.outputs import write_outputs
    from mission_service.sim import simulate

    loaded = flying(load_scenario(scenario, overrides))
    folder = _folder(out)
    with _progress_bar(loaded.name, loaded.duration_s, as_json) as progress:
        record, world = simulate(loaded, folder / "journal.jsonl", _now(), progress)
    _finish(write_outputs(folder, loaded, record, world.fire), out, as_json)


@main.command()
@click.argument("config")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default=Path("out"))
@OVERRIDE
@TLOG
@SIGNING_KEY
@JSON
def run(
    config: str,
    out: Path,
    overrides: tuple[str, ...],
    tlog: Path | None,
    signing_key: str | None,
    as_json: bool,
) -> None:
    """Run the live daemon for CONFIG next to its autopilots until the end or Ctrl-C."""
    import asyncio

    from mission_service.config import flying, load_scenario, with_signing_key
    from mission_service.daemon import serve
    from mission_service.outputs import write_outputs

    scenario = flying(load_scenario(config, overrides))
    if signing_key is not None:
        scenario = with_signing_key(scenario, signing_key)
    folder = _folder(out)
    record, world = asyncio.run(
        serve(scenario, folder / "journal.jsonl", _now(), _reporter(as_json), tlog_path=tlog)
    )
    _finish(write_outputs(folder, scenario, record, world.fire), out, as_json)


@main.command()
@click.argument("scenario", required=False)
@click.option("--stack", type=click.Choice(["px4", "ardupilot"]), default="px4")
@click.option(
    "--vehicle", help="plane or copter; with SCENARIO the name of its vehicle (default: the first)."
)
@click.option("--count", type=click.IntRange(1, 250), default=1, help="Vehicles on the link.")
@click.option("--system-id", type=click.IntRange(1, 250), default=1, help="Of the first one.")
@click.option("--home", default="36.6,-84.2,300", help="LAT,LON,ALTITUDE_AMSL_M")
@click.option("--link", default="udpout:127.0.0.1:14550", show_default=True)
@click.option("--listen", help="Instead of --link: wait for callers at HOST:PORT, udpin or tcpin.")
@click.option("--speedup", type=click.FloatRange(0.1, 100), default=1.0, show_default=True)
@click.option("--wind", default="0,0", help="FROM_DEG,SPEED_M_S of a steady wind, e.g. 240,5.")
@click.option(
    "--battery",
    "battery_minutes",
    type=click.FloatRange(0.1, 10_000),
    metavar="MINUTES",
    help="A battery for so many minutes in the air; at 15 % it returns home.",
)
@click.option(
    "--terrain",
    "terrain_amsl_m",
    type=click.FloatRange(-500, 9000),
    metavar="AMSL_M",
    help="Height of the ground everywhere; who flies below it has crashed.",
)
@click.option(
    "--fault",
    "faults",
    multiple=True,
    metavar="FAULT",
    help="Something to go wrong (repeatable), e.g. reboot@30; see the README.",
)
@click.option(
    "--param",
    "parameters",
    multiple=True,
    metavar="NAME=VALUE",
    help="A parameter of the autopilot (repeatable), e.g. MIS_TKO_LAND_REQ=0.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Of faults by chance.")
@SIGNING_KEY
@click.option("--json", "as_json", is_flag=True, help="Print each vehicle as JSON.")
def mock(
    scenario: str | None,
    stack: str,
    vehicle: str | None,
    count: int,
    system_id: int,
    home: str,
    link: str,
    listen: str | None,
    speedup: float,
    wind: str,
    battery_minutes: float | None,
    terrain_amsl_m: float | None,
    faults: tuple[str, ...],
    parameters: tuple[str, ...],
    seed: int,
    signing_key: str | None,
    as_json: bool,
) -> None:
    """Mock autopilots as a process of their own, until Ctrl-C.

    With SCENARIO it is the vehicle of that name standing at its home. With --count there are
    several without a scenario, with system ids in a row. They sign when they have a key, from here,
    from SCENARIO or by SETUP_SIGNING.
    """
    from mission_service.mocks import (
        Surroundings,
        by_hand,
        from_scenario,
        listening,
        read_parameters,
        read_wind,
        run,
    )

    if scenario and count > 1:
        raise click.UsageError("--count is for mocks without a scenario")
    if not scenario and vehicle not in (None, "plane", "copter"):
        raise click.UsageError(f"--vehicle {vehicle}: without a scenario it is plane or copter")
    around = Surroundings(
        read_wind(wind),
        battery_minutes,
        terrain_amsl_m,
        faults,
        seed,
        read_parameters(parameters),
    )
    if scenario:
        fleet, its_key = from_scenario(scenario, vehicle, around)
        signing_key = signing_key or its_key
    else:
        fleet = by_hand(stack, vehicle or "plane", system_id, home, count, around)
    link = listening(listen) if listen else link
    run(fleet, link, speedup, as_json, click.echo, signing_key)


@main.command()
@click.argument("scenario")
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    required=True,
    help="The .plan file to write.",
)
@click.option("--vehicle", help="Which vehicle of the scenario (default: the first).")
@OVERRIDE
def plan(scenario: str, output: Path, vehicle: str | None, overrides: tuple[str, ...]) -> None:
    """Write the first mission of SCENARIO as a QGroundControl .plan file."""
    from mission_service.demo import write_plan

    count = write_plan(scenario, vehicle, output, overrides)
    click.echo(f"{output}: {count} items")


@main.group()
def fire() -> None:
    """The fire model by itself."""


@fire.command("run")
@click.argument("scenario")
@click.option(
    "-o", "--out", type=click.Path(file_okay=False, path_type=Path), required=True, metavar="DIR"
)
@click.option(
    "--front-every",
    "front_every_s",
    type=click.FloatRange(min=1.0),
    default=3600.0,
    show_default=True,
    help="Seconds between the fronts that are written.",
)
@OVERRIDE
@JSON
def fire_run(
    scenario: str, out: Path, front_every_s: float, overrides: tuple[str, ...], as_json: bool
) -> None:
    """Burn SCENARIO to its end: GeoTIFFs, fronts as GeoJSON, a map and a summary in DIR."""
    from mission_service.config import load_scenario
    from mission_service.fire_run import run_fire
    from mission_service.fire_setup import notes_on

    if math.isnan(front_every_s):
        raise click.UsageError("--front-every nan: give seconds")
    loaded = load_scenario(scenario, overrides)
    for note in notes_on(loaded):
        click.echo(f"Note: {note}", err=True)
    summary = run_fire(loaded, _folder(out), front_every_s)
    _echo(summary, as_json)
    if not as_json:
        click.echo(f"GeoTIFFs, fronts.geojson, map.png and summary.json in {out}/")


@fire.command("info")
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@click.option("--crs", help="The CRS of rasters that have none, e.g. EPSG:32611.")
@click.option("--nodata", type=float, help="The value of cells without data, if not in the file.")
@click.option(
    "--unit", "units", multiple=True, metavar="LAYER=UNIT", help="e.g. slope=degrees (repeatable)."
)
@JSON
def fire_info(
    files: tuple[str, ...],
    crs: str | None,
    nodata: float | None,
    units: tuple[str, ...],
    as_json: bool,
) -> None:
    """What is in a landscape or a file of shapes, and what is wrong with it (exit code 1 then).

    FILE is a raster or a file of shapes, or LAYER=FILE for each layer of a landscape: fuel,
    elevation, slope, aspect, canopy_cover, canopy_height, canopy_base.
    """
    from firemodel.info import in_text
    from mission_service.fire_info import describe_files

    found = describe_files(files, crs, nodata, units)
    click.echo(json.dumps(found) if as_json else in_text(found))
    if found["problems"]:
        sys.exit(1)


@main.group()
def bench() -> None:
    """How fast it is on this machine."""


@bench.command("fire")
@click.option("--largest", type=click.IntRange(min=200), default=4000, show_default=True)
@JSON
def bench_fire(largest: int, as_json: bool) -> None:
    """The fire model: whole burns of 200², 1000² and 4000² cells, and steps of ten seconds."""
    from mission_service.bench import bench_fire as run_bench

    found = run_bench(largest, (lambda line: None) if as_json else click.echo)
    if as_json:
        click.echo(json.dumps(found))


@main.group()
def mission() -> None:
    """Move missions to and from one autopilot."""


@mission.command("upload")
@click.argument("plan_file", type=click.Path(dir_okay=False, path_type=Path))
@LINK
@TIMEOUT
@TLOG
@SIGNING_KEY
@JSON
def mission_upload(plan_file: Path, as_json: bool, **line: Any) -> None:
    """Upload PLAN_FILE and say what the autopilot made of it. Does not start the flight.

    Fence and rally points that the autopilot has stay where the plan has none.
    """
    from autopilot_bridge.planfile import read_any
    from mission_service.transfers import upload

    _echo(upload(read_any(plan_file), _line(line)), as_json)


@mission.command("download")
@click.option("-o", "--output", type=click.Path(dir_okay=False, path_type=Path), required=True)
@LINK
@TIMEOUT
@TLOG
@SIGNING_KEY
@JSON
def mission_download(output: Path, as_json: bool, **line: Any) -> None:
    """Write mission, fence and rally points to a .plan file, or the mission to a .waypoints one."""
    from mission_service.transfers import download

    _echo(download(output, _line(line)), as_json)


@mission.command("clear")
@click.option("--all", "everything", is_flag=True, help="The fence and the rally points too.")
@LINK
@TIMEOUT
@TLOG
@SIGNING_KEY
@JSON
def mission_clear(everything: bool, as_json: bool, **line: Any) -> None:
    """Remove the autopilot's mission."""
    from mission_service.transfers import clear

    _echo(clear(_line(line), everything), as_json)


def _line(line: dict[str, Any]) -> Any:
    from mission_service.transfers import Line

    return Line(**line, warn=lambda text: click.echo(text, err=True))


@main.group()
def signing() -> None:
    """MAVLink 2 signing: give a vehicle its key, or take it away."""


KEY_NEEDED = click.option(
    "--signing-key", required=True, metavar="file:PATH|env:NAME", help="Where the key is."
)
SYSTEM = click.option(
    "--system-id", type=click.IntRange(1, 250), help="Of the vehicle (default: the first heard)."
)


@signing.command("set-up")
@LINK
@KEY_NEEDED
@click.option(
    "--old-key", metavar="file:PATH|env:NAME", help="Where the key is that the vehicle has now."
)
@SYSTEM
@TIMEOUT
@TLOG
@JSON
def signing_set_up(old_key: str | None, system_id: int | None, as_json: bool, **line: Any) -> None:
    """Tell the vehicle the key, and see that it signs.

    The key travels in clear text: use a link nobody listens to, such as a USB cable. The vehicle
    must be disarmed. Then it must answer a question that is signed, or the exit code is 1. The
    key is not recorded.
    """
    from mission_service.signing_setup import set_up

    _echo(set_up(_line(line), old_key, system_id), as_json)


@signing.command("off")
@LINK
@KEY_NEEDED
@SYSTEM
@TIMEOUT
@TLOG
@JSON
def signing_off(system_id: int | None, as_json: bool, **line: Any) -> None:
    """Have the vehicle that has the key sign no more, and see that it answers without."""
    from mission_service.signing_setup import turn_off

    _echo(turn_off(_line(line), system_id), as_json)


@main.command()
@click.argument("journal", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--verify", is_flag=True, help="Compare every command with the journal's.")
@JSON
def replay(journal: Path, verify: bool, as_json: bool) -> None:
    """Feed a journal's events through a fresh core; exit code 1 at the first difference."""
    from dataclasses import asdict

    from mission_service.replay import verify as run_verify

    if not verify:
        raise click.UsageError("say what to do with the journal: --verify")
    result = run_verify(journal)
    if as_json:
        click.echo(json.dumps(asdict(result)))
    else:
        click.echo(
            f"{journal}: {result.events} events, {result.commands} commands "
            f"({result.decisions} decisions) reproduced"
        )
        if result.cut_at_line is not None:
            click.echo(f"the journal is cut off in line {result.cut_at_line}; verified up to there")
    if result.difference is not None:
        raise click.ClickException(f"{journal}: first difference in {result.difference}")


@main.group()
def config() -> None:
    """Scenario files."""


@config.command("check")
@click.argument("file")
@OVERRIDE
@JSON
def config_check(file: str, overrides: tuple[str, ...], as_json: bool) -> None:
    """Check FILE and everything it names."""
    from mission_service.config import load_scenario
    from mission_service.world import check

    _echo({"result": "ok", **check(load_scenario(file, overrides))}, as_json)


def _now() -> str:
    from datetime import UTC, datetime

    return datetime.now(UTC).isoformat(timespec="seconds")


def _reporter(as_json: bool) -> Callable[[Any, Any], None]:
    from mission_service.report import LiveReport

    return LiveReport(quiet=as_json)


def _progress_bar(name: str, duration_s: float, quiet: bool) -> Any:
    from mission_service.report import SimProgress

    return SimProgress(name, duration_s, quiet)


def _echo(result: dict[str, Any], as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps(result))
    else:
        click.echo("\n".join(f"{key}: {value}" for key, value in result.items()))


def _finish(summary: dict[str, Any], out: Path, as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps(summary))
        return
    for vehicle in summary["vehicles"]:
        click.echo(
            f"{vehicle['name']}: {vehicle['decisions']} decisions, "
            f"{vehicle['reversals']} reversals, uploads {vehicle['uploads']}"
        )
    click.echo(
        f"{summary['burned_area_ha']:.0f} ha burned at {summary['mission_time_s'] / 3600:.2f} h; "
        f"journal, GeoJSON, map and summary in {out}/"
    )


if __name__ == "__main__":
    sys.exit(main())
