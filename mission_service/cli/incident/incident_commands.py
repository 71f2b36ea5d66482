"""Defines ``mission-service incident``, which creates the scenario file for a new incident."""

import contextlib
import math
import os
import shlex
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import click

from mission_service.cli.incident.map_commands import bounding_box
from mission_service.cli.options import (
    JSON,
    LOCAL_PORT,
    FiniteRange,
    aware_time,
    echo,
    echo_warning,
)
from mission_service.errors import MissionServiceError, ScenarioError

Value = TypeVar("Value")
FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
DEFAULT_FUEL_MODEL = 2
STACKS, KINDS = ("px4", "ardupilot"), ("plane", "vtol", "copter")


def _numbers(count: int, form: str) -> Callable[[str], tuple[float, ...]]:
    """Return a function that reads ``count`` numbers; ``form`` describes them in errors."""

    def read(text: str) -> tuple[float, ...]:
        try:
            found = tuple(float(part) for part in text.split(","))
        except ValueError:
            found = ()
        if len(found) != count or not all(map(math.isfinite, found)):
            raise click.BadParameter(f"{text}: write it as {form}")
        return found

    return read


PLACE = _numbers(2, "LAT,LON in degrees, as in 36.35,-84.16")
WIND = _numbers(2, "SPEED,FROM in m/s and degrees, as in 5,270")
MOISTURES = _numbers(
    5, "the moistures of 1-h, 10-h, 100-h, live herbaceous and live woody fuel in percent"
)


def aircraft_of(text: str) -> Any:
    """Parse an aircraft given as NAME,STACK,KIND,LAT,LON[,LINK[,SYSTEM_ID]]."""
    from mission_service.cli.incident.scenario_text import NewVehicle

    parts = text.split(",")
    form = (
        f"NAME,{'|'.join(STACKS)},{'|'.join(KINDS)},LAT,LON[,LINK[,SYSTEM_ID]], as in "
        "hawk,px4,plane,36.37,-84.13,udpin:127.0.0.1:14540,1"
    )
    named = len(parts) in (5, 6, 7) and parts[1] in STACKS and parts[2] in KINDS
    if not named or not all(part.isdigit() for part in parts[6:]):
        raise click.BadParameter(f"{text}: write it as {form}")
    lat_deg, lon_deg = PLACE(",".join(parts[3:5]))
    link = parts[5] if len(parts) > 5 else None
    system_id = int(parts[6]) if len(parts) > 6 else None
    return NewVehicle(parts[0], parts[1], parts[2], (lat_deg, lon_deg), link, system_id)


def _named(form: str) -> Callable[[str], tuple[str, str]]:
    """Return a function that reads NAME=VALUE; ``form`` describes it in errors."""

    def read(text: str) -> tuple[str, str]:
        name, _, value = text.partition("=")
        if not value:
            raise click.BadParameter(f"{text}: write it as {form}")
        return name, value

    return read


LAYER = _named("NAME=FILE, as in fuel=fbfm40.tif")
UNIT = _named("NAME=UNIT, as in slope=percent")


@click.group()
def incident() -> None:
    """Prepare an incident."""


