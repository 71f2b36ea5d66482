"""Defines the command line. Heavy modules are imported only when a command runs."""

import gc
import json
import os
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import click

from mission_service import __version__
from mission_service.cli.burn_commands import burn
from mission_service.cli.experiment_commands import experiment
from mission_service.cli.fire_commands import bench, fire
from mission_service.cli.help.help_commands import completion, config_schema, man
from mission_service.cli.incident.incident_commands import incident
from mission_service.cli.incident.map_commands import map_group
from mission_service.cli.log_commands import log
from mission_service.cli.mission_commands import lost_link, mission, signing
from mission_service.cli.mock_command import mock
from mission_service.cli.observe_command import observe
from mission_service.cli.options import (
    JSON,
    OUT,
    OUT_NEW,
    OVERRIDE,
    SETTINGS,
    SIGNING_KEY,
    TLOG,
    FiniteRange,
    ReportOptions,
    echo,
    echo_warning,
    refuse_given,
    report_address,
    report_options,
)
from mission_service.cli.output_folder import Interrupted, new_folder, output_folder
from mission_service.cli.plan_command import plan
from mission_service.cli.replay_commands import replay
from mission_service.cli.report_commands import docs, products, report
from mission_service.cli.request_commands import request
from mission_service.cli.satellite_command import satellite_pixels
from mission_service.cli.sortie_commands import sortie
from mission_service.cli.token_commands import token
from mission_service.cli.tune_commands import tune
from mission_service.runtime.clocks import now_text

# Thresholds of Python's garbage collector. The first default, 700 new objects, doubles the time
# spent on collections while modules are imported. Full collections remain about as frequent.
COLLECTION_THRESHOLDS = (10_000, 3, 3)


class ErrorReportingGroup(click.Group):
    """A group of commands that prints each error of these packages on one line.

    The exit code is then 1; it is 2 if an option is wrong, and 130 after Ctrl-C.
    """

    def invoke(self, ctx: click.Context) -> Any:
        from autopilot_bridge.errors import BridgeError
        from firemodel.errors import FireModelError
        from mission_service.errors import MissionServiceError, OptionError

        own_errors = (MissionServiceError, FireModelError, BridgeError)
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise Interrupted("interrupted") from None
        except OptionError as error:
            raise click.UsageError(str(error)) from None
        except own_errors as error:
            raise click.ClickException(str(error)) from None
        except BrokenPipeError:
            raise  # click ends the command
        except OSError as error:
            raise _unwritten(error) from None
        except BaseExceptionGroup as group:
            own, others = group.split(own_errors)
            if own is None or others is not None:
                raise
            first: BaseException = own
            while isinstance(first, BaseExceptionGroup):
                first = first.exceptions[0]
            raise click.ClickException(str(first)) from None


def _unwritten(error: OSError) -> click.ClickException:
    """Return the line for a file, or for the standard output, that cannot be read or written."""
    from mission_service.errors import in_words

    if error.filename is None:  # the rest of the standard output would fail again at the exit
        sys.stdout = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
    place = error.filename or "a file or the standard output"
    return click.ClickException(f"{place}: {error.strerror or in_words(error)}")


@click.group(cls=ErrorReportingGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="mission-service")
def main() -> None:
    """Fire model, planners and MAVLink missions for PX4 and ArduPilot."""
    gc.set_threshold(*COLLECTION_THRESHOLDS)


request.add_command(satellite_pixels)

GROUPS = (
    *(fire, bench, mission, signing, lost_link, experiment, tune, burn, request, log),
    *(map_group, incident),
)
HELP = (completion, docs, man)
for command in (*GROUPS, mock, token, replay, report, products, observe, plan, sortie, *HELP):
    main.add_command(command)


