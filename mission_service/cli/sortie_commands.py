"""Defines ``mission-service sortie``, which plans continuous watches."""

import json
import math
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mission_service.cli.options import JSON, OVERRIDE, Command
from mission_service.errors import OptionError

if TYPE_CHECKING:
    from firemodel.landscape.landscape import Landscape
    from mission_service.config.scenario import Scenario
    from mission_service.relief.watch import ReliefPlan, Watch, WatchAircraft

MAX_BATTERIES = 500
DAY_S = 24 * 3600


def _duration_option(
    name: str, unit_s: float, limits_s: tuple[int, int], default: float, words: str
) -> Callable[[Command], Command]:
    """Return a decorator that adds an option in a given unit, converted to whole seconds."""

    def in_seconds(context: click.Context, parameter: click.Parameter, value: float) -> int:
        low_s, high_s = limits_s
        if not low_s <= value * unit_s <= high_s:
            low, high = low_s / unit_s, high_s / unit_s
            raise click.BadParameter(f"{value:g}: must be a number from {low:g} to {high:g}")
        return math.ceil(value * unit_s)

    return click.option(
        name, type=float, callback=in_seconds, default=default, show_default=True, help=words
    )


@click.group()
def sortie() -> None:
    """Plan the relief of aircraft on task."""


@sortie.command("plan")
@click.argument("scenario")
@_duration_option("--hours", 3600.0, (60, 7 * DAY_S), 12.0, "Length of the watch.")
@click.option(
    "--on-task",
    type=click.IntRange(1, 50),
    default=1,
    show_default=True,
    help="Number of aircraft that must be on task at all times.",
)
@click.option(
    "--batteries",
    required=True,
    metavar="NUMBER",
    help="Number of batteries, charged at the start, that fit all aircraft; or numbers by kind, "
    "e.g. plane=4,copter=2.",
)
@click.option(
    "--chargers",
    type=click.IntRange(0, 100),
    default=1,
    show_default=True,
    help="Number of batteries that can be charged at the same time.",
)
@_duration_option("--charge-min", 60.0, (0, DAY_S), 60.0, "Charging time of a battery.")
@_duration_option(
    "--swap-min",
    60.0,
    (0, DAY_S),
    5.0,
    "Time on the ground to exchange the battery and to inspect the aircraft.",
)
@_duration_option(
    "--overlap-min", 60.0, (0, DAY_S), 2.0, "Time on task of both aircraft at a relief."
)
@_duration_option(
    "--spacing-s", 1.0, (0, 600), 60.0, "Minimum time between two takeoffs or landings at a home."
)
@click.option(
    "--task",
    "place",
    metavar="LAT,LON",
    help="Position of the task (default: the reported position of the fire).",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Draw the timeline as this picture (PNG).",
)
@OVERRIDE
@JSON
def sortie_plan(
    scenario: str,
    place: str | None,
    output: Path | None,
    overrides: tuple[str, ...],
    as_json: bool,
    batteries: str,
    **means: int,
) -> None:
    """Plan the sorties and batteries that keep aircraft on task over the fire of SCENARIO.

    Print the time for which the watch can be kept up, the resource that runs out first, and the
    smallest number of additional batteries, chargers or aircraft that prevents this. Each vehicle
    needs its endurance_s in SCENARIO.
    """
    from mission_service.cli.plan_command import check_picture
    from mission_service.config.scenario import flying, load_scenario
    from mission_service.fire.scenario_fire import fire_position, landscape_of
    from mission_service.relief.bottleneck import smallest_addition
    from mission_service.relief.plan_words import summary
    from mission_service.relief.relief_plan import plan_watch
    from mission_service.relief.scenario_aircraft import scenario_aircraft
    from mission_service.simulation.relief_picture import draw_relief

    if output is not None:
        check_picture(output)
    pools = _pools(batteries)
    loaded = flying(load_scenario(scenario, overrides))
    landscape = landscape_of(loaded)
    task_m = fire_position(loaded, landscape) if place is None else _position(place, landscape)
    shared = isinstance(pools, int)
    aircraft = scenario_aircraft(loaded, landscape, task_m, means["hours"], shared)
    watch = _watch(loaded, aircraft, pools, means)
    plan = plan_watch(watch)
    addition = smallest_addition(watch) if plan.lapses else None
    words = summary(watch, plan, addition)
    if output is not None:
        draw_relief(output, watch, plan, loaded.name, words)
    if as_json:
        shown = {key: value for key, value in asdict(plan).items() if key not in _TUPLES}
        shown |= {key: [each._asdict() for each in getattr(plan, key)] for key in _TUPLES}
        added = None if addition is None else asdict(addition)
        click.echo(json.dumps({"summary": words, "addition": added, **shown}))
    else:
        click.echo(_text(watch, plan, words))


