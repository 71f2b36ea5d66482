"""Defines ``mission-service experiment``, which repeats experiments from published papers.

Heavy modules are imported only when a command runs.
"""

import json
from pathlib import Path
from typing import Literal

import click

from mission_service.cli.options import JSON, FiniteRange, progress_line
from mission_service.cli.output_folder import output_folder

OUT = click.option(
    "-o",
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Write the figures to this folder, as PNG.",
)


@click.group()
def experiment() -> None:
    """Repeat experiments from published papers and compare the results."""


@experiment.command("islam-hu")
@OUT
@JSON
def islam_hu(out: Path | None, as_json: bool) -> None:
    """Repeat Islam & Hu, section VI: reversals and distance error of one vehicle on six fires."""
    from mission_service.experiments.islam_hu.run import run
    from mission_service.experiments.islam_hu.tables import in_text

    found = run(output_folder(out) if out else None, progress=progress_line)
    click.echo(json.dumps(found) if as_json else in_text(found))


@experiment.command()
@OUT
@click.option(
    "--speed",
    "speed_m_s",
    type=FiniteRange(0.5, 100),
    default=3.3,
    show_default=True,
    help="Speed of the vehicles in m/s; at 3.3 the costs are about as high as in the thesis.",
)
@click.option(
    "--spread",
    type=click.Choice(["maximum", "outward"]),
    default="maximum",
    show_default=True,
    help="Rate of spread used as the weight of a cell: the maximum over all directions, as in the "
    "thesis, or the rate along the normal of the front.",
)
@JSON
def bent(
    out: Path | None, speed_m_s: float, spread: Literal["maximum", "outward"], as_json: bool
) -> None:
    """Repeat ch. 5 of Bent's thesis (tables 5.1 to 5.4): teams of 2 to 6 vehicles on one fire."""
    from mission_service.experiments.bent.run import run
    from mission_service.experiments.bent.tables import in_text

    found = run(output_folder(out) if out else None, speed_m_s, progress_line, spread)
    click.echo(json.dumps(found) if as_json else in_text(found))


@experiment.command("virtual-agents")
@OUT
@JSON
def virtual_agents(out: Path | None, as_json: bool) -> None:
    """Repeat table 2 of the virtual agents paper: six metrics for four or eight fixed-wing UAVs."""
    from mission_service.experiments.virtual_agents.run import run
    from mission_service.experiments.virtual_agents.tables import in_text

    found = run(output_folder(out) if out else None, progress=progress_line)
    click.echo(json.dumps(found) if as_json else in_text(found))


@experiment.command()
@OUT
@JSON
def beachly(out: Path | None, as_json: bool) -> None:
    """Repeat Beachly et al., sec. VI and VII: ignition lines and corrections of a fire model."""
    from mission_service.experiments.beachly.run import run
    from mission_service.experiments.beachly.tables import in_text

    found = run(output_folder(out) if out else None, progress_line)
    click.echo(json.dumps(found) if as_json else in_text(found))
