"""Provides options and functions shared by the command-line modules."""

import json
import logging
import math
import os
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from functools import partial, wraps
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import click

SCHEDULER = re.compile(r"((tcp|tls|ws|wss)://)?([^\s:/\[\]]+|\[[\da-fA-F:.]+\]):\d{1,5}")


def seconds(
    context: click.Context, parameter: click.Parameter, value: float | None
) -> float | None:
    """Return a finite option value of 0 s or more; raise BadParameter for any other value."""
    if value is not None and not 0.0 <= value < math.inf:
        raise click.BadParameter(f"{value:g}: must be 0 s or more")
    return value


def scheduler_address(
    context: click.Context, parameter: click.Parameter, value: str | None
) -> str | None:
    """Return a valid address of a Dask scheduler; raise BadParameter for any other value."""
    if value is not None and SCHEDULER.fullmatch(value) is None:
        raise click.BadParameter(f"{value!r}: must be HOST:PORT, as in tcp://10.0.0.1:8786")
    return value


class Folder(click.Path):
    """The path of a folder, which may be missing."""

    def __init__(self) -> None:
        super().__init__(file_okay=False, path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path; refuse empty text, which ``Path`` treats as the working folder."""
        if value == "":
            self.fail("is empty; specify a folder, or . for the working folder", param, ctx)
        return super().convert(value, param, ctx)


class FiniteRange(click.FloatRange):
    """A finite number within limits; ``FloatRange`` accepts nan within any limits."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number; refuse nan and infinity."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


Command = TypeVar("Command", bound=Callable[..., Any] | click.Command)

OVERRIDE = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    envvar="MISSION_SERVICE_SET",
    show_envvar=True,
    help="Change one key of the scenario, e.g. planner.alpha=1.5 (repeatable).",
)
# Settings of ``demo`` and ``run`` from environment variables: MISSION_SERVICE_OUT is --out.
SETTINGS = {"auto_envvar_prefix": "MISSION_SERVICE"}
LOCAL_PORT = click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    show_default="a free port",
    help="Port on loopback.",
)
JSON = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
OUT = click.option("--out", type=Folder(), default=Path("out"))
OUT_REQUIRED = click.option("--out", type=Folder(), required=True)
OUT_NEW = click.option(
    "--out", type=Folder(), help="Default: a new folder named out/SCENARIO-TIME."
)
OUT_FOLDER = click.option("-o", "--out", type=Folder(), required=True, metavar="DIR")
SIGNING_KEY = click.option(
    "--signing-key",
    metavar="file:PATH|env:NAME",
    help="Source of the key that signs and verifies frames (MAVLink 2 signing).",
)
TLOG = click.option(
    "--tlog",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Append the traffic of the links to this .tlog file.",
)


def seconds_option(name: str, words: str) -> Callable[[Command], Command]:
    """Return a decorator that adds the option ``--NAME`` (0 s or more) as parameter ``NAME_s``."""
    key = f"{name.removeprefix('--')}_s"
    return click.option(name, key, type=float, callback=seconds, metavar="S", help=words)


@dataclass(frozen=True, kw_only=True)
class ReportOptions:
    """The values of ``report_options``, which determine the display of progress and results."""

    log: str | None
    log_level: str
    as_json: bool

    def __post_init__(self) -> None:
        if self.log is None:
            refuse_given("log_level", reason="without --log")

    @property
    def logs(self) -> bool:
        """Whether the command writes a log."""
        return self.log is not None

    def notice(self) -> Callable[[str], None]:
        """Return the function that shows a line about the start of the run.

        The line appears in the log, or without a log in the progress display.
        """
        if self.log is not None:
            return logging.getLogger("mission_service").info
        return partial(click.echo, err=self.as_json)

    def progress(self) -> Callable[[Any, Any], None]:
        """Return the function that shows progress; with a log, this function shows nothing."""
        if self.log is None:
            from mission_service.runtime.progress import LiveReport

            return LiveReport(quiet=self.as_json)
        from mission_service.runtime.engine import unshown
        from mission_service.runtime.service_log import set_up

        set_up(self.log, self.log_level)  # type: ignore[arg-type]  # click has checked it
        return unshown  # the log contains the announcements


