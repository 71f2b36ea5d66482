"""Requests of operators (control socket, HTTP, MQTT) as events, and the table of all. Pure.

Unknown keys are refused: what is not understood is not done in part.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import msgspec
import shapely

from mission_service import events
from mission_service.errors import RequestError
from mission_service.events import SERVICE, AnyOperatorEvent
from mission_service.ground_distance import M_PER_DEG
from mission_service.guidance.registry import WAYS, way_of
from mission_service.requests import (
    OF_EVERY_RUN,
    OF_VEHICLES,
    Abort,
    Name,
    Replay,
    Request,
    name_of,
)

if TYPE_CHECKING:
    from mission_service.config.scenario import Scenario

ELSEWHERE = "mqtt"  # "mqtt:west": a user of MQTT is at no station, so never present
STATUS = "status"  # asks for the state; it is answered and becomes no event
ABORT, REPLAY = name_of(Abort), name_of(Replay)


def _table(*kinds: type[Request]) -> dict[str, type[Request]]:
    return {name_of(kind): kind for kind in kinds}


REQUESTS = _table(*OF_EVERY_RUN, *(kind for way in WAYS for kind in way.requests))
# With those of replays, which become no events.
ALL_REQUESTS = REQUESTS | _table(Replay)


def accepted_in(scenario: "Scenario") -> dict[str, type[Request]]:
    """Return the requests that a run of this scenario accepts."""
    return _table(*OF_EVERY_RUN, *way_of(scenario).requests)


@dataclass(frozen=True)
class RequestScope:
    """Which requests a run accepts, and what it has that they may name.

    Attributes:
        stations: The places from which requests are accepted; empty: any.
        items: The GO list; None: any.
        on_map: Whether the landscape has a latitude and longitude, in degrees.
        vehicles: The names of the vehicles; None: any.
        accepted: The names of the requests.
    """

    stations: Collection[str] = ()
    items: Collection[str] | None = None
    on_map: Callable[[float, float], bool] = lambda lat_deg, lon_deg: True
    vehicles: Collection[str] | None = None
    accepted: Collection[str] = tuple(REQUESTS)


ANYWHERE = RequestScope()


def event_of(
    request: dict[str, Any],
    at_us: int,
    scope: RequestScope = ANYWHERE,
    may_approve: bool | None = None,
) -> AnyOperatorEvent:
    """Return the event of a request.

    Args:
        request: The request as JSON has it.
        at_us: Mission time.
        scope: What it is checked against.
        may_approve: Whether the user has the role approve; None where an interface does not check
            users: then only requests that need that role count as such a user's.

    Returns:
        The event.

    Raises:
        RequestError: In one line, for all that is not right. An abort is accepted whatever it says.
    """
    if not isinstance(request, dict):
        raise RequestError('a request is a JSON object, as {"do": "status"}')
    do = request.get("do")
    if do == ABORT:
        return events.Aborted(at_us, _named(request, "by"), _named(request, "station"))
    kind = _kind(do, scope.accepted)
    try:
        asked = msgspec.convert(request, kind)
    except (msgspec.ValidationError, OverflowError, UnicodeError) as error:
        raise RequestError(f"{do}: {error}") from None
    if _is_service(asked.by):
        raise RequestError(f"{do}: by {SERVICE!r} is the service's own name; give yours")
    _check_names(asked, scope)
    for place in _places(asked):
        if not scope.on_map(*place):
            raise RequestError(f"{do}: {place[0]:.6g}, {place[1]:.6g} is outside the landscape")
    approver = kind.role == "approve" if may_approve is None else may_approve
    return msgspec.structs.replace(asked.event(at_us), may_approve=approver)


def _check_names(asked: Request, scope: RequestScope) -> None:
    """Raises RequestError for a station, item or vehicle that the run has not."""
    stations, items, vehicles = scope.stations, scope.items, scope.vehicles
    if stations and asked.station not in stations and asked.station.split(":")[0] != ELSEWHERE:
        there = ", ".join(sorted(stations))
        raise RequestError(f"unknown station {_cut(asked.station)}; the scenario has {there}")
    item, vehicle = getattr(asked, "item", ""), getattr(asked, "vehicle", "")
    if item and items is not None and item not in items:
        raise RequestError(f"no item {_cut(item)} on the list: {'; '.join(items)}")
    if vehicle and vehicles is not None and vehicle not in vehicles:
        raise RequestError(f"no vehicle {_cut(vehicle)}; there are {', '.join(vehicles)}")


def _kind(do: Any, accepted: Collection[str]) -> type[Request]:
    if do == STATUS:
        raise RequestError("status is answered, it is no event")
    if do == REPLAY:
        raise RequestError("replay: this run is no replay")
    if isinstance(do, str) and do in accepted:
        return REQUESTS[do]
    if isinstance(do, str) and do in REQUESTS:
        what = "not in a burn" if REQUESTS[do] in OF_VEHICLES else "only in a burn"
        raise RequestError(f"{do}: {what}")
    word = _cut(do) if isinstance(do, str) else "without a word"
    raise RequestError(f"unknown request {word}: do is one of {', '.join((STATUS, *accepted))}")


def _places(asked: Request) -> tuple[tuple[float, float], ...]:
    """Return all places of a request; raises RequestError if a line through them is too long."""
    lat_deg, lon_deg = getattr(asked, "lat_deg", None), getattr(asked, "lon_deg", None)
    if lat_deg is not None and lon_deg is not None:
        return ((lat_deg, lon_deg),)
    points: tuple[tuple[float, float], ...] = getattr(asked, "points", ())
    if points:
        # Twice, and half of it: with the way back to the first corner.
        way = shapely.LineString([(lon, lat) for lat, lon in points * 2])
        length_m = M_PER_DEG * way.length / 2.0
        if length_m > asked.max_length_m:
            raise RequestError(f"{length_m / 1e3:.0f} km are too long to be meant")
    return points


def _named(request: dict[str, Any], key: str) -> str:
    try:
        name = msgspec.convert(request.get(key), Name)
    except (msgspec.ValidationError, UnicodeError):
        return "unknown"
    return "unknown" if _is_service(name) else name


def _is_service(name: str) -> bool:
    """Return whether a name in a request is the name that the service uses for its own orders."""
    return name.strip().casefold() == SERVICE


def _cut(value: str) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:59] + "…"
