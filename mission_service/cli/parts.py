"""What the files of the command line share."""

import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click


def seconds(
    context: click.Context, parameter: click.Parameter, value: float | None
) -> float | None:
    """A time that is not negative, nor infinite, for an option; raises BadParameter."""
    if value is not None and not 0.0 <= value < math.inf:
        raise click.BadParameter(f"{value:g}: seconds from 0 on")
    return value


Command = TypeVar("Command", bound=Callable[..., Any] | click.Command)

OVERRIDE = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change one key of the scenario, e.g. planner.alpha=1.5 (repeatable).",
)
JSON = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
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

LOG = click.option(
    "--log",
    type=click.Choice(["text", "json"]),
    help="Log to stderr, news and alarms too, instead of showing the run.",
)


def seconds_option(name: str, words: str) -> Callable[[Command], Command]:
    """An option in seconds from 0 on; its name is --NAME, its parameter NAME_s."""
    key = f"{name.removeprefix('--')}_s"
    return click.option(name, key, type=float, callback=seconds, metavar="S", help=words)


LOG_LEVEL = click.option(
    "--log-level",
    type=click.Choice(["debug", "info", "warning", "error"]),
    default="info",
    show_default=True,
)


def folder(out: Path) -> Path:
    """A folder that files can be written to, made if need be; raises MissionServiceError."""
    from tempfile import TemporaryFile

    from mission_service.errors import MissionServiceError
    from mission_service.journal.private_files import FOLDER_MODE

    try:
        out.mkdir(FOLDER_MODE, parents=True, exist_ok=True)
    except OSError as error:
        raise MissionServiceError(f"{out}: cannot be made: {error.strerror}") from None
    try:
        with TemporaryFile(dir=out):  # told now, not after an hour of burning
            pass
    except OSError as error:
        raise MissionServiceError(f"{out}: cannot be written to: {error.strerror}") from None
    return out


def echo(result: dict[str, Any], as_json: bool) -> None:
    """Print a result, as JSON or a line a key."""
    if as_json:
        click.echo(json.dumps(result))
    else:
        click.echo("\n".join(f"{key}: {value}" for key, value in result.items()))


def tell_address(out: Path, address: str) -> None:
    """Where the map is. The token in it is for a person's eyes, not for a log."""
    if sys.stderr.isatty():
        click.echo(f"map: {address}", err=True)
    else:
        place, own_token, _ = address.partition("#")
        whose = (
            f"its token is in {out / 'token'}" if own_token else "with a token of the tokens file"
        )
        click.echo(f"map: {place} ({whose})", err=True)


def reporter(form: str | None, level: str, as_json: bool) -> Callable[[Any, Any], None]:
    """What shows a run: a log, set up here, if there is to be one; else lines and a status."""
    if form is None:
        from mission_service.runtime.progress import LiveReport

        return LiveReport(quiet=as_json)
    from mission_service.runtime.logs import set_up

    set_up(form, level)  # type: ignore[arg-type]  # click has checked it
    return lambda record, world: record.news.clear()  # they are logged from the picture