@main.command(context_settings=SETTINGS)
@click.argument("scenario", default="demo")
@OUT
@click.option("--speedup", type=FiniteRange(1, 100), default=10.0, show_default=True)
@OVERRIDE
@report_options
def demo(
    scenario: str, out: Path, speedup: float, overrides: tuple[str, ...], **reporting: Any
) -> None:
    """Run the daemon with a map and mock autopilots (UDP on loopback), faster than real time.

    SCENARIO is a file or the name of a shipped scenario (default: demo).
    """
    from mission_service.config.scenario import flying, load_run
    from mission_service.config.service_section import HttpSection
    from mission_service.journal.private_files import private
    from mission_service.live.daemon import Run
    from mission_service.simulation.demo import run_demo

    loaded, settings = load_run(scenario, overrides)
    if settings.http is None:  # the demo always serves a map
        settings = settings.model_copy(update={"http": HttpSection()})
    options = ReportOptions(**reporting)
    progress = options.progress()
    journal = output_folder(out) / "journal.jsonl"
    run = Run(flying(loaded), journal, now_text(), settings, logs=options.logs, resume=False)
    with private():
        address = partial(report_address, out, fragment="tour")
        summary = run_demo(run, scenario, speedup, progress, address, options.notice())
        _finish(summary, out, options.as_json)


@main.command()
@click.argument("scenario")
@OUT_NEW
@OVERRIDE
@JSON
def sim(scenario: str, out: Path | None, overrides: tuple[str, ...], as_json: bool) -> None:
    """Fly SCENARIO (a file, or the name of a shipped scenario) in virtual time."""
    from mission_service.config.scenario import flying, load_scenario
    from mission_service.fire.scenario_check import late_times
    from mission_service.runtime.progress import SimProgress
    from mission_service.runtime.run_outputs import write_outputs
    from mission_service.simulation.sim import simulate

    loaded, created = flying(load_scenario(scenario, overrides)), now_text()
    for line in late_times(loaded):
        echo_warning(line)
    if out is None:
        out = new_folder(loaded.name, created)
        click.echo(f"results: {out}", err=True)
    made = output_folder(out)
    gc.freeze()  # full collections need not visit the objects of all modules
    with SimProgress(loaded.name, loaded.duration_s, as_json) as progress:
        record, fire = simulate(loaded, made / "journal.jsonl", created, progress)
    summary = write_outputs(made, loaded, record, fire)
    _finish(summary, out, as_json)
    flown = {each["name"] for each in summary["vehicles"] if each["in_air_s"] > 0.0}
    for number, section in enumerate(loaded.vehicles):
        if not section.autostart and section.name not in flown:
            echo_warning(
                f"{section.name} waited for a takeoff order; in a simulation, it takes off "
                f"automatically with --set vehicles.{number}.autostart=true"
            )


@dataclass(frozen=True, kw_only=True)
class RunOptions(ReportOptions):
    """The options of ``run``."""

    out: Path
    vehicle: str | None
    broker: str | None
    prefix: str
    fresh: bool
    skip_unreadable: bool
    overrides: tuple[str, ...]
    tlog: Path | None
    signing_key: str | None


