"""Defines ``mission-service replay`` for logged flights and journals.

Heavy modules are imported only when the command runs.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mission_service.cli.options import (
    OVERRIDE,
    ReportOptions,
    is_given,
    report_options,
    seconds_option,
)
from mission_service.cli.output_folder import output_folder, refuse_run_folder
from mission_service.runtime.clocks import now_text

if TYPE_CHECKING:
    from mission_service.replay.flights.flight_logs import Flight
    from mission_service.replay.flights.scenario_pairing import ScenarioChoice

STAGE_NAMES = ("file", "fire", "planner", "core")


@dataclass(frozen=True, kw_only=True)
class ReplayOptions(ReportOptions):
    """The options of ``replay``."""

    scenario: str | None
    rule: str | None
    at_s: float | None
    from_s: float | None
    to_s: float | None
    out: Path | None
    verify: bool
    stages: tuple[str, ...]
    changes: tuple[str, ...]
    speed: str | None
    listen: str | None
    until_end: bool
    overrides: tuple[str, ...]

    def check(self, words: tuple[str, ...]) -> None:
        """Raise UsageError for options and arguments that are mutually exclusive."""
        if self.verify and self.changes:
            raise click.UsageError("--verify and --what-if cannot be combined")
        if self.stages and not self.verify:
            raise click.UsageError("--stage requires --verify")
        if (self.verify or self.changes) and (self._of_logs() or self.speed):
            raise click.UsageError(
                "--verify and --what-if need a complete journal and cannot be combined with "
                "other options"
            )
        if self.verify and (len(words) > 1 or self.out is not None):
            raise click.UsageError("--verify needs one journal and writes no files")
        if self.speed is None and (self.listen or self.until_end or self.log):
            raise click.UsageError("--listen, --until-end and --log require --speed")

    def _of_logs(self) -> bool:
        given = (self.scenario, self.rule, self.from_s, self.overrides)
        return self.at_s is not None or self.to_s is not None or any(given)


@click.command()
@click.argument("words", nargs=-1, required=True, metavar="[NAME=]LOG...")
@click.option(
    "--scenario", metavar="SCENARIO", help="Scenario for logs; a journal contains a scenario."
)
@click.option("--planner", "rule", metavar="RULE", help="Planner rule (default: the scenario's).")
@seconds_option("--at", "Mission time at which the logs begin.")
@seconds_option("--from", "Start of the replay, in seconds after the start of the flight.")
@seconds_option("--to", "End of the replay, in seconds after the start of the flight.")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), help="Folder for files.")
@click.option("--verify", is_flag=True, help="Recompute a journal, stage by stage.")
@click.option(
    "--stage",
    "stages",
    type=click.Choice(STAGE_NAMES),
    multiple=True,
    help="With --verify: only this stage (repeatable; default: all).",
)
@click.option(
    "--what-if",
    "changes",
    multiple=True,
    metavar="KEY=VALUE",
    help="Repeat a journal's run in the simulator with another value of a [planner] key "
    "(repeatable; arguments after LOG may be further settings); planner=RULE sets the rule.",
)
@click.option(
    "--speed",
    metavar="X",
    help="Play on the map and over MQTT at 0.1 to 100 times real time, or max.",
)
@click.option("--listen", metavar="HOST:PORT", help="With --speed: address of the map.")
@click.option("--until-end", is_flag=True, help="With --speed: exit at the end instead of pausing.")
@OVERRIDE
@report_options
def replay(words: tuple[str, ...], **values: Any) -> None:
    """Replay logged flights: the flown paths, and the decisions that a planner would have made.

    A LOG is a .tlog, .bin or .ulg file, a journal, or the folder of a run with its journal. A
    journal contains the scenario of the run. Logs with the same NAME belong to one vehicle. --out
    is the folder for the report, its pictures and the journal of the replay.

    --speed 10 shows the flight on the map and over MQTT like a live run, until Ctrl-C, with the
    observations and decisions that the service would have made. The replay accepts pause and seek,
    and refuses orders.

    --verify recomputes a journal; the exit code is 1 if anything differs. The stage "file" checks
    the checksum of each line. The stage "fire" compares the cameras' observations with those in a
    new simulation of the fire. The stage "planner" recomputes the decisions from the recorded
    observations, and the stage "core" recomputes all commands; both stages compare bit for bit.

    --what-if planner=predictive alpha=1.5 --out DIR flies a journal's scenario again with mock
    autopilots and these settings. One page compares both runs.
    """
    if values["scenario"] is None and not is_given("overrides"):
        values["overrides"] = ()  # MISSION_SERVICE_SET is for scenarios, and changes no journal
    options = ReplayOptions(**values)
    options.check(words)
    from mission_service.replay.flights.batch import run_name
    from mission_service.replay.flights.flight_logs import flight_of, path_of
    from mission_service.replay.flights.journal_log import journal_in
    from mission_service.replay.flights.scenario_pairing import ScenarioChoice

    if options.verify:
        _verify(journal_in(Path(words[0])), options.stages, options.as_json)
        return
    if options.changes:
        if options.out is None:
            raise click.UsageError("--what-if needs --out DIR")
        changes = (*options.changes, *words[1:])
        _what_if(journal_in(Path(words[0])), changes, options.out, options.as_json)
        return
    if options.out is not None:
        refuse_run_folder(options.out, [path_of(word) for word in words])
    to_s = math.inf if options.to_s is None else options.to_s
    flight = flight_of(words)._replace(from_s=options.from_s or 0.0, to_s=to_s)
    choice = ScenarioChoice(options.scenario, options.rule, options.at_s, options.overrides)
    if options.speed is None:
        name = run_name([path_of(word) for word in words])
        _batch(flight, name, choice, options.out, options.as_json)
        return
    from mission_service.cli.replay_live import play

    play(flight, choice, options.speed, options)


def _batch(
    flight: "Flight", name: str, choice: "ScenarioChoice", out: Path | None, as_json: bool
) -> None:
    from mission_service.replay.flights.batch import analysis_of, analysis_with_fire
    from mission_service.replay.flights.flight_logs import survey
    from mission_service.replay.flights.report_page import write_report
    from mission_service.replay.flights.run_figures import figures_of, in_text
    from mission_service.replay.flights.scenario_pairing import (
        ScenarioChoice,
        chosen_scenario,
        pair,
    )

    found = None if choice == ScenarioChoice() else chosen_scenario(flight, choice)
    if found is None and choice.at_s is not None:
        raise click.UsageError("--at is a mission time of a scenario; add --scenario")
    if found is None:
        analysis, made = analysis_of(name, flight), out and output_folder(out)
    else:
        pairing = pair(flight, survey(flight), found[0], choice.at_s)
        made = out and output_folder(out)
        analysis = analysis_with_fire(name, pairing, made, now_text())
    files = write_report(made, [analysis]) if made else []
    figures = figures_of(analysis)
    if as_json:
        click.echo(json.dumps(figures))
        return
    click.echo(in_text([figures]))
    if files:
        click.echo(f"Wrote {', '.join(files)} to {out}/")


def _verify(journal: Path, stages: tuple[str, ...], as_json: bool) -> None:
    from mission_service.replay.verification import as_json as for_programs
    from mission_service.replay.verification import in_text, verify

    found = verify(journal, stages=stages)
    click.echo(json.dumps(for_programs(found)) if as_json else in_text(found))
    if found.differing:
        stages_that_differ = ", ".join(found.differing)
        raise click.ClickException(
            f"{journal}: {stages_that_differ}: first difference in {found.difference}"
        )


def _what_if(journal: Path, words: tuple[str, ...], out: Path, as_json: bool) -> None:
    from dataclasses import asdict

    from mission_service.journal.reader import JournalReader
    from mission_service.replay.flights.batch import analysis_of
    from mission_service.replay.flights.flight_logs import flight_of
    from mission_service.replay.flights.report_page import write_report
    from mission_service.replay.what_if import in_text, what_if, with_settings
    from mission_service.runtime.progress import SimProgress

    scenario, _ = with_settings(JournalReader(journal), words)  # checked before files are written
    with SimProgress(scenario.name, scenario.duration_s, as_json) as progress:
        found = what_if(journal, words, output_folder(out), now_text(), progress)
    runs = {"recorded": journal, "what-if": out}
    write_report(out, [analysis_of(name, flight_of([str(path)])) for name, path in runs.items()])
    if as_json:
        click.echo(json.dumps({**asdict(found), "out": str(out)}))
    else:
        click.echo(f"{in_text(found)}\nWrote report, journal, GeoJSON, map and summary to {out}/")