@incident.command("new")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--box", type=bounding_box, metavar="W,S,E,N", help="Level ground in this area (degrees)."
)
@click.option(
    "--fuel-model",
    type=click.IntRange(0, 1000),
    show_default=str(DEFAULT_FUEL_MODEL),
    help="Fuel of --box.",
)
@click.option("--landscape", type=FILE, help="An .lcp file, or one raster file with all layers.")
@click.option(
    "--layer", "layers", type=LAYER, multiple=True, metavar="NAME=FILE",
    help="A raster of the landscape: fuel, elevation, slope, aspect, canopy_cover ...",
)  # fmt: skip
@click.option(
    "--unit",
    "units",
    type=UNIT,
    multiple=True,
    metavar="NAME=UNIT",
    help="Unit of a raster that states none, such as slope=percent.",
)
@click.option(
    "--missing", type=click.Choice(["unburnable"]), help="The fuel of cells without data."
)
@click.option(
    "--wind", type=WIND, metavar="SPEED,FROM", help="Wind: m/s, and degrees from which it blows."
)
@click.option("--weather", type=FILE, help="A weather file (.raws, .wxs, .wtr, .csv).")
@click.option(
    "--start", type=click.DateTime(), help="Mission time 0 in the local time of --weather."
)
@click.option(
    "--moistures", type=MOISTURES, default="6,7,8,60,90", show_default=True,
    metavar="1H,10H,100H,HERB,WOODY", help="Fuel moistures in percent.",
)  # fmt: skip
@click.option("--ignition", "ignitions", type=PLACE, multiple=True, metavar="LAT,LON")
@click.option("--perimeter", type=FILE, help="The outline of the fire instead of ignitions.")
@click.option(
    "--vehicle", "aircraft", type=aircraft_of, multiple=True,
    metavar="NAME,STACK,KIND,LAT,LON[,LINK[,SYSTEM_ID]]",
    help="An aircraft, its home, and its MAVLink connection (default: udpin on port 14550, 14560 "
    "...) and system id (default: 1, 2 ...).",
)  # fmt: skip
@click.option(
    "--time-zero",
    callback=aware_time,
    metavar="TIME",
    help="Calendar time of mission time 0 with its UTC offset, for products.",
)
@click.option("--hours", type=FiniteRange(0.1, 2000), default=6.0, show_default=True)
@click.option(
    "--real", is_flag=True, help="A real fire (default: cameras observe a simulated fire)."
)
@JSON
def new(file: Path, as_json: bool, **given: Any) -> None:
    """Make and check the scenario FILE of a new incident; on a terminal, ask for missing values.

    The landscape is --box, --landscape or --layer; the wind is --wind or in --weather; the fire
    begins at --ignition or has the outline --perimeter.
    """
    summary = _created(file, given, asks=is_terminal())
    for line in summary["warnings"]:
        echo_warning(line)
    if as_json:
        echo({"file": str(file), **summary}, as_json)
    else:
        click.echo(f"{file}: checked. Next: {_next_command(file, given['real'])}")


@incident.command("page")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@LOCAL_PORT
@click.option(
    "--no-browser",
    is_flag=True,
    help="Print the address only. Otherwise, other users of this machine can see its token in the "
    "command line of the browser.",
)
def page(file: Path, port: int, no_browser: bool) -> None:
    """Make and check the scenario FILE of a new incident in a form in the browser.

    The page is served on this machine until the scenario has been saved, or until Ctrl-C. Files
    that are chosen in the form are copied to a folder beside FILE.
    """
    import secrets
    import signal

    from mission_service.interfaces.incident_form import FormServer, uploads_of

    _refuse_existing(file)
    for name in ("SIGTERM", "SIGHUP"):  # SIGHUP: the terminal was closed
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.default_int_handler)
    create = partial(created_by_form, file)
    with uploads_of(file) as folder:
        with (
            FormServer(port, folder, secrets.token_urlsafe(16), create) as server,
            contextlib.suppress(KeyboardInterrupt),
        ):
            click.echo(f"form for {file}: {server.address}")
            if not no_browser:
                server.open_in_browser()
            server.serve_forever()
        if server.saved is None:
            raise MissionServiceError(f"{file}: not saved")
        click.echo(f"{file}: checked. Next: {server.saved['next']}")


def created_by_form(file: Path, options: list[str]) -> dict[str, Any]:
    """Create the scenario file from the form's options; return what the page shows."""
    try:
        given = new.make_context("new", [*options, "--", str(file)]).params
        del given["file"], given["as_json"]
        summary = _created(file, given, asks=False)
    except click.ClickException as error:
        raise MissionServiceError(error.format_message()) from None
    return {"warnings": summary["warnings"], "next": _next_command(file, given["real"])}


def _refuse_existing(file: Path) -> None:
    if file.exists():
        raise MissionServiceError(f"{file}: already exists; choose another name")


def _created(file: Path, given: dict[str, Any], asks: bool) -> dict[str, Any]:
    """Write and check a scenario file from the given options; return its summary."""
    from mission_service.cli.incident.file_check import checked
    from mission_service.cli.incident.scenario_text import scenario_text

    _refuse_existing(file)
    text = scenario_text(_incident(file, given, asks))
    made = file.with_name(f".{file.name}.new")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        made.write_text(text, encoding="utf-8")
        summary = checked(str(made))
        made.replace(file)
    except OSError as error:
        raise MissionServiceError(f"{file}: cannot be written: {error.strerror}") from None
    except Exception as error:
        raise _of_file(error, made, file) from None
    finally:
        with contextlib.suppress(OSError):
            made.unlink(missing_ok=True)
    return summary