@main.command(context_settings=SETTINGS)
@click.argument("config")
@OUT
@click.option(
    "--vehicle",
    metavar="NAME",
    help="Control only this vehicle; other processes control the others.",
)
@click.option(
    "--broker",
    metavar="HOST[:PORT]",
    help="Exchange messages with the vehicles of other processes over this MQTT broker "
    '(rule = "formation").',
)
@click.option(
    "--prefix", default="mission-service", show_default=True, help="Prefix of MQTT topics."
)
@click.option(
    "--fresh",
    is_flag=True,
    allow_from_autoenv=False,  # each restart would begin a new run
    help="Start a new run instead of resuming the interrupted run in OUT.",
)
@click.option(
    "--skip-unreadable",
    is_flag=True,
    allow_from_autoenv=False,
    help="On a restart, skip and report journal lines that cannot be read or applied.",
)
@OVERRIDE
@TLOG
@SIGNING_KEY
@report_options
def run(config: str, **values: Any) -> None:
    """Run the live daemon for CONFIG until the end of the scenario or Ctrl-C.

    After a kill or SIGTERM, the same command resumes the run. The journal of any other run in OUT
    is renamed.

    With --vehicle and --broker, each vehicle of a formation has a separate process.
    """
    import asyncio

    from mission_service.config.scenario import flying, load_run, one_of_many, with_signing_key
    from mission_service.interfaces.mqtt.peer_exchange import channel_of
    from mission_service.journal.private_files import private
    from mission_service.live.daemon import Run, serve
    from mission_service.runtime.run_outputs import write_outputs

    options = RunOptions(**values)
    if options.broker is None:
        refuse_given("prefix", reason="without --broker")
    loaded, settings = load_run(config, options.overrides)
    scenario = flying(loaded)
    channel = None
    if options.broker is not None:
        channel = channel_of(options.broker, options.prefix, scenario.name, settings.mqtt)
    scenario = one_of_many(scenario, options.vehicle, peer_messaging=channel is not None)
    if options.signing_key is not None:
        scenario = with_signing_key(scenario, options.signing_key)
    made = output_folder(options.out)
    progress = options.progress()
    live_run = Run(
        scenario,
        made / "journal.jsonl",
        now_text(),
        settings,
        options.tlog,
        options.logs,
        channel=channel,
        resume=not options.fresh,
        skip_unreadable=options.skip_unreadable,
    )
    with private():
        address = partial(report_address, made)
        record, fire = asyncio.run(
            serve(live_run, progress, address=address, notice=options.notice())
        )
        summary = write_outputs(made, scenario, record, fire)
        _finish(summary, options.out, options.as_json)


@main.command("decide")
@click.argument("journal", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--planner", "rule", metavar="RULE", help="Planner rule (default: the rule of the journal)."
)
@JSON
def decide_alone(journal: Path, rule: str | None, as_json: bool) -> None:
    """Run only the planners, on the positions and observations in a journal.

    If the rule is that of the journal, each decision is compared with the recorded decision, and
    the exit code is 1 if any decision differs.
    """
    from mission_service.replay.decisions import decide, in_text, summary_of

    summary = summary_of(decide(journal, rule))
    click.echo(json.dumps(summary) if as_json else in_text(summary))
    if summary["difference"] is not None:
        raise click.ClickException(f"{journal}: first difference: {summary['difference']}")


@main.group()
def config() -> None:
    """Check scenario files."""


config.add_command(config_schema)


@config.command("check")
@click.argument("file")
@OVERRIDE
@JSON
def config_check(file: str, overrides: tuple[str, ...], as_json: bool) -> None:
    """Check FILE and all files that it names."""
    from mission_service.cli.incident.file_check import checked

    summary = checked(file, overrides)
    for line in summary["warnings"]:
        echo_warning(line)
    echo({"result": "ok", **summary}, as_json)


def _finish(summary: dict[str, Any], out: Path, as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps(summary))
    closest_m, separation_m = summary["closest_pair_m"], summary["separation_m"]
    if closest_m is not None and closest_m < separation_m:
        echo_warning(
            f"two vehicles were {closest_m:.0f} m apart; mission.separation_m is {separation_m:g}"
        )
    if as_json:
        return
    for vehicle in summary["vehicles"]:
        if orders := vehicle["orders"]:
            orbits, speeds = orders.get("Orbit", 0), orders.get("ChangeSpeed", 0)
            done = f"{orbits} orbits and {speeds} speed changes ordered"
        else:
            done = f"{vehicle['in_air_s'] / 60:.0f} min in the air, {vehicle['flown_km']:.1f} km; "
            done += f"{vehicle['decisions']} decisions, {vehicle['reversals']} reversals"
        uploads = ", ".join(f"{count} {outcome}" for outcome, count in vehicle["uploads"].items())
        flown = vehicle["missions"]["flown"]
        click.echo(f"{vehicle['name']}: {done}; missions: {uploads or 'none'}, {flown} flown")
    if closest_m is not None:
        click.echo(f"smallest distance between two vehicles: {closest_m:.0f} m")
    click.echo(
        f"{summary['burned_area_ha']:.0f} ha burned at {summary['mission_time_s'] / 3600:.2f} h; "
        f"wrote journal, GeoJSON, map and summary to {out}/"
    )
