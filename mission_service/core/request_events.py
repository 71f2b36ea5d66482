"""Converts operators' requests (control socket, HTTP, MQTT) to events. Pure.

A request with an unknown key is refused as a whole.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import msgspec
import shapely

from mission_service import events
from mission_service.errors import RequestError, did_you_mean
from mission_service.events import SERVICE, AnyOperatorEvent
from mission_service.ground_distance import M_PER_DEG
from mission_service.guidance.registry import WAYS, way_of
from mission_service.requests import (
    OF_EVERY_RUN,
    OF_VEHICLES,
    Abort,
    Acknowledge,
    Name,
    Replay,
    Request,
    name_of,
)
from mission_service.value_errors import in_words

if TYPE_CHECKING:
    from mission_service.config.scenario import Scenario

ELSEWHERE = "mqtt"  # as in "mqtt:west": MQTT users have no station and never count as present
MAX_KEYS_SHOWN = 5  # of active alarms, in the answer to a request with an unknown key
STATUS = "status"  # a query for the state, without an event
ABORT, REPLAY = name_of(Abort), name_of(Replay)


def _table(*kinds: type[Request]) -> dict[str, type[Request]]:
    return {name_of(kind): kind for kind in kinds}


REQUESTS = _table(*OF_EVERY_RUN, *(kind for way in WAYS for kind in way.requests))
# All requests, including ``replay``, which causes no event.
ALL_REQUESTS = REQUESTS | _table(Replay)


def accepted_in(scenario: "Scenario") -> dict[str, type[Request]]:
    """Return the requests accepted in a run of this scenario."""
    return _table(*OF_EVERY_RUN, *way_of(scenario).requests)


@dataclass(frozen=True)
class RequestScope:
    """The requests accepted in a run, and the names that they may contain.

    Attributes:
        stations: The stations from which requests are accepted; empty: any.
        items: The items of the GO/NO-GO checklist; None: any.
        on_map: Returns whether a position (latitude, longitude, in degrees) is on the landscape.
        vehicles: The names of the vehicles; None: any.
        accepted: The names of the requests.
        alarms: Returns the keys of the active alarms, and of those that cleared last: an
            acknowledgement may be late. None: any key is accepted.
    """

    stations: Collection[str] = ()
    items: Collection[str] | None = None
    on_map: Callable[[float, float], bool] = lambda lat_deg, lon_deg: True
    vehicles: Collection[str] | None = None
    accepted: Collection[str] = tuple(REQUESTS)
    alarms: Callable[[], Collection[str]] | None = None


ANYWHERE = RequestScope()


def event_of(
    request: dict[str, Any],
    at_us: int,
    scope: RequestScope = ANYWHERE,
    may_approve: bool | None = None,
    role: str = "",
) -> AnyOperatorEvent:
    """Return the event that a request causes.

    Args:
        request: The request as parsed from JSON.
        at_us: Mission time.
        scope: The scope against which the request is checked.
        may_approve: Whether the user has the role approve. None for an interface that does not
            check users: the role is then assumed for requests that need it.
        role: The highest role of the user, which observations contain; empty if users are not
            checked.

    Returns:
        The event.

    Raises:
        RequestError: For an invalid request, with the reason in one line. An abort is accepted with
        any content.
    """
    if not isinstance(request, dict):
        raise RequestError('a request must be a JSON object, such as {"do": "status"}')
    do = request.get("do")
    if do == ABORT:
        return events.Aborted(at_us, _named(request, "by"), _named(request, "station"))
    kind = _kind(do, scope.accepted)
    try:
        parsed = msgspec.convert(request, kind)
    except (msgspec.ValidationError, OverflowError, UnicodeError) as error:
        raise RequestError(f"{do}: {in_words(error, kind, request)}") from None
    if _is_service(parsed.by):
        raise RequestError(f"{do}: by = {SERVICE!r} is reserved for the service; enter your name")
    _check_names(parsed, scope)
    for place in _places(parsed):
        if not scope.on_map(*place):
            lat_deg, lon_deg = place
            exchanged = abs(lon_deg) <= 90.0 and scope.on_map(lon_deg, lat_deg)
            hint = "; latitude and longitude are swapped" if exchanged else ""
            raise RequestError(f"{do}: {lat_deg:.6g}, {lon_deg:.6g} is outside the landscape{hint}")
    approver = kind.role == "approve" if may_approve is None else may_approve
    event = msgspec.structs.replace(parsed.event(at_us), may_approve=approver)
    if isinstance(event, events.FireObserved | events.RasterObserved):
        return msgspec.structs.replace(event, role=role)
    return event


def _check_names(request: Request, scope: RequestScope) -> None:
    """Raise RequestError for a station, item, vehicle or alarm that is not in the run's scope."""
    stations, items, vehicles = scope.stations, scope.items, scope.vehicles
    if stations and request.station not in stations and request.station.split(":")[0] != ELSEWHERE:
        names = ", ".join(sorted(stations))
        meant = did_you_mean(request.station, stations)
        raise RequestError(
            f"unknown station {_cut(request.station)}; the stations are {names}{meant}"
        )
    item, vehicle = getattr(request, "item", ""), getattr(request, "vehicle", "")
    if item and items is not None and item not in items:
        listed = "; ".join(items) or "it has no items"
        raise RequestError(
            f"no item {_cut(item)} on the GO/NO-GO checklist; the items are: {listed}"
        )
    if vehicle and vehicles is not None and vehicle not in vehicles:
        listed = f"{', '.join(vehicles)}{did_you_mean(vehicle, vehicles)}"
        raise RequestError(f"no vehicle {_cut(vehicle)}; the vehicles are {listed}")
    if isinstance(request, Acknowledge) and scope.alarms is not None:
        known = scope.alarms()
        if request.alarm not in known:
            keys = ", ".join(list(known)[:MAX_KEYS_SHOWN]) or "none"
            raise RequestError(f"acknowledge: no alarm {_cut(request.alarm)}; the alarms: {keys}")


