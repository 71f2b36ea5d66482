"""``mission-service burn``: what a crew tells a live burn. Heavy imports wait for a command."""

import getpass
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from mission_service.cli.parts import JSON, OVERRIDE, echo, folder

WATCH_EVERY_S = 1.0
# A latitude may begin with a minus.
PLACES = {"ignore_unknown_options": True}


def a_place(text: str) -> tuple[float, float]:
    """LAT,LON in degrees; what they may be is for the service to say."""
    try:
        lat_deg, lon_deg = (float(part) for part in text.split(","))
    except ValueError:
        words = f"{text!r}: write it as LAT,LON in degrees, as in 36.35,-84.16"
        raise click.BadParameter(words) from None
    return lat_deg, lon_deg


OUT = click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("out"),
    show_default=True,
    help="The folder of the run.",
)


def crew(command: Callable[..., None]) -> Callable[..., None]:
    """The options of all that a person does."""
    by = click.option("--by", default=_login, metavar="NAME", help="Default: the login name.")
    station = click.option(
        "--station", metavar="NAME", help="Where you are; default: the only one there is."
    )
    return OUT(by(station(JSON(command))))


def _login() -> str:
    return getpass.getuser()


def _tell(
    out: Path, by: str, station: str | None, as_json: bool, do: str, **request: Any
) -> dict[str, Any]:
    """Send one request; prints what was said in answer."""
    from mission_service.interfaces.control.client import Control

    with Control(out) as there:
        answer = there.ask(do=do, by=by, station=station or _only_station(there), **request)
    _print(answer, as_json)
    return answer


def _only_station(there: Any) -> str:
    from mission_service.errors import RequestError

    stations = there.ask(do="status")["status"]["stations"]
    if len(stations) != 1:
        raise RequestError(f"say where you are with --station: {', '.join(stations)}")
    return str(stations[0])


def _print(answer: dict[str, Any], as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps(answer))
    else:
        click.echo("\n".join(answer["said"]) or f"{answer['event']}: told")


@click.group()
def burn() -> None:
    """A prescribed burn under way: what a crew sees, approves, corrects and stops."""


@burn.command()
@OUT
@JSON
def status(out: Path, as_json: bool) -> None:
    """Show plan, approvals, GO list and vehicle."""
    from mission_service.guidance.burn.plan_summary import describe_status
    from mission_service.interfaces.control.client import Control

    with Control(out) as there:
        told = there.ask(do="status")["status"]
    click.echo(json.dumps(told) if as_json else "\n".join(describe_status(told)))


@burn.command()
@click.option("--every", "every_s", type=click.FloatRange(0.2, 10), default=WATCH_EVERY_S)
@crew
def watch(out: Path, by: str, station: str | None, as_json: bool, every_s: float) -> None:
    """Show the state each second, and be there for the service, until Ctrl-C.

    An approval holds only while somebody of its station is there.
    """
    from mission_service.guidance.burn.plan_summary import describe_status
    from mission_service.interfaces.control.client import Control

    with Control(out) as there:
        where = station or _only_station(there)
        try:
            while True:
                there.ask(do="present", by=by, station=where)
                told = there.ask(do="status")["status"]
                if as_json:
                    click.echo(json.dumps(told))
                else:
                    click.clear()
                    click.echo("\n".join([*describe_status(told), f"{by} at {where} is there"]))
                time.sleep(every_s)
        except KeyboardInterrupt:
            click.echo(f"{by} at {where} watches no more", err=True)


@burn.command()
@click.option("--line-spacing", "line_spacing_m", type=float, metavar="M", help="From now on.")
@click.option("--drop-spacing", "drop_spacing_m", type=float, metavar="M", help="From now on.")
@crew
def plan(
    out: Path,
    by: str,
    station: str | None,
    as_json: bool,
    line_spacing_m: float | None,
    drop_spacing_m: float | None,
) -> None:
    """Have the next line planned."""
    spacings = {"line_spacing_m": line_spacing_m, "drop_spacing_m": drop_spacing_m}
    given = {name: value for name, value in spacings.items() if value is not None}
    _tell(out, by, station, as_json, "plan", **given)


