"""Defines ``mission-service mission``, ``signing`` and ``lost-link``, for one autopilot."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from mission_service.cli.options import (
    JSON,
    SIGNING_KEY,
    TLOG,
    FiniteRange,
    echo,
    echo_warning,
    progress_line,
)

LINK = click.option(
    "--link",
    default="udpin:127.0.0.1:14550",
    show_default=True,
    help="udpin, udpout, tcp or tcpin:HOST:PORT, or serial:DEVICE:BAUD.",
)
TIMEOUT = click.option(
    "--timeout",
    "timeout_s",
    type=FiniteRange(min=0.1),
    default=30.0,
    show_default=True,
    help="Give up after this many seconds.",
)


def link_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the link options and --json to a command."""
    return LINK(TIMEOUT(TLOG(SIGNING_KEY(JSON(command)))))


@click.group()
def mission() -> None:
    """Transfer missions to and from one autopilot."""


@mission.command("upload")
@click.argument("plan_file", type=click.Path(dir_okay=False, path_type=Path))
@link_options
def mission_upload(plan_file: Path, as_json: bool, **link: Any) -> None:
    """Upload PLAN_FILE and print the result. The flight is not started.

    The fence and the rally points on board remain unless the plan contains a fence or rally points.
    """
    from autopilot_bridge.missions.plan_file import read_any
    from mission_service.cli.mission_transfers import upload

    echo(upload(read_any(plan_file), _line(link)), as_json)


@mission.command("download")
@click.option("-o", "--output", type=click.Path(dir_okay=False, path_type=Path), required=True)
@link_options
def mission_download(output: Path, as_json: bool, **link: Any) -> None:
    """Download mission, fence and rally points (.plan file), or only the mission (.waypoints)."""
    from mission_service.cli.mission_transfers import download

    echo(download(output, _line(link)), as_json)


@mission.command("clear")
@click.option("--all", "everything", is_flag=True, help="Also remove fence and rally points.")
@link_options
def mission_clear(everything: bool, as_json: bool, **link: Any) -> None:
    """Remove the autopilot's mission."""
    from mission_service.cli.mission_transfers import clear

    echo(clear(_line(link), everything), as_json)


def _line(link: dict[str, Any]) -> Any:
    from mission_service.cli.mission_transfers import Line

    return Line(**link, warn=progress_line)


@click.group()
def signing() -> None:
    """Set or remove a vehicle's key for MAVLink 2 signing."""


KEY_NEEDED = click.option(
    "--signing-key", required=True, metavar="file:PATH|env:NAME", help="Source of the key."
)
SYSTEM = click.option(
    "--system-id", type=click.IntRange(1, 250), help="System id (default: the first vehicle found)."
)


@signing.command("set-up")
@LINK
@KEY_NEEDED
@click.option(
    "--old-key", metavar="file:PATH|env:NAME", help="Source of the vehicle's current key."
)
@SYSTEM
@TIMEOUT
@TLOG
@JSON
def signing_set_up(old_key: str | None, system_id: int | None, as_json: bool, **link: Any) -> None:
    """Set the vehicle's key and check that the vehicle signs its frames.

    The key is sent in clear text: use a link that cannot be intercepted, such as a USB cable. The
    vehicle must be disarmed. If the vehicle does not answer a signed request with signed frames,
    the exit code is 1. The key is not written to any file.
    """
    from mission_service.cli.signing_setup import set_up

    echo(set_up(_line(link), old_key, system_id), as_json)


@signing.command("off")
@LINK
@KEY_NEEDED
@SYSTEM
@TIMEOUT
@TLOG
@JSON
def signing_off(system_id: int | None, as_json: bool, **link: Any) -> None:
    """Remove the vehicle's key and check that the vehicle answers unsigned requests."""
    from mission_service.cli.signing_setup import turn_off

    echo(turn_off(_line(link), system_id), as_json)


@click.group("lost-link")
def lost_link() -> None:
    """Show or set the reaction of a vehicle to a lost link to the station.

    The service must not be running on the same link.
    """


STATION = click.option(
    "--station-id",
    type=click.IntRange(1, 255),
    default=255,
    show_default=True,
    help='System id of the service\'s heartbeats (245 if the vehicle has backend = "mavsdk").',
)


@lost_link.command("show")
@STATION
@SYSTEM
@link_options
def lost_link_show(station_id: int, system_id: int | None, as_json: bool, **link: Any) -> None:
    """Read the vehicle's parameters and print its reaction in each phase of a flight."""
    from mission_service.cli.lost_link_parameters import show

    _echo_lost_link(show(_line(link), system_id, station_id), as_json)


@lost_link.command("set")
@click.argument("wanted", required=False, type=click.Choice(["continue", "hold", "return", "land"]))
@click.option(
    *("-o", "--output"),
    type=click.Path(dir_okay=False, path_type=Path),
    default=Path("lost-link-before.json"),
    show_default=True,
    help="File for the values before the change.",
)
@click.option(
    "--restore",
    "old",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Restore the values in FILE, which was written by an earlier change.",
)
@STATION
@SYSTEM
@link_options
def lost_link_set(
    wanted: Any,
    output: Path,
    old: Path | None,
    station_id: int,
    system_id: int | None,
    as_json: bool,
    **link: Any,
) -> None:
    """Set the parameters of a disarmed vehicle so that it reacts as WANTED, and read them back.

    The timeouts are not changed. The values before the change are printed and written to a file.
    """
    from mission_service.cli.lost_link_parameters import restore, set_wanted

    if (wanted is None) == (old is None):
        raise click.UsageError("specify either continue, hold, return or land, or --restore FILE")
    if old is not None:
        result = restore(_line(link), system_id, station_id, old)
    else:
        result = set_wanted(_line(link), system_id, station_id, wanted, output)
    _echo_lost_link(result, as_json)


def _echo_lost_link(result: dict[str, Any], as_json: bool) -> None:
    for warning in result["warnings"]:
        echo_warning(warning)
    if not as_json:
        values = result["parameters"].items()
        result["parameters"] = ", ".join(f"{name} {value:g}" for name, value in values)
        if "changed" in result:
            result["changed"] = ", ".join(result["changed"]) or "nothing"
    echo(result, as_json)
