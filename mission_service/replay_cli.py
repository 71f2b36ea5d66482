"""``mission-service replay``: a journal verified, or flown again with other settings."""

import json
from pathlib import Path

import click

from mission_service.cli_parts import JSON

STAGE_NAMES = ("file", "fire", "planner", "core")


@click.command()
@click.argument("journal", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--verify", is_flag=True, help="Recompute what the journal has, stage by stage.")
@click.option(
    "--stage",
    "stages",
    type=click.Choice(STAGE_NAMES),
    multiple=True,
    help="With --verify: only this one (repeatable; default: all).",
)
@JSON
def replay(journal: Path, verify: bool, stages: tuple[str, ...], as_json: bool) -> None:
    """Verify a journal; exit code 1 where anything differs.

    file: every line's checksum. fire: what cameras saw, in the fire burned again. planner:
    decisions on the recorded observations. core: all commands, bit for bit.
    """
    if not verify:
        raise click.UsageError("say what to do with the journal: --verify")
    _verify(journal, stages, as_json)


def _verify(journal: Path, stages: tuple[str, ...], as_json: bool) -> None:
    from mission_service.replay import as_json as for_programs
    from mission_service.replay import in_text, verify

    found = verify(journal, stages=stages)
    click.echo(json.dumps(for_programs(found)) if as_json else in_text(found))
    if found.differing:
        where = f"{', '.join(found.differing)}: first difference in {found.difference}"
        raise click.ClickException(f"{journal}: {where}")
