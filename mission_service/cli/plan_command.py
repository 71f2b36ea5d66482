"""Defines ``plan``: a first mission, or the expected error for some numbers of aircraft."""

import json
from pathlib import Path

import click

from mission_service.cli.options import JSON, OVERRIDE, FiniteRange, echo_warning, refuse_given
from mission_service.errors import OptionError


@click.command()
@click.argument("scenario")
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    help="The .plan file to write; with --what-if the picture (PNG).",
)
@click.option("--vehicle", help="Name of the vehicle (default: the first of SCENARIO).")
@click.option(
    "--fence",
    is_flag=True,
    help="Add the airspace that is closed during the whole run as a fence of the autopilot.",
)
@click.option(
    "--what-if",
    "counts",
    is_flag=False,
    flag_value="1,2,4",
    metavar="COUNTS",
    help="Print the expected error of the estimated front with these numbers of aircraft (1,2,4 if "
    "no numbers follow).",
)
@click.option(
    "--minutes",
    type=FiniteRange(10.0, 1440.0),
    default=60.0,
    show_default=True,
    help="Time after takeoff for --what-if.",
)
@OVERRIDE
@JSON
def plan(
    scenario: str,
    output: Path | None,
    vehicle: str | None,
    fence: bool,
    counts: str | None,
    minutes: float,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Write the first mission of SCENARIO as a QGroundControl .plan file.

    With --what-if, write no mission; print the expected error of the estimated front some time
    after takeoff, without aircraft and with each number of aircraft.
    """
    if counts is not None and fence:
        raise click.UsageError("--what-if writes no mission and cannot be combined with --fence")
    if counts is not None:
        _what_if(scenario, vehicle, counts, minutes, output, overrides, as_json)
        return
    refuse_given("minutes", reason="without --what-if")
    if output is None:
        raise click.UsageError("specify the .plan file to write (-o), or --what-if")
    from mission_service.simulation.demo import write_plan

    written = write_plan(scenario, vehicle, output, overrides, fence)
    for line in written.left_out:
        echo_warning(f"not in the fence: {line}")
    if as_json:
        counted = {"items": written.items, "fence_items": written.fence_items}
        click.echo(json.dumps({"plan": str(output), **counted, "left_out": written.left_out}))
    else:
        added = f", a fence of {written.fence_items} items" if fence else ""
        click.echo(f"{output}: {written.items} items{added}")


def _what_if(
    scenario: str,
    vehicle: str | None,
    counts: str,
    minutes: float,
    output: Path | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    from mission_service.config.scenario import flying, load_scenario
    from mission_service.fire.scenario_fire import landscape_of
    from mission_service.simulation.accuracy_picture import draw_accuracy
    from mission_service.simulation.demo import vehicle_of
    from mission_service.simulation.expected_accuracy import expected_accuracy, table_of

    numbers = _numbers(counts)
    if output is not None:
        check_picture(output)
    loaded = flying(load_scenario(scenario, overrides))
    section = vehicle_of(loaded, vehicle)
    landscape = landscape_of(loaded)
    found = expected_accuracy(loaded, landscape, section, numbers, minutes, echo_warning)
    if output is not None:
        draw_accuracy(output, found, landscape.cell_size_m, loaded.name, minutes)
    if as_json:
        rows = [
            {key: value for key, value in each._asdict().items() if key != "fronts"}
            for each in found
        ]
        click.echo(json.dumps({"vehicle": section.name, "minutes": minutes, "accuracy": rows}))
    else:
        click.echo(table_of(found, section.name, minutes))


def check_picture(path: Path) -> None:
    """Raise OptionError unless a PNG can be written to a path."""
    from firemodel.outputs.whole_file import check_target

    try:
        check_target(path)
    except OSError as error:
        raise OptionError(f"-o {path}: {error.strerror}; specify the path of a PNG file") from None
    if path.suffix.lower() != ".png":
        raise OptionError(f"-o {path}: the picture is a PNG; use a name that ends in .png")


def _numbers(counts: str) -> list[int]:
    """Return 0 and the given numbers of aircraft. Raises OptionError."""
    words = [word.strip() for word in counts.split(",")]
    if not all(word.isdecimal() and word.isascii() for word in words):
        raise OptionError(
            f"--what-if {counts}: specify numbers of aircraft, e.g. SCENARIO --what-if 1,2,4"
        )
    return sorted({0, *(int(word) for word in words)})
