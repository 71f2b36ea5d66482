"""``mission-service experiment``: the papers' experiments. Heavy imports wait for a command."""

import json
from pathlib import Path

import click

from mission_service.cli.parts import JSON, folder

OUT = click.option(
    "-o",
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Write the figures there, as PNG.",
)


def _progress(text: str) -> None:
    click.echo(text, err=True)


@click.group()
def experiment() -> None:
    """The papers' experiments, their results beside ours."""


@experiment.command("islam-hu")
@OUT
@JSON
def islam_hu(out: Path | None, as_json: bool) -> None:
    """One vehicle on six fires, section VI of Islam & Hu: reversals over alpha, distance error."""
    from mission_service.experiments.islam_hu.run import run
    from mission_service.experiments.islam_hu.tables import in_text

    found = run(folder(out) if out else None, progress=_progress)
    click.echo(json.dumps(found) if as_json else in_text(found))


@experiment.command()
@OUT
@click.option(
    "--speed",
    "speed_m_s",
    type=click.FloatRange(0.5, 100),
    default=1.5,
    show_default=True,
    help="Of the vehicles, in m/s; at 1.5 costs are as high as the thesis's.",
)
@JSON
def bent(out: Path | None, speed_m_s: float, as_json: bool) -> None:
    """Teams of 2 to 6 on one fire, chapter 5 of Bent's thesis: tables 5.1 to 5.4."""
    from mission_service.experiments.bent.run import run
    from mission_service.experiments.bent.tables import in_text

    found = run(folder(out) if out else None, speed_m_s, _progress)
    click.echo(json.dumps(found) if as_json else in_text(found))


@experiment.command("virtual-agents")
@OUT
@JSON
def virtual_agents(out: Path | None, as_json: bool) -> None:
    """Four or eight fixed wings over virtual agents, table 2 of that paper: six metrics."""
    from mission_service.experiments.virtual_agents.run import run
    from mission_service.experiments.virtual_agents.tables import in_text

    found = run(folder(out) if out else None, progress=_progress)
    click.echo(json.dumps(found) if as_json else in_text(found))


@experiment.command()
@OUT
@JSON
def beachly(out: Path | None, as_json: bool) -> None:
    """Ignition lines in four scenarios, and corrections of a fire model: sections VI and VII."""
    from mission_service.experiments.beachly.run import run
    from mission_service.experiments.beachly.tables import in_text

    found = run(folder(out) if out else None, _progress)
    click.echo(json.dumps(found) if as_json else in_text(found))
