"""Operators' requests (control socket, HTTP, MQTT) as events. Pure.

A request is a JSON object: ``do`` names the request, ``by`` its operator, ``station`` the place of
the operator; the further keys depend on ``do``. A request with an unknown key is refused as a
whole.
"""

from collections.abc import Callable, Collection
from typing import Annotated, Any, Literal

import msgspec
import shapely
from msgspec import Meta

from mission_service import events
from mission_service.errors import RequestError
from mission_service.events import SERVICE, CrewEvent
from mission_service.ground_distance import M_PER_DEG

SLOWEST, FASTEST = 0.1, 100.0  # speeds of a replay
LONGEST_S = 1e7  # times farther away are a mistake
ELSEWHERE = "mqtt"  # as in "mqtt:west": never counts as presence at a station
LARGEST_M = 10_000.0  # larger circles and longer lines are a mistake
LARGEST_FIRE_M = 500_000.0  # limit for mapped perimeters of fires

# Not blank, without control characters. The limits of numbers exclude NaN as well.
Name = Annotated[
    str,
    Meta(
        max_length=80,
        pattern=r"^[^\x00-\x1f\x7f-\x9f]*[!-~\xa1-\uffff][^\x00-\x1f\x7f-\x9f]*$(?!\n)",
    ),
]
VehicleName = Annotated[str, Meta(max_length=40, pattern=r"^[\w-]*$(?!\n)")]
OneVehicle = Annotated[str, Meta(min_length=1, max_length=40, pattern=r"^[\w-]+$(?!\n)")]
Text = Annotated[str, Meta(min_length=1, max_length=200)]
Latitude = Annotated[float, Meta(ge=-90, le=90)]
Longitude = Annotated[float, Meta(ge=-180, le=180)]
Radius = Annotated[float, Meta(ge=0, le=LARGEST_M)]
Seconds = Annotated[float, Meta(ge=-LONGEST_S, le=LONGEST_S)]
Spacing = Annotated[float, Meta(ge=1, le=1000)]
Hash = Annotated[str, Meta(pattern=r"^[0-9a-f]{64}$(?!\n)")]
Places = Annotated[tuple[tuple[Latitude, Longitude], ...], Meta(min_length=1, max_length=1000)]


class Request(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag=str.lower, tag_field="do"
):
    """A request of an operator."""

    by: Name
    station: Name


class Plan(Request, frozen=True):
    """Plan the next line."""

    line_spacing_m: Spacing | None = None
    drop_spacing_m: Spacing | None = None


class Approve(Request, frozen=True):
    """Approve the plan with this hash of 64 digits."""

    hash: Hash


class Reject(Request, frozen=True):
    """Reject the plan with this hash."""

    hash: Hash


class Go(Request, frozen=True):
    """Answer an item of the checklist with GO."""

    item: Text


class NoGo(Request, frozen=True, tag="no-go"):
    """Answer an item of the checklist with NO-GO."""

    item: Text


class Correct(Request, frozen=True):
    """Correct the state of the fire at these points, ``in_s`` from now (negative: before now)."""

    state: Literal["burned", "burning", "unburned"]
    shape: Literal["point", "line", "polygon"]
    points: Places
    in_s: Seconds = 0.0


class Lit(Request, frozen=True):
    """Report a point or a line that the crew has lit ``ago_s`` ago."""

    points: Places
    ago_s: Annotated[float, Meta(ge=0, le=LONGEST_S)] = 0.0


class Erase(Request, frozen=True):
    """Erase the corrections in a circle."""

    lat_deg: Latitude
    lon_deg: Longitude
    radius_m: Radius


class Undo(Request, frozen=True):
    """Undo the last correction or erasure."""


class Redo(Request, frozen=True):
    """Redo the correction or erasure that was undone last."""


class Wind(Request, frozen=True):
    """Set the wind 6.1 m above the vegetation from now on."""

    speed_m_s: Annotated[float, Meta(ge=0, le=100)]
    from_deg: Annotated[float, Meta(ge=0, le=360)]


class Person(Request, frozen=True):
    """Report a person with a radius to keep clear; radius 0: the person has left."""

    name: Name
    lat_deg: Latitude
    lon_deg: Longitude
    radius_m: Radius


class Unit(Request, frozen=True):
    """Change the burn unit to the polygon of these corners."""

    points: Places


class Present(Request, frozen=True):
    """Report the presence of the operator; it is repeated every few seconds."""


class OrderRequest(Request, frozen=True):
    """An order to one vehicle, or to all vehicles if none is named.

    ``confirmed``: carry the order out even if it ends a mode that autopilot or pilot selected, such
    as a failsafe. Without it, the reply to such an order contains a line that begins with
    ``confirm:``.
    """

    vehicle: VehicleName = ""
    confirmed: bool = False


class Hold(OrderRequest, frozen=True):
    """Loiter at the present position until another order."""