def _kind(do: Any, accepted: Collection[str]) -> type[Request]:
    if do == STATUS:
        raise RequestError("status is a query and causes no event")
    if do == REPLAY:
        raise RequestError("replay: this run is not a replay")
    if isinstance(do, str) and do in accepted:
        return REQUESTS[do]
    if isinstance(do, str) and do in REQUESTS:
        in_burn = REQUESTS[do] not in OF_VEHICLES
        reason = "available only in a burn" if in_burn else "not available in a burn"
        raise RequestError(f"{do}: {reason}")
    name = _cut(do) if isinstance(do, str) else "(no name)"
    meant = did_you_mean(do, accepted) if isinstance(do, str) else ""
    listed = f"{', '.join((STATUS, *accepted))}{meant}"
    raise RequestError(f'unknown request {name}: "do" must be one of {listed}')


def _places(request: Request) -> tuple[tuple[float, float], ...]:
    """Return all points of a request; raises RequestError if a line through them is too long."""
    lat_deg, lon_deg = getattr(request, "lat_deg", None), getattr(request, "lon_deg", None)
    if lat_deg is not None and lon_deg is not None:
        return ((lat_deg, lon_deg),)
    points: tuple[tuple[float, float], ...] = getattr(request, "points", ())
    if points:
        # The line runs around the corners twice, so that half its length includes the side from the
        # last corner to the first.
        outline = shapely.LineString([(lon, lat) for lat, lon in points * 2])
        length_m = M_PER_DEG * outline.length / 2.0
        if length_m > request.max_length_m:
            max_km = request.max_length_m / 1e3
            raise RequestError(
                f"a line of {length_m / 1e3:.0f} km exceeds the limit of {max_km:g} km"
            )
    return points


def _named(request: dict[str, Any], key: str) -> str:
    try:
        name = msgspec.convert(request.get(key), Name)
    except (msgspec.ValidationError, UnicodeError):
        return "unknown"
    return "unknown" if _is_service(name) else name


def _is_service(name: str) -> bool:
    """Return whether a name is the one that the service uses for its own orders."""
    return name.strip().casefold() == SERVICE


def _cut(value: str) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:59] + "…"
