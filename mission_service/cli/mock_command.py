"""Defines ``mission-service mock``, which runs mock autopilots in a separate process.

Heavy modules are imported only when the command runs.
"""

from dataclasses import dataclass, replace
from typing import Any

import click

from mission_service.cli.options import SIGNING_KEY, FiniteRange, refuse_given


@dataclass(frozen=True, kw_only=True)
class MockOptions:
    """The options of ``mock``."""

    stack: str
    vehicle: str | None
    count: int
    system_id: int
    home: str
    link: tuple[str, ...]
    listen: str | None
    speedup: float
    wind: str
    battery_minutes: float | None
    terrain_amsl_m: float | None
    faults: tuple[str, ...]
    parameters: tuple[str, ...]
    seed: int
    signing_key: str | None
    as_json: bool
    until_eof: bool


@click.command()
@click.argument("scenario", required=False)
@click.option("--stack", type=click.Choice(["px4", "ardupilot"]), default="px4")
@click.option(
    "--vehicle",
    help="plane, vtol or copter; with SCENARIO, the name of one of its vehicles (default: all "
    "vehicles, on their links; with --link or --listen, the first vehicle).",
)
@click.option("--count", type=click.IntRange(1, 250), default=1, help="Number of vehicles.")
@click.option(
    "--system-id", type=click.IntRange(1, 250), default=1, help="System id of the first vehicle."
)
@click.option("--home", default="36.6,-84.2,300", help="Home as LAT,LON,ALTITUDE_AMSL_M.")
@click.option(
    "--link",
    multiple=True,
    help="Default: udpout:127.0.0.1:14550; with SCENARIO, the vehicle's links in the scenario. A "
    "second --link is a second telemetry port of the same vehicles.",
)
@click.option("--listen", help="Instead of --link: listen on HOST:PORT (UDP), udpin or tcpin.")
@click.option("--speedup", type=FiniteRange(0.1, 100), default=1.0, show_default=True)
@click.option("--wind", default="0,0", help="A steady wind as FROM_DEG,SPEED_M_S, e.g. 240,5.")
@click.option(
    "--battery",
    "battery_minutes",
    type=FiniteRange(0.1, 10_000),
    metavar="MINUTES",
    help="Battery capacity in minutes of flight; at 15 % the vehicle returns home.",
)
@click.option(
    "--terrain",
    "terrain_amsl_m",
    type=FiniteRange(-500, 9000),
    metavar="AMSL_M",
    help="Height of the flat ground; a vehicle that flies below it crashes.",
)
@click.option(
    "--fault",
    "faults",
    multiple=True,
    metavar="FAULT",
    help="Inject a fault (repeatable), e.g. reboot@30; see docs/autopilots.md.",
)
@click.option(
    "--param",
    "parameters",
    multiple=True,
    metavar="NAME=VALUE",
    help="Set a parameter of the autopilot (repeatable), e.g. MIS_TKO_LAND_REQ=0.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Seed of random faults.")
@SIGNING_KEY
@click.option("--json", "as_json", is_flag=True, help="Print each vehicle as JSON.")
@click.option("--until-eof", is_flag=True, hidden=True)  # set only by ``demo``
def mock(scenario: str | None, **values: Any) -> None:
    """Run mock autopilots in a separate process, until Ctrl-C.

    With SCENARIO, the mocks are the vehicles of the scenario, on the ground at their homes. Without
    SCENARIO, --count sets the number of mocks, whose system ids are consecutive. A mock with a key
    signs its frames. The key is from --signing-key, from SCENARIO or from a SETUP_SIGNING message.
    """
    from mission_service.simulation.mock_processes import (
        MockEnvironment,
        MocksOnLink,
        by_hand,
        from_scenario,
        listening,
        read_parameters,
        read_wind,
        run,
    )

    options = MockOptions(**values)
    vehicle = options.vehicle
    if options.listen and options.link:
        raise click.UsageError("specify either --link or --listen")
    if scenario:
        refuse_given(
            *("stack", "system_id", "home"), reason="with a scenario, which defines its vehicles"
        )
    if scenario and options.count > 1:
        raise click.UsageError("--count cannot be combined with a scenario")
    if not scenario and vehicle not in (None, "plane", "vtol", "copter"):
        raise click.UsageError(
            f"--vehicle {vehicle}: without a scenario, use plane, vtol or copter"
        )
    environment = MockEnvironment(
        read_wind(options.wind),
        options.battery_minutes,
        options.terrain_amsl_m,
        options.faults,
        options.seed,
        read_parameters(options.parameters),
    )
    links = (listening(options.listen),) if options.listen else options.link
    if scenario:
        mocks = from_scenario(scenario, vehicle, links, environment)
    else:
        kind, first = vehicle or "plane", options.system_id
        fleet = by_hand(options.stack, kind, first, options.home, options.count, environment)
        mocks = [MocksOnLink(fleet, links or ("udpout:127.0.0.1:14550",))]
    if options.signing_key is not None:
        mocks = [replace(each, signing_key=options.signing_key) for each in mocks]
    run(mocks, options.speedup, options.as_json, click.echo, options.until_eof)
