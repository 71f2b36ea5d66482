"""``mission-service replay``: logged flights and journals. Heavy imports wait."""

import json
import math
from pathlib import Path
from typing import NamedTuple

import click

from mission_service.cli_parts import JSON, OVERRIDE, folder
from mission_service.clocks import now_text

STAGE_NAMES = ("file", "fire", "planner", "core")


@click.command()
@click.argument("words", nargs=-1, required=True, metavar="[NAME=]LOG...")
@click.option("--scenario", metavar="SCENARIO", help="The fire beside logs, and who watches it.")
@click.option("--planner", "rule", metavar="RULE", help="Another rule than the scenario's.")
@click.option("--at", "at_s", type=float, metavar="S", help="Mission time at which logs begin.")
@click.option("--from", "from_s", type=float, default=0.0, metavar="S", help="Since the beginning.")
@click.option("--to", "to_s", type=float, default=math.inf, metavar="S", help="As --from.")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), help="For all files.")
@click.option("--verify", is_flag=True, help="Recompute what a journal has, stage by stage.")
@click.option(
    "--stage",
    "stages",
    type=click.Choice(STAGE_NAMES),
    multiple=True,
    help="With --verify: only this one (repeatable; default: all).",
)
@click.option(
    "--what-if",
    "changes",
    multiple=True,
    metavar="KEY=VALUE",
    help="Fly a journal again in the simulator with another key of [planner] (repeatable; more may "
    "follow as words); planner=RULE is the rule.",
)
@OVERRIDE
@JSON
def replay(
    words: tuple[str, ...],
    scenario: str | None,
    rule: str | None,
    at_s: float | None,
    from_s: float,
    to_s: float,
    out: Path | None,
    verify: bool,
    stages: tuple[str, ...],
    changes: tuple[str, ...],
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Replay logged flights: what was flown, and what a scenario's planner would have done.

    A LOG is a .tlog, .bin or .ulg, or a journal (or its run's folder), which has a scenario of its
    own. Those of one NAME are of one vehicle. With --out a report, its pictures and the journal of
    what the core made of it are left there.

    --verify: exit code 1 where anything in a journal differs. file: every line's checksum. fire:
    what cameras saw, in the fire burned again. planner: decisions on the recorded observations.
    core: all commands, bit for bit.

    --what-if planner=predictive alpha=1.5 --out DIR: a journal's scenario flown again by mock
    autopilots, and both runs in figures and on one page.
    """
    if verify and changes:
        raise click.UsageError("either --verify or --what-if")
    if stages and not verify:
        raise click.UsageError("--stage is for --verify")
    of_logs = scenario or rule or at_s is not None or from_s or to_s != math.inf or overrides
    if (verify or changes) and of_logs:
        raise click.UsageError("--verify and --what-if take a whole journal as it is")
    if verify and (len(words) > 1 or out is not None):
        raise click.UsageError("--verify takes one journal, and leaves no files")
    from mission_service.flights.journal_log import journal_in

    if verify:
        _verify(journal_in(Path(words[0])), stages, as_json)
    elif changes:
        if out is None:
            raise click.UsageError("--what-if needs --out DIR")
        _what_if(journal_in(Path(words[0])), (*changes, *words[1:]), out, as_json)
    else:
        part = (from_s, to_s)
        _batch(words, part, Asked(scenario, rule, at_s, overrides), out, as_json)


class Asked(NamedTuple):
    """What logs are to be replayed beside."""

    scenario: str | None
    rule: str | None
    at_s: float | None
    overrides: tuple[str, ...]


def _batch(
    words: tuple[str, ...], part: tuple[float, float], asked: Asked, out: Path | None, as_json: bool
) -> None:
    from mission_service.flights.batch import beside, called, story_of
    from mission_service.flights.figures import figures_of, in_text
    from mission_service.flights.played import flight_of, path_of
    from mission_service.flights.report_page import write_report

    flight = flight_of(words)._replace(from_s=part[0], to_s=part[1])
    scenario = beside(flight, *asked)
    made = None if out is None else folder(out)
    story = story_of(called(path_of(words[0])), flight, scenario, made, now_text())
    files = [] if made is None else write_report(made, [story])
    figures = figures_of(story)
    if as_json:
        click.echo(json.dumps(figures))
        return
    click.echo(in_text([figures]))
    if made is not None:
        click.echo(f"{', '.join(files)} in {out}/")


def _verify(journal: Path, stages: tuple[str, ...], as_json: bool) -> None:
    from mission_service.replay import as_json as for_programs
    from mission_service.replay import in_text, verify

    found = verify(journal, stages=stages)
    click.echo(json.dumps(for_programs(found)) if as_json else in_text(found))
    if found.differing:
        where = f"{', '.join(found.differing)}: first difference in {found.difference}"
        raise click.ClickException(f"{journal}: {where}")


def _what_if(journal: Path, words: tuple[str, ...], out: Path, as_json: bool) -> None:
    from dataclasses import asdict

    from mission_service.recorded import Recorded
    from mission_service.report import SimProgress
    from mission_service.what_if import in_text, what_if, with_settings

    scenario, _ = with_settings(Recorded(journal), words)  # before anything is made
    with SimProgress(scenario.name, scenario.duration_s, as_json) as progress:
        found = what_if(journal, words, folder(out), now_text(), progress)
    _side_by_side(journal, out)
    if as_json:
        click.echo(json.dumps({**asdict(found), "out": str(out)}))
    else:
        click.echo(f"{in_text(found)}\nreport, journal, GeoJSON, map and summary in {out}/")


def _side_by_side(journal: Path, out: Path) -> None:
    from mission_service.flights.batch import story_of
    from mission_service.flights.played import flight_of
    from mission_service.flights.report_page import write_report

    runs = {"recorded": journal, "what-if": out}
    stories = [
        story_of(name, flight_of([str(path)]), None, None, now_text())
        for name, path in runs.items()
    ]
    write_report(out, stories)