@burn.command()
@click.argument("hash_", metavar="HASH")
@click.option("--yes", is_flag=True, help="Do not ask.")
@crew
def approve(out: Path, by: str, station: str | None, as_json: bool, hash_: str, yes: bool) -> None:
    """Approve the plan HASH (at least its first 8 digits): it shows what that is, and asks."""
    from mission_service.errors import RequestError
    from mission_service.guidance.burn.plan_summary import describe_plan
    from mission_service.interfaces.control.client import Control

    with Control(out) as there:
        where = station or _only_station(there)
        told = there.ask(do="status")["status"]
        proposed, name = _proposed(told, hash_)
        click.echo("\n".join(describe_plan(proposed, name)), err=as_json)
        if told["open_items"]:
            items = "; ".join(told["open_items"])
            raise RequestError(f"the GO list comes first; open: {items}")
        if not yes and not click.confirm(f"Approve it as {by} at {where}?", err=as_json):
            raise RequestError("not approved")
        _print(there.ask(do="approve", by=by, station=where, hash=name), as_json)


def _proposed(told: dict[str, Any], digits: str) -> tuple[Any, str]:
    """The plan whose hash begins so, and its whole hash, worked out anew from what is shown."""
    import msgspec

    from mission_service.errors import RequestError
    from mission_service.ignition_plan import IgnitionPlan, plan_hash

    if len(digits) < 8:
        raise RequestError(f"{digits}: give at least the first 8 digits of the plan's hash")
    found = [each for each in told["plans"] if each["plan_hash"].startswith(digits.lower())]
    if len(found) != 1:
        there = ", ".join(each["plan_hash"][:12] for each in told["plans"]) or "none"
        many = "no plan" if not found else "more than one plan"
        raise RequestError(f"{digits}: {many} proposed begins so; there are: {there}")
    proposed = msgspec.convert(found[0]["plan"], IgnitionPlan)
    name = plan_hash(proposed)
    if name != found[0]["plan_hash"]:
        raise RequestError(f"{digits}: the plan shown is not the one of this hash; not approved")
    return proposed, name


@burn.command()
@click.argument("hash_", metavar="HASH")
@crew
def reject(out: Path, by: str, station: str | None, as_json: bool, hash_: str) -> None:
    """Reject the plan HASH (at least its first 8 digits)."""
    from mission_service.interfaces.control.client import Control

    with Control(out) as there:
        where = station or _only_station(there)
        _, name = _proposed(there.ask(do="status")["status"], hash_)
        _print(there.ask(do="reject", by=by, station=where, hash=name), as_json)


@burn.command()
@crew
def abort(out: Path, by: str, station: str | None, as_json: bool) -> None:
    """Stop at once: no further drop, climb to the safe height and hold."""
    _tell(out, by, station or "unknown", as_json, "abort")


@burn.command()
@click.argument("item", nargs=-1, required=True)
@crew
def go(out: Path, by: str, station: str | None, as_json: bool, item: tuple[str, ...]) -> None:
    """GO to ITEM of the list (its number, its words or their beginning; or: all)."""
    _answer(out, by, station, as_json, "go", item)


@burn.command("no-go")
@click.argument("item", nargs=-1, required=True)
@crew
def no_go(out: Path, by: str, station: str | None, as_json: bool, item: tuple[str, ...]) -> None:
    """NO-GO to ITEM of the list: nothing is dropped until it has its GO and a new approval."""
    _answer(out, by, station, as_json, "no-go", item)


def _answer(
    out: Path, by: str, station: str | None, as_json: bool, do: str, words: tuple[str, ...]
) -> None:
    from mission_service.interfaces.control.client import Control

    with Control(out) as there:
        where = station or _only_station(there)
        items = there.ask(do="status")["status"]["items"]
        for item in _items(items, " ".join(words)):
            _print(there.ask(do=do, by=by, station=where, item=item), as_json)


def _items(items: list[str], text: str) -> list[str]:
    """What is meant by a number from 1, the beginning of an item, or ``all``."""
    from mission_service.errors import RequestError

    if text == "all":
        return items
    if text.isdigit() and 1 <= int(text) <= len(items):
        return [items[int(text) - 1]]
    found = [item for item in items if item.lower().startswith(text.lower())]
    if len(found) != 1:
        numbered = "; ".join(f"{number} {item}" for number, item in enumerate(items, start=1))
        raise RequestError(f"{text}: which item of the list? {numbered}")
    return found


