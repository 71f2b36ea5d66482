"""``mission-service replay-live``: a logged flight on the map. Heavy imports wait."""

import contextlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mission_service.cli_parts import JSON, LOG, LOG_LEVEL, OVERRIDE, folder, tell_address

if TYPE_CHECKING:
    from mission_service.flights.player import Replaying
    from mission_service.flights.playing import Speed
    from mission_service.service_config import ServiceSection


def speed_of(text: str) -> "Speed":
    """The speed that is written so. Raises BadParameter."""
    from mission_service.errors import RequestError
    from mission_service.flights.playing import checked_speed

    try:
        return "max" if text == "max" else checked_speed(float(text))
    except (ValueError, RequestError):
        raise click.BadParameter(f"{text}: from 0.1 to 100, or max", param_hint="--speed") from None


def replaying(
    logs: tuple[str, ...],
    scenario: str | None,
    at_s: float | None,
    from_s: float,
    to_s: float | None,
    overrides: tuple[str, ...],
) -> "tuple[Replaying, ServiceSection]":
    """What is played, and how the service is run. Raises MissionServiceError and BridgeError.

    Without a scenario: a journal's own, else level ground around the flight.
    """
    from mission_service.config import flying, load_run, run_of
    from mission_service.fire_setup import landscape_of
    from mission_service.flights.journal_log import JournalLog
    from mission_service.flights.plain_scenario import plain_scenario
    from mission_service.flights.played import flight_of, survey
    from mission_service.flights.player import Replaying, part_of
    from mission_service.flights.shadow import check_place, mission_time, scenario_for

    flight = flight_of(logs)
    told = survey(flight)
    first = flight.logs[0]
    plain = scenario is None and not isinstance(first, JournalLog)
    if scenario is not None:
        loaded, settings = load_run(scenario, overrides)
    else:
        own = plain_scenario(flight, told, first.path.stem)
        if isinstance(first, JournalLog):
            own = first.scenario
        loaded, settings = run_of(own.model_dump(mode="json"), first.path, overrides)
    mission = mission_time(flight, told, loaded, 0.0 if plain and at_s is None else at_s)
    flown = flying(scenario_for(loaded, told, mission))
    if plain:  # nobody is sent to a fire that there is not
        flown = flown.model_copy(update={"deploy_at_s": loaded.deploy_at_s})
    landscape = landscape_of(flown)
    check_place(told, landscape, flown.name)
    begin_us, end_us = part_of(told, from_s, to_s)
    return Replaying(flight, told, mission, flown, landscape, begin_us, end_us), settings


@click.command("replay-live")
@click.argument("logs", nargs=-1, required=True, metavar="[NAME=]LOG...")
@click.option("--scenario", help="Default: a journal's own, else level ground without a fire.")
@click.option("--speed", default="1", show_default=True, help="0.1 to 100 times, or max.")
@click.option("--at", "at_s", type=float, help="Mission time of the flight's begin, in seconds.")
@click.option("--from", "from_s", type=float, default=0.0, help="Seconds from the flight's begin.")
@click.option("--to", "to_s", type=float, help="Seconds from the flight's begin.")
@click.option("--listen", metavar="HOST:PORT", help="Where the map is; default: any free port.")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), help="Keep the journal.")
@click.option("--until-end", is_flag=True, help="End there, instead of pausing.")
@OVERRIDE
@LOG
@LOG_LEVEL
@JSON
def replay_live(
    logs: tuple[str, ...],
    scenario: str | None,
    speed: str,
    at_s: float | None,
    from_s: float,
    to_s: float | None,
    listen: str | None,
    out: Path | None,
    until_end: bool,
    overrides: tuple[str, ...],
    log: str | None,
    log_level: str,
    as_json: bool,
) -> None:
    """Play logged flights on the map and over MQTT, as a live run is seen; until Ctrl-C.

    What the service would have seen and decided beside them is shown. Nothing can be ordered.
    """
    import asyncio
    from datetime import UTC, datetime
    from functools import partial
    from tempfile import TemporaryDirectory

    from mission_service.flights.live import Show, serve_flight
    from mission_service.outputs import summary_of, write_outputs

    times = speed_of(speed)
    what, settings = replaying(logs, scenario, at_s, from_s, to_s, overrides)
    settings = _with_map(settings, listen)
    now = datetime.now(UTC).isoformat(timespec="seconds")
    with contextlib.ExitStack() as stack:
        kept = out or Path(stack.enter_context(TemporaryDirectory(prefix="replay-")))
        made = folder(kept)
        show = Show(what, made, now, settings, times, until_end, logs=log is not None)
        report = _reporter(log, log_level, as_json)
        record, world = asyncio.run(serve_flight(show, report, partial(tell_address, made)))
        if out is not None:
            summary = write_outputs(made, what.scenario, record, world.fire)
        else:
            summary = summary_of(what.scenario, record, world.fire)
    if as_json:
        click.echo(json.dumps(summary))
    elif out is not None:
        click.echo(f"journal, GeoJSON, map and summary in {out}/")


def _with_map(settings: "ServiceSection", listen: str | None) -> "ServiceSection":
    """The settings with a map, on a port of its own unless they say which."""
    from pydantic import ValidationError

    from mission_service.errors import MissionServiceError
    from mission_service.service_config import HttpSection

    told = {} if settings.http is None else settings.http.model_dump()
    if listen is not None or settings.http is None:
        told["listen"] = listen or "127.0.0.1:0"
    try:
        http = HttpSection.model_validate(told)
    except ValidationError as error:
        words = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise MissionServiceError(f"--listen {listen}: {words}") from None
    return settings.model_copy(update={"http": http})


def _reporter(form: Any, level: str, as_json: bool) -> Callable[[Any, Any], None]:
    from mission_service.logs import set_up
    from mission_service.report import LiveReport

    if form is None:
        return LiveReport(quiet=as_json)
    set_up(form, level)
    return lambda record, world: record.news.clear()
