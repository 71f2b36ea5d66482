"""Plays a logged flight on the map, for ``mission-service replay --speed``.

Heavy modules are imported only when the command runs.
"""

import contextlib
import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mission_service.cli.options import report_address
from mission_service.cli.output_folder import output_folder

if TYPE_CHECKING:
    from mission_service.cli.replay_commands import ReplayOptions
    from mission_service.config.service_section import ServiceSection
    from mission_service.replay.flights.flight_logs import Flight
    from mission_service.replay.flights.scenario_pairing import Pairing, ScenarioChoice
    from mission_service.runtime.play_head import Speed


def speed_of(text: str) -> "Speed":
    """Parse a speed from 0.1 to 100 times real time, or ``max``. Raises BadParameter."""
    from mission_service.errors import RequestError
    from mission_service.runtime.play_head import checked_speed

    try:
        return "max" if text == "max" else checked_speed(float(text))
    except (ValueError, RequestError):
        raise click.BadParameter(
            f"{text}: must be 0.1 to 100, or max", param_hint="--speed"
        ) from None


def played(flight: "Flight", choice: "ScenarioChoice") -> "tuple[Pairing, ServiceSection]":
    """Return the replay of a flight and the interface settings.

    Without a scenario, the landscape is level ground around the flight. Raises MissionServiceError
    and BridgeError.
    """
    from mission_service.config.scenario import run_of
    from mission_service.replay.flights.flight_logs import survey
    from mission_service.replay.flights.journal_log import JournalLog
    from mission_service.replay.flights.scenario_pairing import (
        chosen_scenario,
        fireless_scenario,
        pair,
    )

    found, first = survey(flight), flight.logs[0]
    if choice.scenario is not None or isinstance(first, JournalLog):
        scenario = chosen_scenario(flight, choice)
        assert scenario is not None
        loaded, settings = scenario
        return pair(flight, found, loaded, choice.at_s), settings
    plain = fireless_scenario(found, first.path.stem).model_dump(mode="json")
    loaded, settings = run_of(plain, first.path, choice.overrides)
    replay = pair(flight, found, loaded, choice.at_s or 0.0)
    # The scenario without a fire deploys its vehicles only after the end of the flight.
    undeployed = replay.scenario.model_copy(update={"deploy_at_s": loaded.deploy_at_s})
    return replay._replace(scenario=undeployed), settings


def play(flight: "Flight", choice: "ScenarioChoice", speed: str, options: "ReplayOptions") -> None:
    """Play logged flights on the map and over MQTT like a live run, until Ctrl-C.

    The interfaces show the observations and decisions that the service would have made, and refuse
    orders.
    """
    import asyncio
    from functools import partial
    from tempfile import TemporaryDirectory

    from mission_service.replay.flights.replay_server import ReplayRun, serve_flight
    from mission_service.runtime.clocks import now_text
    from mission_service.runtime.run_outputs import summary_of, write_outputs

    factor, out = speed_of(speed), options.out
    replay, settings = played(flight, choice)
    settings = _with_map(settings, options.listen)
    with contextlib.ExitStack() as stack:
        made = output_folder(out or Path(stack.enter_context(TemporaryDirectory(prefix="replay-"))))
        show = ReplayRun(
            replay, made, now_text(), settings, factor, options.until_end, options.logs
        )
        serving = serve_flight(show, options.progress(), partial(report_address, made))
        record, fire = asyncio.run(serving)
        if out is not None:
            summary = write_outputs(made, replay.scenario, record, fire)
        else:
            summary = summary_of(replay.scenario, record, fire)
    if options.as_json:
        click.echo(json.dumps(summary))
    elif out is not None:
        click.echo(f"Wrote journal, GeoJSON, map and summary to {out}/")


def _with_map(settings: "ServiceSection", listen: str | None) -> "ServiceSection":
    """Return the settings with a map at ``listen``, or at the configured or default address."""
    from pydantic import ValidationError

    from mission_service.config.service_section import HttpSection
    from mission_service.errors import MissionServiceError

    section = {} if settings.http is None else settings.http.model_dump()
    if listen is not None:
        section["listen"] = listen
    try:
        http = HttpSection.model_validate(section)
    except ValidationError as error:
        words = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise MissionServiceError(f"--listen {listen}: {words}") from None
    return settings.model_copy(update={"http": http})
