"""``mission-service replay``: a journal verified, or flown again with other settings."""

import json
from pathlib import Path

import click

from mission_service.cli_parts import JSON, folder
from mission_service.clocks import now_text

STAGE_NAMES = ("file", "fire", "planner", "core")


@click.command()
@click.argument("journal", type=click.Path(dir_okay=False, path_type=Path))
@click.argument("settings", nargs=-1, metavar="[KEY=VALUE]...")
@click.option("--verify", is_flag=True, help="Recompute what the journal has, stage by stage.")
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
    help="Fly it again in the simulator with another key of [planner] (repeatable; more may "
    "follow as words); planner=RULE is the rule.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="With --what-if: the folder of the new flight.",
)
@JSON
def replay(
    journal: Path,
    settings: tuple[str, ...],
    verify: bool,
    stages: tuple[str, ...],
    changes: tuple[str, ...],
    out: Path | None,
    as_json: bool,
) -> None:
    """Verify a journal, or fly it again with other settings.

    --verify: exit code 1 where anything differs. file: every line's checksum. fire: what cameras
    saw, in the fire burned again. planner: decisions on the recorded observations. core: all
    commands, bit for bit.

    --what-if planner=predictive alpha=1.5 --out DIR: the scenario flown again by mock autopilots,
    and both runs in figures.
    """
    if verify == bool(changes):
        raise click.UsageError("say what to do with the journal: --verify or --what-if KEY=VALUE")
    if settings and not changes:
        raise click.UsageError(f"{settings[0]}: is for --what-if")
    if stages and not verify:
        raise click.UsageError("--stage is for --verify")
    if (out is None) == bool(changes):
        raise click.UsageError("--what-if needs --out DIR, and nothing else does")
    if out is None:
        _verify(journal, stages, as_json)
    else:
        _what_if(journal, (*changes, *settings), out, as_json)


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
    if as_json:
        click.echo(json.dumps({**asdict(found), "out": str(out)}))
    else:
        click.echo(f"{in_text(found)}\njournal, GeoJSON, map and summary in {out}/")
