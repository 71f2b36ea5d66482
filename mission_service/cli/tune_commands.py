"""Defines ``mission-service tune``, which searches for planner constants.

Heavy modules are imported only when a command runs.
"""

import json
from pathlib import Path

import click

from mission_service.cli.options import JSON, Cores, cores_option, progress_line


@click.group()
def tune() -> None:
    """Search for the constants of planners."""


@tune.command("virtual-agents")
@cores_option("processes")
@click.option("--population", type=click.IntRange(4), default=50, show_default=True)
@click.option("--generations", type=click.IntRange(1), default=200, show_default=True)
@click.option("--seed", type=int, default=3, show_default=True)
@click.option(
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write the constants and the record of the search to this file, as JSON.",
)
@JSON
def virtual_agents(
    cores: Cores,
    population: int,
    generations: int,
    seed: int,
    out: Path | None,
    as_json: bool,
) -> None:
    """Search for the constants of virtual forces with a genetic algorithm (paper, 5.2.6)."""
    from mission_service.errors import MissionServiceError
    from mission_service.experiments import tuning

    pool = (
        tuning.on_cluster(cores.scheduler, seed)
        if cores.scheduler
        else tuning.on_cores(cores.workers, seed)
    )
    with pool as evaluate:
        found = tuning.tune(evaluate, seed, population, generations, progress_line)
    if out:
        try:
            out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            raise MissionServiceError(f"{out}: cannot be written: {error.strerror}") from None
    if as_json:
        click.echo(json.dumps(found))
    else:
        click.echo(f"fitness: {found['fitness']:.4f}")
        click.echo("\n".join(f"{name}: {value}" for name, value in found["constants"].items()))