def report_options(command: Command) -> Command:
    """Add the options --log, --log-level and --json to a command, in this order."""
    log = click.option(
        "--log",
        type=click.Choice(["text", "json"]),
        help="Log to stderr, with announcements and alarms, instead of the progress display.",
    )
    level = click.option(
        "--log-level",
        type=click.Choice(["debug", "info", "warning", "error"]),
        default="info",
        show_default=True,
    )
    return log(level(JSON(command)))


class Cores(NamedTuple):
    """The workers of a command, on a Dask cluster or on this machine.

    ``scheduler`` is the address of the Dask scheduler. Without a scheduler, ``workers`` threads or
    processes run on this machine.
    """

    scheduler: str | None
    workers: int


def cores_option(workers: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds --workers and --scheduler to a command, as argument ``cores``.

    ``workers`` is the noun for the workers on this machine: threads or processes.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @click.option(
            "--workers",
            type=click.IntRange(1),
            default=os.cpu_count() or 1,
            help=f"Number of {workers} on this machine [default: one per core].",
        )
        @click.option(
            "--scheduler",
            metavar="ADDRESS",
            callback=scheduler_address,
            help="Compute on the workers of this Dask scheduler, e.g. tcp://10.0.0.1:8786.",
        )
        @wraps(command)
        def with_cores(scheduler: str | None, workers: int, **arguments: Any) -> None:
            command(cores=Cores(scheduler, workers), **arguments)

        return with_cores

    return decorate


def is_given(name: str) -> bool:
    """Return whether a parameter of the current command is given on the command line."""
    source = click.get_current_context().get_parameter_source(name)
    return source is click.core.ParameterSource.COMMANDLINE


def refuse_given(*names: str, reason: str) -> None:
    """Raise UsageError if a parameter without effect is given on the command line.

    Args:
        names: Names of parameters of the current command.
        reason: Why they have no effect, such as ``without --log``.
    """
    for parameter in click.get_current_context().command.params:
        if parameter.name in names and is_given(parameter.name):
            option = parameter.opts[0]
            raise click.UsageError(f"{option} has no effect {reason}; leave it out")


def echo(result: dict[str, Any], as_json: bool) -> None:
    """Print a result as JSON, or as one line for each key, without ``warnings``."""
    if as_json:
        click.echo(json.dumps(result))
    else:
        shown = (f"{key}: {value}" for key, value in result.items() if key != "warnings")
        click.echo("\n".join(shown))


def echo_warning(text: str) -> None:
    """Print a warning to stderr."""
    click.echo(f"Warning: {text}", err=True)


def report_address(out: Path, address: str, fragment: str = "") -> None:
    """Print the address of the map; the token is printed only on a terminal, never to a log.

    ``fragment`` is the part of the printed address after ``#``.
    """
    if sys.stderr.isatty():
        sign = "&" if "#" in address else "#"
        click.echo(f"map: {address}{sign if fragment else ''}{fragment}", err=True)
    else:
        url, own_token, _ = address.partition("#")
        source = (
            f"its token is in {out / 'token'}" if own_token else "use a token from the tokens file"
        )
        shown = f"{url}#{fragment}" if fragment else url
        click.echo(f"map: {shown} ({source})", err=True)


def progress_line(text: str) -> None:
    """Print a progress line to stderr."""
    click.echo(text, err=True)


def aware_time(
    context: click.Context, parameter: click.Parameter, value: str | None
) -> datetime | None:
    """Return an ISO 8601 time with a UTC offset; raise BadParameter for any other value."""
    if value is None:
        return None
    try:
        found = datetime.fromisoformat(value)
    except ValueError:
        found = None
    if found is None or found.tzinfo is None:
        raise click.BadParameter(
            f"{value!r}: must contain a date, a time and a UTC offset, such as "
            "2026-08-01T14:00-06:00"
        )
    return found
