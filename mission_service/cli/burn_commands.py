"""Defines the commands of ``mission-service burn`` for a prescribed burn."""

import json
import time
from pathlib import Path
from typing import Any

import click

from mission_service.cli.options import (
    JSON,
    OUT_REQUIRED,
    OVERRIDE,
    FiniteRange,
    echo,
)
from mission_service.cli.output_folder import output_folder
from mission_service.cli.request_commands import (
    OUT,
    RequestGroup,
    only_station,
    print_reply,
    proposed_plan,
    request,
    user_options,
)

WATCH_EVERY_S = 1.0


def _burn_requests() -> dict[str, Any]:
    from mission_service.guidance.burn.requests import REQUESTS
    from mission_service.requests import OF_EVERY_RUN, Lit, name_of

    return {"light" if kind is Lit else name_of(kind): kind for kind in OF_EVERY_RUN + REQUESTS}


@click.group(cls=RequestGroup, table=_burn_requests)
def burn() -> None:
    """Show, approve, correct and stop a live prescribed burn."""


@burn.command()
@OUT
@JSON
def status(out: Path, as_json: bool) -> None:
    """Show the plan, the plan's approvals, the GO/NO-GO checklist and the vehicle."""
    from mission_service.guidance.burn.plan_summary import describe_status
    from mission_service.interfaces.control.control_client import ControlClient

    with ControlClient(out) as client:
        shown = client.ask(do="status")["status"]
    click.echo(json.dumps(shown) if as_json else "\n".join(describe_status(shown)))


@burn.command()
@click.option("--every", "every_s", type=FiniteRange(0.2, 10), default=WATCH_EVERY_S)
@user_options
def watch(out: Path, by: str, station: str | None, as_json: bool, every_s: float) -> None:
    """Show the state every second and report the user's presence to the service, until Ctrl-C.

    An approval is valid only while a user is present at the station of the approval.
    """
    from mission_service.guidance.burn.plan_summary import describe_status
    from mission_service.interfaces.control.control_client import ControlClient

    with ControlClient(out) as client:
        station = station or only_station(client)
        try:
            while True:
                client.ask(do="present", by=by, station=station)
                shown = client.ask(do="status")["status"]
                if as_json:
                    click.echo(json.dumps(shown))
                else:
                    click.clear()
                    presence = f"{by} at {station} is present"
                    click.echo("\n".join([*describe_status(shown), presence]))
                time.sleep(every_s)
        except KeyboardInterrupt:
            click.echo(f"{by} at {station} is no longer present", err=True)


@burn.command()
@click.argument("hash_", metavar="HASH")
@click.option("--yes", is_flag=True, help="Do not prompt.")
@user_options
def approve(out: Path, by: str, station: str | None, as_json: bool, hash_: str, yes: bool) -> None:
    """Show a summary of plan HASH (8 or more first digits), and approve the plan if confirmed."""
    from mission_service.errors import RequestError
    from mission_service.guidance.burn.plan_summary import describe_plan
    from mission_service.interfaces.control.control_client import ControlClient

    with ControlClient(out) as client:
        station = station or only_station(client)
        shown = client.ask(do="status")["status"]
        proposed, name = proposed_plan(shown, hash_)
        click.echo("\n".join(describe_plan(proposed, name)), err=as_json)
        if shown["open_items"]:
            items = "; ".join(shown["open_items"])
            raise RequestError(f"the GO/NO-GO checklist must be complete first; open: {items}")
        if not yes and not click.confirm(f"Approve this plan as {by} at {station}?", err=as_json):
            raise RequestError("not approved")
        print_reply(client.ask(do="approve", by=by, station=station, hash=name), as_json)


request.add_command(approve)


@burn.command()
@click.argument("config")
@OUT_REQUIRED
@OVERRIDE
@JSON
def preview(config: str, out: Path, overrides: tuple[str, ...], as_json: bool) -> None:
    """Plan the whole burn in CONFIG; show lines, loads, spheres, duration and expected fire."""
    from mission_service.config.scenario import load_scenario
    from mission_service.guidance.burn.preview import preview as run

    echo(run(load_scenario(config, overrides), output_folder(out)), as_json)