@burn.command(context_settings=PLACES)
@click.argument("state", type=click.Choice(["burned", "burning", "unburned"]))
@click.argument("places", type=a_place, metavar="LAT,LON...", nargs=-1, required=True)
@click.option(
    "--shape",
    type=click.Choice(["point", "line", "polygon"]),
    help="Default: a point for one place, a line for more.",
)
@click.option(
    "--in",
    "in_s",
    type=float,
    default=0.0,
    metavar="SECONDS",
    help="When it is so; negative: when it was. Default: now.",
)
@crew
def correct(
    out: Path,
    by: str,
    station: str | None,
    as_json: bool,
    state: str,
    places: tuple[tuple[float, float], ...],
    shape: str | None,
    in_s: float,
) -> None:
    """Say where the fire is: STATE at LAT,LON, along a line or in a polygon."""
    drawn = shape or ("point" if len(places) == 1 else "line")
    told = {"state": state, "shape": drawn, "points": places, "in_s": in_s}
    _tell(out, by, station, as_json, "correct", **told)


@burn.command(context_settings=PLACES)
@click.argument("places", type=a_place, metavar="LAT,LON...", nargs=-1, required=True)
@click.option("--ago", "ago_s", type=float, default=0.0, metavar="SECONDS", help="Default: now.")
@crew
def light(
    out: Path,
    by: str,
    station: str | None,
    as_json: bool,
    places: tuple[tuple[float, float], ...],
    ago_s: float,
) -> None:
    """Tell that the crew has lit LAT,LON, or a line through several."""
    _tell(out, by, station, as_json, "lit", points=places, ago_s=ago_s)


@burn.command(context_settings=PLACES)
@click.argument("place", type=a_place, metavar="LAT,LON")
@click.option("--radius", "radius_m", type=float, required=True, metavar="M")
@crew
def erase(
    out: Path,
    by: str,
    station: str | None,
    as_json: bool,
    place: tuple[float, float],
    radius_m: float,
) -> None:
    """Take away corrections around LAT,LON."""
    where = {"lat_deg": place[0], "lon_deg": place[1], "radius_m": radius_m}
    _tell(out, by, station, as_json, "erase", **where)


@burn.command()
@crew
def undo(out: Path, by: str, station: str | None, as_json: bool) -> None:
    """Take the last correction or erasure back."""
    _tell(out, by, station, as_json, "undo")


@burn.command()
@crew
def redo(out: Path, by: str, station: str | None, as_json: bool) -> None:
    """Let what was taken back last hold again."""
    _tell(out, by, station, as_json, "redo")


@burn.command()
@click.argument("speed_m_s", type=float)
@click.argument("from_deg", type=float)
@crew
def wind(
    out: Path, by: str, station: str | None, as_json: bool, speed_m_s: float, from_deg: float
) -> None:
    """Tell the wind from now on: SPEED_M_S at 6.1 m (20 ft), FROM_DEG true."""
    _tell(out, by, station, as_json, "wind", speed_m_s=speed_m_s, from_deg=from_deg)


@burn.command(context_settings=PLACES)
@click.argument("name")
@click.argument("place", type=a_place, metavar="LAT,LON")
@click.option("--radius", "radius_m", type=float, metavar="M", help="To be kept clear.")
@click.option("--gone", is_flag=True, help="Is no longer there.")
@crew
def person(
    out: Path,
    by: str,
    station: str | None,
    as_json: bool,
    name: str,
    place: tuple[float, float],
    radius_m: float | None,
    gone: bool,
) -> None:
    """Tell that NAME is at LAT,LON: nothing is dropped, nothing flown low around."""
    if gone == (radius_m is not None):
        raise click.UsageError("give either --radius or --gone")
    where = {"name": name, "lat_deg": place[0], "lon_deg": place[1], "radius_m": radius_m or 0.0}
    _tell(out, by, station, as_json, "person", **where)


@burn.command(context_settings=PLACES)
@click.argument("corners", type=a_place, metavar="LAT,LON...", nargs=-1, required=True)
@crew
def unit(
    out: Path,
    by: str,
    station: str | None,
    as_json: bool,
    corners: tuple[tuple[float, float], ...],
) -> None:
    """Change the burn unit to the polygon of these corners, LAT,LON each."""
    _tell(out, by, station, as_json, "unit", points=corners)


@burn.command()
@click.argument("config")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), required=True)
@OVERRIDE
@JSON
def preview(config: str, out: Path, overrides: tuple[str, ...], as_json: bool) -> None:
    """Plan the whole burn of CONFIG to its end: lines, loads, spheres, time, fire to come."""
    from mission_service.config.scenario import load_scenario
    from mission_service.guidance.burn.preview import preview as run

    echo(run(load_scenario(config, overrides), folder(out)), as_json)