_TUPLES = ("sorties", "charges", "lapses")


def _text(watch: "Watch", plan: "ReliefPlan", words: str) -> str:
    """Return the aircraft, the table of sorties, the coverage, and the summary."""
    from mission_service.relief.plan_words import aircraft_line, clock, table

    lines = [aircraft_line(watch, each) for each in watch.aircraft]
    if plan.sorties:
        lines += ["", table(plan)]
    lines += [
        "",
        f"the watch begins at {clock(plan.begins_s)}; {100.0 * plan.coverage:.1f} % covered",
    ]
    return "\n".join([*lines, words])


def _watch(
    scenario: "Scenario",
    aircraft: "tuple[WatchAircraft, ...]",
    pools: int | dict[str, int],
    means: dict[str, int],
) -> "Watch":
    """Return the watch with these means; raise OptionError for batteries that fit no aircraft."""
    from mission_service.relief.scenario_aircraft import SHARED
    from mission_service.relief.watch import Watch

    batteries = {SHARED: pools} if isinstance(pools, int) else pools
    needed = {each.pool for each in aircraft}
    if needed != batteries.keys():
        kinds = " and ".join(sorted(needed))
        raise OptionError(
            f"--batteries: the vehicles of {scenario.name} need batteries for {kinds}; specify "
            f"{','.join(f'{kind}=NUMBER' for kind in sorted(needed))}"
        )
    return Watch(
        aircraft=aircraft,
        batteries=tuple(sorted(batteries.items())),
        chargers=means["chargers"],
        charge_s=means["charge_min"],
        swap_s=means["swap_min"],
        overlap_s=means["overlap_min"],
        spacing_s=means["spacing_s"],
        on_task=means["on_task"],
        duration_s=means["hours"],
    )


def _pools(text: str) -> int | dict[str, int]:
    """Return a number of batteries for all aircraft, or for each kind. Raises OptionError."""
    parts = [part.strip().rpartition("=") for part in text.split(",")]
    kinds = [kind.strip() for kind, _, _ in parts]
    valid = all(n.isascii() and n.isdecimal() and 1 <= int(n) <= MAX_BATTERIES for _, _, n in parts)
    if valid and "=" not in text and len(parts) == 1:
        return int(parts[0][2])
    if not valid or len(set(kinds)) < len(kinds) or not set(kinds) <= {"plane", "vtol", "copter"}:
        raise OptionError(
            f"--batteries {text}: specify a number from 1 to {MAX_BATTERIES}, or a number for "
            "each kind, e.g. plane=4,copter=2"
        )
    return {kind: int(n) for kind, (_, _, n) in zip(kinds, parts, strict=True)}


def _position(text: str, landscape: "Landscape") -> tuple[float, float]:
    """Return a position (x, y) within the landscape. Raises OptionError."""
    try:
        lat_deg, lon_deg = (float(part) for part in text.split(","))
        valid = abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0
    except ValueError:
        valid = False
    if not valid:
        raise OptionError(f"--task {text}: specify LAT,LON in degrees, e.g. --task 36.364,-84.141")
    found = landscape.xy_of_lat_lon(lat_deg, lon_deg)
    if not landscape.contains(*found):
        raise OptionError(f"--task {text}: the position is outside the landscape")
    return found