class Resume(OrderRequest, frozen=True):
    """Continue the planner's missions after hold, return or abort."""


class Return(OrderRequest, frozen=True):
    """Return home."""


class Start(OrderRequest, frozen=True):
    """Arm and fly the mission on board."""


class Renew(Request, frozen=True):
    """Plan a new mission and send it now."""

    vehicle: VehicleName = ""


class Accept(Request, frozen=True):
    """Accept the proposed mission with this hash: it is sent to the vehicle."""

    vehicle: OneVehicle
    hash: Hash


class Refuse(Request, frozen=True):
    """Refuse the proposed mission with this hash."""

    vehicle: OneVehicle
    hash: Hash


class Settings(Request, frozen=True):
    """Change settings of the planner from now on; settings that are left out stay the same."""

    alpha: Annotated[float, Meta(ge=0, le=100)] | None = None
    reversal_margin: Annotated[float, Meta(ge=0, le=100)] | None = None
    dwell_s: Annotated[float, Meta(ge=0, le=LONGEST_S)] | None = None


class Replay(Request, frozen=True):
    """Pause or continue a replay, change its speed or its position. It makes no event."""

    paused: bool | None = None
    speed: Annotated[float, Meta(ge=SLOWEST, le=FASTEST)] | Literal["max"] | None = None
    seek_s: Seconds | None = None  # from the beginning of the replay


AnyRequest = (
    Plan
    | Approve
    | Reject
    | Go
    | NoGo
    | Correct
    | Lit
    | Erase
    | Undo
    | Redo
    | Wind
    | Person
    | Unit
    | Present
    | Hold
    | Resume
    | Return
    | Start
    | Renew
    | Accept
    | Refuse
    | Settings
)
# Requests of all runs, of burns only, and of all runs but burns.
ALWAYS = ("status", "abort", "correct", "erase", "undo", "redo", "lit", "wind", "present")
OF_BURNS = ("plan", "approve", "reject", "go", "no-go", "person", "unit")
NOT_OF_BURNS = ("hold", "resume", "return", "start", "renew", "accept", "refuse", "settings")
KNOWN = (*ALWAYS, *OF_BURNS, *NOT_OF_BURNS)
OF_APPROVERS = ("approve", "reject", "go", "no-go", "present", "unit")  # require the role approve
REPLAY = "replay"
ORDERS: dict[type[Request], events.Order] = {
    Hold: "hold",
    Resume: "resume",
    Return: "return",
    Start: "start",
}
_LEAST_POINTS = {"point": 1, "line": 2, "polygon": 3}


def event_of(
    request: dict[str, Any],
    at_us: int,
    stations: Collection[str],
    items: Collection[str] | None = None,
    on_map: Callable[[float, float], bool] = lambda lat_deg, lon_deg: True,
    vehicles: Collection[str] | None = None,
    words: Collection[str] = KNOWN,
    may_approve: bool | None = None,
) -> CrewEvent:
    """Convert a request into its event at mission time ``at_us``.

    ``stations``: the stations that may send requests (empty: every station). ``items``: the
    checklist, or None if unknown. ``on_map``: whether a latitude and longitude are inside the
    landscape, as all places of a request must be. ``vehicles``: the names of the vehicles, or None
    if unknown. ``words``: the requests that this run accepts. ``may_approve``: whether the user has
    the role approve. Interfaces that do not check users pass None: then exactly the requests that
    require this role count as an approver's.

    An abort is accepted from any operator and station, whatever else the request contains. Raises
    RequestError in one line for an invalid request.
    """
    if not isinstance(request, dict):
        raise RequestError('a request is a JSON object, as {"do": "status"}')
    do = request.get("do")
    if do == "abort":
        return events.Aborted(at_us, _told(request, "by"), _told(request, "station"))
    if do == REPLAY:
        raise RequestError("replay: this run is no replay")
    if not isinstance(do, str) or do not in words:
        if do in KNOWN:
            what = "only in a burn" if do in OF_BURNS else "not in a burn"
            raise RequestError(f"{do}: {what}")
        word = _cut(do) if isinstance(do, str) else "without a word"
        raise RequestError(f"unknown request {word}: do is one of {', '.join(words)}")
    if do == "status":
        raise RequestError("status is answered, it is no event")
    try:
        asked: AnyRequest = msgspec.convert(request, AnyRequest)
    except (msgspec.ValidationError, OverflowError, UnicodeError) as error:
        raise RequestError(f"{do}: {error}") from None
    if _is_service(asked.by):
        raise RequestError(f"{do}: by {SERVICE!r} is the service's own name; give yours")
    if stations and asked.station not in stations and asked.station.split(":")[0] != ELSEWHERE:
        there = ", ".join(sorted(stations))
        raise RequestError(f"unknown station {_cut(asked.station)}; the scenario has {there}")
    if isinstance(asked, Go | NoGo) and items is not None and asked.item not in items:
        raise RequestError(f"no item {_cut(asked.item)} on the list: {'; '.join(items)}")
    named = getattr(asked, "vehicle", "")
    if named and vehicles is not None and named not in vehicles:
        raise RequestError(f"no vehicle {_cut(named)}; there are {', '.join(vehicles)}")
    for place in _places(asked):
        if not on_map(*place):
            raise RequestError(f"{do}: {place[0]:.6g}, {place[1]:.6g} is outside the landscape")
    approver = do in OF_APPROVERS if may_approve is None else may_approve
    return msgspec.structs.replace(_event(asked, at_us), may_approve=approver)