def _next_command(file: Path, is_real: bool) -> str:
    """Return the command to try next; in a simulation the aircraft take off without an order."""
    name = shlex.quote(str(file))
    if is_real:
        return f"mission-service run {name} --out out/live"
    return f"mission-service sim {name} --set vehicles.0.autostart=true"


def _of_file(error: Exception, made: Path, file: Path) -> Exception:
    """Return an error that names the file given by the user."""
    if isinstance(error, ScenarioError):
        return ScenarioError(str(error).replace(str(made), str(file)))
    return error


def _incident(file: Path, given: dict[str, Any], asks: bool) -> Any:
    """Return the incident from the options; if ``asks``, ask the user for missing values."""
    from mission_service.cli.incident.scenario_text import (
        MAX_CELLS,
        MIN_CELLS,
        NewIncident,
        grid_of,
    )

    def relative(path: Path | None) -> str | None:
        return None if path is None else Path(os.path.relpath(path, file.parent)).as_posix()

    for option, pairs in (("--layer", given["layers"]), ("--unit", given["units"])):
        names = [name for name, _ in pairs]
        if len(set(names)) < len(names):
            raise click.UsageError(f"{option}: each name may be given only once")
    layers = {name: relative(Path(path)) or "" for name, path in given["layers"]}
    box = given["box"]
    _refuse_several(("--box", box), ("--landscape", given["landscape"]), ("--layer", layers))
    _refuse_several(("--wind", given["wind"]), ("--weather", given["weather"]))
    _refuse_several(("--ignition", given["ignitions"]), ("--perimeter", given["perimeter"]))
    if not (box or given["landscape"] or layers):
        box = _asked(
            "Area as WEST,SOUTH,EAST,NORTH", bounding_box, "--box, --landscape or --layer", asks
        )
    if box is not None and not all(MIN_CELLS <= each <= MAX_CELLS for each in grid_of(box)):
        raise click.UsageError("--box: each side of the area must be 600 m to 120 km long")
    _refuse_without_effect(given, box)
    wind, ignitions = given["wind"], given["ignitions"]
    if wind is None and given["weather"] is None:
        wind = _asked("Wind as SPEED,FROM (m/s, degrees)", WIND, "--wind or --weather", asks)
    if not ignitions and given["perimeter"] is None:
        ignitions = (_asked("Ignition as LAT,LON", PLACE, "--ignition or --perimeter", asks),)
    aircraft = given["aircraft"]
    if not aircraft:
        form = "Aircraft as NAME,STACK,KIND,LAT,LON[,LINK[,SYSTEM_ID]]"
        aircraft = (_asked(form, aircraft_of, "--vehicle", asks),)
    return NewIncident(
        file.stem,
        given["hours"],
        box,
        DEFAULT_FUEL_MODEL if given["fuel_model"] is None else given["fuel_model"],
        relative(given["landscape"]),
        layers,
        dict(given["units"]),
        given["missing"],
        wind,
        relative(given["weather"]),
        given["start"],
        given["moistures"],
        ignitions,
        relative(given["perimeter"]),
        aircraft,
        not given["real"],
        given["time_zero"],
    )


def _refuse_several(*options: tuple[str, object]) -> None:
    found = [name for name, value in options if value]
    if len(found) > 1:
        raise click.UsageError(f"specify only one of {' and '.join(found)}")


def _refuse_without_effect(given: dict[str, Any], box: tuple[float, ...] | None) -> None:
    """Raise UsageError for options of a landscape or weather other than the given one."""
    for option, value, needed, source in (
        ("--start", given["start"], "--weather", given["weather"]),
        ("--fuel-model", given["fuel_model"], "--box", box),
        ("--missing", given["missing"], "--landscape or --layer", box is None),
        ("--unit", given["units"] or None, "--landscape or --layer", box is None),
    ):
        if value is not None and not source:
            raise click.UsageError(f"{option} requires {needed}")


def is_terminal() -> bool:
    """Return whether questions can be asked."""
    return sys.stdin.isatty()


def _asked(question: str, read: Callable[[str], Value], options: str, asks: bool) -> Value:
    """Ask on a terminal until the answer is valid; elsewhere, name the missing options."""
    if not asks:
        raise click.UsageError(f"specify {options}")
    found: Value = click.prompt(question, value_proc=read, err=True)
    return found
