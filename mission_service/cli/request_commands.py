"""Defines ``mission-service request``, which sends operators' requests to a live run.

The table of requests (``core/request_events.py``) defines the commands, arguments and options. The
table is imported only for commands that use it.
"""

import getpass
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from mission_service.cli.options import JSON

UNITS = {"_m_s": "M/S", "_deg": "DEGREES", "_m": "M", "_s": "SECONDS"}
# Fields that an operator may omit; ``_completed`` adds them.
COMPLETED = {("correct", "shape"), ("person", "radius_m")}
Status = Callable[[], dict[str, Any]]


class Place(click.ParamType[tuple[float, float]]):
    """A position as LAT,LON in degrees; the service checks the bounds."""

    name = "place"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float]:
        """Parse latitude and longitude."""
        try:
            lat_deg, lon_deg = (float(part) for part in str(value).split(","))
        except ValueError:
            words = f"{value!r}: write it as LAT,LON in degrees, as in 36.35,-84.16"
            self.fail(words, param, ctx)
        return lat_deg, lon_deg


class NumberOrWord(click.ParamType[float | str]):
    """A number, or a word that the service checks."""

    name = "number"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float | str:
        """Parse a number, or return the word."""
        try:
            return float(value)
        except ValueError:
            return str(value)


OUT = click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("out"),
    show_default=True,
    help="The folder of the run.",
)


def user_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that all requests have: --out, --by, --station and --json."""
    by = click.option("--by", default=_login, metavar="NAME", help="Default: the login name.")
    station = click.option(
        "--station", metavar="NAME", help="Your station (default: the only station of the run)."
    )
    return OUT(by(station(JSON(command))))


def _login() -> str:
    return getpass.getuser()


def only_station(client: Any) -> str:
    """Return the only station of a run, or ``control`` for a run without stations.

    Raises RequestError if the run has several stations.
    """
    from mission_service.errors import RequestError

    stations = client.ask(do="status")["status"].get("stations", ())
    if len(stations) > 1:
        raise RequestError(f"specify your station with --station: {', '.join(stations)}")
    return str(stations[0]) if stations else "control"


def print_reply(reply: dict[str, Any], as_json: bool) -> None:
    """Print the messages and burned areas of a reply, or the whole reply as JSON.

    Raises RequestError if an order was not carried out because it needs confirmation.
    """
    from mission_service.commands import CONFIRM
    from mission_service.errors import RequestError

    questions = [line for line in reply["messages"] if line.startswith(CONFIRM)]
    messages = [line for line in reply["messages"] if line not in questions]
    if "burned_ha_before" in reply:
        before_ha, after_ha = reply["burned_ha_before"], reply["burned_ha_after"]
        messages.append(f"burned area: {before_ha:.2f} ha before, {after_ha:.2f} ha after")
    if as_json:
        click.echo(json.dumps(reply))
    elif messages or not questions:
        click.echo("\n".join(messages) or f"{reply['event']}: accepted")
    if questions:
        what = "; ".join(line.removeprefix(CONFIRM).partition(";")[0].strip() for line in questions)
        remedy = "to carry it out, repeat the command with --confirmed"
        raise RequestError(f"not carried out: {what}; {remedy}")


class RequestGroup(click.Group):
    """A group with a command for each request in a table; added commands take precedence."""

    def __init__(self, *args: Any, table: Callable[[], dict[str, Any]], **attrs: Any) -> None:
        """Store ``table``, a function that returns the requests by command name."""
        super().__init__(*args, **attrs)
        self._table = table

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands, sorted."""
        return sorted({*super().list_commands(ctx), *self._table()})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command with this name, or None."""
        own = super().get_command(ctx, cmd_name)
        kind = None if own is not None else self._table().get(cmd_name)
        return own if kind is None else command_of(kind, cmd_name)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that ``args`` begins with; an error suggests one from the table."""
        try:
            return super().resolve_command(ctx, args)
        except click.exceptions.NoSuchCommand as error:
            raise click.exceptions.NoSuchCommand(
                error.command_name, possibilities=self.list_commands(ctx), ctx=ctx
            ) from None


def _all_requests() -> dict[str, Any]:
    from mission_service.core.request_events import ALL_REQUESTS

    return dict(ALL_REQUESTS)


@click.group(cls=RequestGroup, table=_all_requests)
def request() -> None:
    """Send a request to a live run or a replay over its control socket."""


def command_of(kind: Any, name: str) -> click.Command:
    """Return the command that sends requests of this kind."""
    from msgspec import inspect

    from mission_service.requests import OPERATOR_FIELDS, name_of

    do = name_of(kind)

    def send(out: Path, by: str, station: str | None, as_json: bool, **given: Any) -> None:
        from mission_service.interfaces.control.control_client import ControlClient

        _refuse_not_finite(do, given)
        with ControlClient(out) as client:
            # An abort is sent at once, without first requesting the run's stations.
            station = station or ("unknown" if do == "abort" else only_station(client))
            for each in _completed(do, given, lambda: dict(client.ask(do="status")["status"])):
                print_reply(client.ask(do=do, by=by, station=station, **each), as_json)

    made = click.command(name, help=kind.__doc__)(user_options(send))
    info: Any = inspect.type_info(kind)
    fields = [each for each in info.fields if each.name not in OPERATOR_FIELDS]
    made.params = [each for field in fields for each in _parameters(do, field)] + made.params
    if any(isinstance(each.type, Place) for each in made.params):
        made.context_settings = {"ignore_unknown_options": True}  # a latitude may begin with -
    return made