def _places(asked: AnyRequest) -> tuple[tuple[float, float], ...]:
    """All places of a request; raises RequestError if a line through them is too long."""
    if isinstance(asked, Erase | Person):
        return ((asked.lat_deg, asked.lon_deg),)
    if not isinstance(asked, Correct | Lit | Unit):
        return ()
    # Half the length of the doubled line: the line and half of its closing side.
    way = shapely.LineString([(lon, lat) for lat, lon in asked.points * 2])
    length_m = M_PER_DEG * way.length / 2.0
    if length_m > (LARGEST_FIRE_M if isinstance(asked, Correct) else LARGEST_M):
        raise RequestError(f"{length_m / 1e3:.0f} km are too long to be meant")
    return asked.points


def _event(asked: AnyRequest, at_us: int) -> CrewEvent:
    who = (at_us, asked.by.strip(), asked.station)
    match asked:
        case Plan():
            return events.PlanWanted(*who, asked.line_spacing_m, asked.drop_spacing_m)
        case Approve():
            return events.Approved(*who, asked.hash)
        case Reject():
            return events.Rejected(*who, asked.hash)
        case Go() | NoGo():
            return events.Answered(*who, asked.item, isinstance(asked, Go))
        case Correct():
            return _corrected(asked, who)
        case Lit():
            return events.Lit(*who, asked.points, at_us - round(asked.ago_s * 1e6))
        case Erase():
            if asked.radius_m == 0.0:
                raise RequestError("erase: radius_m must be more than 0")
            return events.Erased(*who, asked.lat_deg, asked.lon_deg, asked.radius_m)
        case Undo():
            return events.Undone(*who)
        case Redo():
            return events.Redone(*who)
        case Wind():
            return events.WindTold(*who, asked.speed_m_s, asked.from_deg)
        case Person():
            place = (asked.lat_deg, asked.lon_deg)
            return events.PersonTold(*who, asked.name.strip(), *place, asked.radius_m)
        case Unit():
            _refuse_no_polygon("unit", asked.points)
            return events.UnitTold(*who, asked.points)
        case Present():
            return events.Present(*who)
        case Hold() | Resume() | Return() | Start():
            return events.Ordered(*who, asked.vehicle, ORDERS[type(asked)], asked.confirmed)
        case Renew():
            return events.MissionWanted(*who, asked.vehicle)
        case Accept():
            return events.MissionAccepted(*who, asked.vehicle, asked.hash)
        case Refuse():
            return events.MissionRefused(*who, asked.vehicle, asked.hash)
        case Settings():
            given = (asked.alpha, asked.reversal_margin, asked.dwell_s)
            if given == (None, None, None):
                raise RequestError("settings: give alpha, reversal_margin or dwell_s")
            return events.SettingsTold(*who, *given)


def _corrected(asked: Correct, who: tuple[int, str, str]) -> events.Corrected:
    count, least = len(asked.points), _LEAST_POINTS[asked.shape]
    if count < least or (asked.shape == "point" and count > 1):
        raise RequestError(f"correct: a {asked.shape} of {count} places; it takes {least}")
    if asked.shape == "polygon":
        _refuse_no_polygon("correct", asked.points)
    marked_at_us = who[0] + round(asked.in_s * 1e6)
    return events.Corrected(*who, asked.state, asked.shape, asked.points, marked_at_us)


def _refuse_no_polygon(do: str, points: tuple[tuple[float, float], ...]) -> None:
    if len(points) < 3:
        raise RequestError(f"{do}: {len(points)} corners; a polygon takes 3")
    polygon = shapely.Polygon([(lon, lat) for lat, lon in points])
    if not polygon.is_valid or polygon.area == 0.0:
        raise RequestError(f"{do}: these corners are no polygon: its sides cross or it has no area")


def _told(request: dict[str, Any], key: str) -> str:
    try:
        told = msgspec.convert(request.get(key), Name)
    except (msgspec.ValidationError, UnicodeError):
        return "unknown"
    return "unknown" if _is_service(told) else told


def _is_service(name: str) -> bool:
    """Whether a name in a request is the name that the service uses for its own orders."""
    return name.strip().casefold() == SERVICE


def _cut(value: str) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:59] + "…"