def _parameters(do: str, field: Any) -> list[click.Parameter]:
    """Return the arguments or options for one field of a request."""
    from msgspec import inspect

    name, text = field.name, ""
    kind: Any = field.type
    if isinstance(kind, inspect.Metadata):
        text = (kind.extra_json_schema or {}).get("description", "")
        kind = kind.type
    kinds = list(kind.types) if isinstance(kind, inspect.UnionType) else [kind]
    kinds = [each for each in kinds if not isinstance(each, inspect.NoneType)]
    match name:
        case "points":
            words = "LAT,LON..."
            return [click.Argument([name], type=Place(), nargs=-1, required=True, metavar=words)]
        case "rows":
            return [click.Argument([name], nargs=-1, required=True, metavar="ROW...")]
        case "lat_deg":
            return [click.Argument(["place"], type=Place(), metavar="LAT,LON")]
        case "lon_deg":
            return []
        case "item":
            return [click.Argument([name], nargs=-1, required=True)]
    required = field.required and (do, name) not in COMPLETED
    if required and not name.endswith("_m"):  # a radius is an option, unlike LAT,LON
        return [click.Argument([name], type=_type_of(kinds))]
    unit = next((each for each in UNITS if name.endswith(each)), "")
    word = name.removesuffix(unit).replace("_", "-")
    if isinstance(kinds[0], inspect.BoolType):
        both = f"--{word}/--no-{word}" if field.default is None else f"--{word}"
        return [click.Option([both, name], is_flag=True, default=None, help=text)]
    option = click.Option(
        [f"--{word}", name],
        type=_type_of(kinds),
        required=required,
        metavar=UNITS.get(unit),
        help=text,
    )
    if (do, name) != ("person", "radius_m"):
        return [option]
    return [option, click.Option(["--gone"], is_flag=True, help="The person has left the place.")]


def _type_of(kinds: list[Any]) -> Any:
    from msgspec import inspect

    match kinds:
        case [inspect.LiteralType() as words]:
            return click.Choice([str(each) for each in words.values])
        case [inspect.FloatType()]:
            return float
        case [inspect.FloatType(), _]:
            return NumberOrWord()
        case _:
            return str


def _completed(do: str, given: dict[str, Any], status: Status) -> list[dict[str, Any]]:
    """Return the requests that a command sends, with the omitted fields completed."""
    fields = {name: value for name, value in given.items() if value is not None}
    if "place" in fields:
        fields["lat_deg"], fields["lon_deg"] = fields.pop("place")
    match do:
        case "correct" if "shape" not in fields:
            fields["shape"] = "point" if len(fields["points"]) == 1 else "line"
        case "person":
            if fields.pop("gone") == ("radius_m" in fields):
                raise click.UsageError("specify either --radius or --gone")
            fields.setdefault("radius_m", 0.0)
        case "reject":
            fields["hash"] = proposed_plan(status(), fields["hash"])[1]
        case "go" | "no-go":
            listed, text = status().get("items"), " ".join(fields["item"])
            # Without a checklist, the run refuses the request and states the reason.
            items = _items(listed, text) if listed else [text]
            return [{**fields, "item": item} for item in items]
    return [fields]


def proposed_plan(status: dict[str, Any], digits: str) -> tuple[Any, str]:
    """Return the proposed plan whose hash begins with ``digits``, and the whole hash.

    The hash is computed from the plan in ``status``. Raises RequestError if no plan, or more than
    one plan, has a hash with these digits, or if the computed hash differs from the hash in
    ``status``.
    """
    import msgspec

    from mission_service.errors import RequestError
    from mission_service.ignition_plan import IgnitionPlan, plan_hash

    if "plans" not in status:
        raise RequestError("this run has no plans; plans exist only in a burn")
    if len(digits) < 8:
        raise RequestError(f"{digits}: specify at least the first 8 digits of the plan's hash")
    found = [each for each in status["plans"] if each["plan_hash"].startswith(digits.lower())]
    if len(found) != 1:
        hashes = ", ".join(each["plan_hash"][:12] for each in status["plans"]) or "none"
        count = "no plan has" if not found else "more than one plan has"
        raise RequestError(f"{digits}: {count} a hash with these first digits; proposed: {hashes}")
    proposed = msgspec.convert(found[0]["plan"], IgnitionPlan)
    name = plan_hash(proposed)
    if name != found[0]["plan_hash"]:
        raise RequestError(f"{digits}: the plan does not match its hash; it is not approved")
    return proposed, name


def _refuse_not_finite(do: str, fields: dict[str, Any]) -> None:
    """Raise RequestError for a field with NaN or infinity, which JSON cannot represent."""
    from mission_service.errors import RequestError

    for name, value in fields.items():
        try:
            json.dumps(value, allow_nan=False)
        except ValueError:
            raise RequestError(f"{do}: {name} = {value}: must be a finite number") from None


def _items(items: list[str], text: str) -> list[str]:
    """Return the items that ``text`` selects: by number (from 1), by first letters, or "all".

    Raises RequestError unless ``text`` is "all" or selects exactly one item.
    """
    from mission_service.errors import RequestError

    if text == "all":
        return items
    if text.isdigit() and 1 <= int(text) <= len(items):
        return [items[int(text) - 1]]
    found = [item for item in items if item.lower().startswith(text.lower())]
    if len(found) != 1:
        numbered = "; ".join(f"{number} {item}" for number, item in enumerate(items, start=1))
        raise RequestError(f"{text}: does not select one item of the list: {numbered}")
    return found
