"""Defines operators' requests in one table for all interfaces. Pure.

A request is a JSON object: ``do`` names the request, ``by`` the user, and ``station`` the user's
location. Further keys depend on the request. One struct defines each request: the keys with bounds
and help texts, the request's help text (the docstring, with a summary in the first line), the
required role, the HTTP path, whether MQTT accepts the request, an example, and the resulting event.
HTTP routes and their description, MQTT commands and their schemas, the control socket and the
command line are generated from these structs.

A way of flying is the guidance for planner rules (``guidance/way_of_flying.py``). This module
contains the requests that every way of flying accepts (``OF_EVERY_RUN``) and the requests that
apply to vehicles with missions (``OF_VEHICLES``). Requests for a single way of flying are in its
folder.
"""

from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Literal, cast

import msgspec
from msgspec import Meta

from mission_service import events
from mission_service.errors import RequestError

MIN_SPEED, MAX_SPEED = 0.1, 100.0  # speeds of a replay
MAX_DURATION_S = 1e7  # longer durations are refused as mistakes
MAX_LENGTH_M = 10_000.0  # larger circles and longer lines are refused as mistakes
MAX_FIRE_LENGTH_M = 500_000.0  # limit for fire outlines, which may come from other sources
MAX_SIDE_CELLS = 256  # rows and columns of a raster
MAX_AGE_S = 21_600.0  # maximum age of an observation

OPERATOR_FIELDS = ("by", "station")  # keys of all requests
Role = Literal["look", "observe", "correct", "fly", "approve"]

# Text patterns, and their descriptions in errors. Python's $ also matches before a line break.
NAME = r"^[^\x00-\x1f\x7f-\x9f]*[!-~\xa1-\uffff][^\x00-\x1f\x7f-\x9f]*$(?!\n)"
PRINTED = r"^[^\x00-\x1f\x7f-\x9f]*$(?!\n)"
VISIBLE = r"^[!-~]+$(?!\n)"
PHOTO = r"^([0-9a-f]{64}\.(jpg|png|webp))?$(?!\n)"
ANY_VEHICLE, ONE_VEHICLE = r"^[\w-]*$(?!\n)", r"^[\w-]+$(?!\n)"
FULL_HASH = r"^[0-9a-f]{64}$(?!\n)"
LETTERS = r"^[bu.]*$(?!\n)"
_OF_VEHICLE = "the name of a vehicle: letters, digits, - and _"
PATTERNS = {
    NAME: "a non-blank line of printable characters",
    PRINTED: "one line of printable characters",
    VISIBLE: "printable ASCII characters without spaces",
    ANY_VEHICLE: _OF_VEHICLE,
    ONE_VEHICLE: _OF_VEHICLE,
    FULL_HASH: "all 64 digits of the hash, 0 to 9 and a to f",
    PHOTO: "the name of a photo that was uploaded to /photos",
    LETTERS: "a string of the letters b (burned), u (unburned) and . (not seen)",
}

# Limits of numbers also exclude NaN.
Name = Annotated[str, Meta(max_length=80, pattern=NAME)]
AnyVehicle = Annotated[
    str, Meta(max_length=40, pattern=ANY_VEHICLE, description="Empty: all vehicles.")
]
OneVehicle = Annotated[str, Meta(min_length=1, max_length=40, pattern=ONE_VEHICLE)]
Item = Annotated[
    str,
    Meta(
        min_length=1,
        max_length=200,
        description="An item of the GO/NO-GO checklist, word for word.",
    ),
]
Latitude = Annotated[float, Meta(ge=-90, le=90)]
Longitude = Annotated[float, Meta(ge=-180, le=180)]
Radius = Annotated[float, Meta(ge=0, le=MAX_LENGTH_M)]
Seconds = Annotated[float, Meta(ge=-MAX_DURATION_S, le=MAX_DURATION_S)]
Hash = Annotated[str, Meta(pattern=FULL_HASH, description="All 64 digits of the hash.")]
Places = Annotated[
    tuple[tuple[Latitude, Longitude], ...],
    Meta(min_length=1, max_length=1000, description="Latitude and longitude of each point."),
]
# The errors and source of an observation.
Age = Annotated[float, Meta(ge=0, le=MAX_AGE_S, description="Time since the observation.")]
PositionSd = Annotated[
    float, Meta(ge=0, le=MAX_LENGTH_M, description="Standard deviation of the position.")
]
FalseAlarms = Annotated[
    float, Meta(ge=0, lt=100, description="Share of unburned places reported as burned.")
]
Missed = Annotated[
    float, Meta(ge=0, lt=100, description="Share of burned places reported as unburned.")
]
Source = Annotated[
    str, Meta(max_length=80, pattern=PRINTED, description="Name of the sensor; empty for a person.")
]
RasterRow = Annotated[
    str, Meta(min_length=1, max_length=MAX_SIDE_CELLS, pattern=LETTERS, description="West to east.")
]
# The vertical limits of a volume of airspace.
FloorAmsl = Annotated[
    Annotated[float, Meta(ge=-1000, le=20_000)] | None,
    Meta(description="Lower limit above mean sea level; default: the ground."),
]
CeilingAmsl = Annotated[
    Annotated[float, Meta(ge=-1000, le=20_000)] | None,
    Meta(description="Upper limit above mean sea level; default: no limit."),
]
_MIN_POINTS = {"point": 1, "line": 2, "polygon": 3}
HASH = "6b86b273ff34fce19d6b804eff5a3f5747ada4eaa22f1d49c01e52ddb7875b4b"
PLACE = {"lat_deg": 36.364232, "lon_deg": -84.140907}
LINE = [[36.3642, -84.1409], [36.3661, -84.1391]]


class Request(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag=str.lower, tag_field="do"
):
    """A request of an operator.

    Some values are checked against the run: ``vehicle`` and ``item`` (of the GO/NO-GO checklist)
    must exist in the run; ``points``, ``lat_deg`` and ``lon_deg`` must be on the landscape.
    """

    # The type of the resulting event, whose fields are time, user and station, followed by the
    # request's further keys in order.
    makes: ClassVar[Callable[..., events.AnyOperatorEvent]]
    role: ClassVar[Role]  # role required of the user
    path: ClassVar[str]  # HTTP path; ``{name}`` is the vehicle, ``{do}`` the request
    method: ClassVar[str] = "POST"
    operation: ClassVar[str | None] = None  # operation id in OpenAPI; None: derived from the path
    # Whether MQTT accepts the request. Requests that may cause drops are not accepted, because a
    # broker does not identify users.
    over_mqtt: ClassVar[bool] = True
    max_length_m: ClassVar[float] = MAX_LENGTH_M  # longest line through ``points``
    example: ClassVar[dict[str, Any]] = {}  # valid values of the request's further keys

    by: Name
    station: Name

    def event(self, at_us: int) -> events.AnyOperatorEvent:
        """Return the event of the request at mission time ``at_us``. Raises RequestError."""
        own = (getattr(self, name) for name in self.__struct_fields__[len(OPERATOR_FIELDS) :])
        return self.makes(*self.user(at_us), *own)

    def user(self, at_us: int) -> tuple[int, str, str]:
        """Return the first fields of all operator events: time, user and station."""
        return at_us, self.by.strip(), self.station


def name_of(kind: type[Request]) -> str:
    """Return the value of ``do`` for requests of this kind."""
    return str(kind.__struct_config__.tag)


def summary_of(kind: type[Request]) -> str:
    """Return the first line of a request's help text."""
    return (kind.__doc__ or "").partition("\n")[0]


class Abort(Request, frozen=True):
    """Stop at once: no further drop, and every vehicle holds. Any content is accepted."""

    makes = events.Aborted
    role = "look"
    path = "/abort"


class Acknowledge(Request, frozen=True):
    """Acknowledge an alarm, so that it is not sent to further receivers."""

    makes = events.AlarmAcknowledged
    role = "correct"
    path = "/alarms/{do}"
    example: ClassVar = {"alarm": "link/hawk"}

    alarm: Annotated[
        str, Meta(max_length=300, pattern=NAME, description="The key of an active alarm.")
    ]


class FireRequest(Request, frozen=True):
    """A report about the fire."""

    role: ClassVar[Role] = "correct"
    path = "/fire/{do}"


class Correct(FireRequest, frozen=True):
    """Draw where the fire is, was or will be."""

    path = "/fire/corrections"
    max_length_m = MAX_FIRE_LENGTH_M
    example: ClassVar = {"state": "burning", "shape": "line", "points": LINE, "in_s": 0.0}

    state: Literal["burned", "burning", "unburned"]
    shape: Literal["point", "line", "polygon"]
    points: Places
    in_s: Annotated[
        Seconds, Meta(description="Time of the reported state, from now; negative in the past.")
    ] = 0.0

    def event(self, at_us: int) -> events.AnyOperatorEvent:
        """Return the event ``Corrected``."""
        count, least = len(self.points), _MIN_POINTS[self.shape]
        if count < least or (self.shape == "point" and count > 1):
            raise RequestError(f"correct: {count} points, but a {self.shape} requires {least}")
        if self.shape == "polygon":
            refuse_no_polygon("correct", self.points)
        marked_at_us = at_us + round(self.in_s * 1e6)
        return events.Corrected(
            *self.user(at_us), self.state, self.shape, self.points, marked_at_us
        )


class Observe(FireRequest, frozen=True):
    """Report where a person, a detector or a satellite observed fire. Observations may be wrong."""

    role = "observe"
    path = "/fire/observations"
    operation = "observe"
    max_length_m = MAX_FIRE_LENGTH_M
    example: ClassVar = {
        "state": "hot",
        "shape": "points",
        "points": LINE,
        "age_s": 40.0,
        "position_sd_m": 20.0,
        "false_alarms_pct": 5.0,
        "source": "tower",
        "temperature_c": 450.0,
        "missed_pct": 10.0,
    }

    state: Annotated[
        Literal["burned", "burning", "unburned", "hot", "smoke"],
        Meta(description="smoke: the area was not seen; hot: requires temperature_c."),
    ]
    shape: Literal["points", "line", "polygon"]
    points: Places
    age_s: Age = 0.0
    position_sd_m: PositionSd = 10.0
    false_alarms_pct: FalseAlarms = 0.0
    source: Source = ""
    temperature_c: Annotated[
        Annotated[float, Meta(ge=100, le=2000)] | None,
        Meta(description="Temperature of hot ground; 320 degrees or more counts as burning."),
    ] = None
    missed_pct: Missed = 0.0

    def event(self, at_us: int) -> events.AnyOperatorEvent:
        """Return the event ``FireObserved``."""
        if self.shape == "line" and len(self.points) < 2:
            raise RequestError("observe: 1 point, but a line requires 2")
        if self.shape == "polygon":
            refuse_no_polygon("observe", self.points)
        if (self.state == "hot") != (self.temperature_c is not None):
            raise RequestError(
                'observe: the state "hot", and no other state, requires temperature_c'
            )
        seen_at_us = at_us - round(self.age_s * 1e6)
        return events.FireObserved(
            *self.user(at_us),
            self.state,
            self.shape,
            self.points,
            seen_at_us,
            self.position_sd_m,
            self.false_alarms_pct / 100.0,
            self.source,
            self.temperature_c,
            self.missed_pct / 100.0,
        )


class Raster(FireRequest, frozen=True):
    """Report a raster of burned, unburned and unseen cells. Observations may be wrong."""

    role = "observe"
    path = "/fire/observations/raster"
    operation = "raster"
    example: ClassVar = {
        "south_deg": 36.3602,
        "west_deg": -84.1459,
        "north_deg": 36.3682,
        "east_deg": -84.1359,
        "rows": ["uuuuu", "uubbu", "ubbbu", "uuu.."],
        "age_s": 5.0,
        "position_sd_m": 15.0,
        "false_alarms_pct": 2.0,
        "source": "tower",
        "missed_pct": 10.0,
    }

    south_deg: Annotated[Latitude, Meta(description="Latitude of the southern edge, WGS84.")]
    west_deg: Annotated[Longitude, Meta(description="Longitude of the western edge.")]
    north_deg: Annotated[Latitude, Meta(description="Latitude of the northern edge.")]
    east_deg: Annotated[Longitude, Meta(description="Longitude of the eastern edge.")]
    rows: Annotated[
        tuple[RasterRow, ...],
        Meta(
            min_length=1,
            max_length=MAX_SIDE_CELLS,
            description="Rows from north to south, all of the same length: a letter for each cell, "
            "b burned, u unburned, . not seen.",
        ),
    ]
    age_s: Age = 0.0
    position_sd_m: PositionSd = 10.0
    false_alarms_pct: FalseAlarms = 0.0
    source: Source = ""
    missed_pct: Missed = 0.0

    def event(self, at_us: int) -> events.AnyOperatorEvent:
        """Return the event ``RasterObserved``."""
        first = len(self.rows[0])
        for number, row in enumerate(self.rows, start=1):
            if len(row) != first:
                raise RequestError(
                    f"raster: row {number} has {len(row)} letters and row 1 has {first}; all rows "
                    "must have the same length"
                )
        if not set("".join(self.rows)) - {"."}:
            raise RequestError("raster: no cell was seen; at least one cell must be b or u")
        if self.south_deg >= self.north_deg or self.west_deg >= self.east_deg:
            raise RequestError(
                "raster: north_deg must exceed south_deg, and east_deg must exceed west_deg"
            )
        return events.RasterObserved(
            *self.user(at_us),
            *(self.south_deg, self.west_deg, self.north_deg, self.east_deg),
            self.rows,
            at_us - round(self.age_s * 1e6),
            self.position_sd_m,
            self.false_alarms_pct / 100.0,
            self.source,
            self.missed_pct / 100.0,
        )


class Lit(FireRequest, frozen=True):
    """Report that a point, or a line through several points, was lit."""

    path = "/burn/{do}"
    operation = "burn_{do}"
    example: ClassVar = {"points": LINE, "ago_s": 20.0}

    points: Places
    ago_s: Annotated[float, Meta(ge=0, le=MAX_DURATION_S, description="Time since ignition.")] = 0.0

    def event(self, at_us: int) -> events.AnyOperatorEvent:
        """Return the event ``IgnitionReported``."""
        return events.IgnitionReported(
            *self.user(at_us), self.points, at_us - round(self.ago_s * 1e6)
        )


class Erase(FireRequest, frozen=True):
    """Remove corrections around a place."""

    makes = events.Erased
    example: ClassVar = {**PLACE, "radius_m": 50.0}

    lat_deg: Latitude
    lon_deg: Longitude
    radius_m: Radius

    def event(self, at_us: int) -> events.AnyOperatorEvent:
        """Return the event ``Erased``; raises RequestError for a radius of 0."""
        if self.radius_m == 0.0:
            raise RequestError("erase: radius_m must be greater than 0")
        return super().event(at_us)


class Undo(FireRequest, frozen=True):
    """Undo the last correction or erasure."""

    makes = events.Undone


class Redo(FireRequest, frozen=True):
    """Apply the last undone correction or erasure again."""

    makes = events.Redone


class Wind(FireRequest, frozen=True):
    """Set the wind from now on, 6.1 m (20 ft) above the vegetation; from_deg is from true north."""

    makes = events.WindSet
    path = "/wind"
    example: ClassVar = {"speed_m_s": 5.0, "from_deg": 270.0}

    speed_m_s: Annotated[float, Meta(ge=0, le=100)]
    from_deg: Annotated[float, Meta(ge=0, le=360)]


class Note(Request, frozen=True):
    """Add a note about a place, with or without a photo, to the log and to the map."""

    makes = events.NoteAdded
    role = "correct"
    path = "/{do}s"
    example: ClassVar = {
        "text": "gate locked, key at the office",
        **PLACE,
        "photo": f"{'5e' * 32}.jpg",
    }

    text: Annotated[str, Meta(max_length=200, pattern=NAME)]
    lat_deg: Latitude
    lon_deg: Longitude
    photo: Annotated[
        str, Meta(pattern=PHOTO, description="The name of a photo that was sent to /photos.")
    ] = ""

    def event(self, at_us: int) -> events.AnyOperatorEvent:
        """Return the event ``NoteAdded``."""
        place = self.lat_deg, self.lon_deg
        return events.NoteAdded(*self.user(at_us), self.text.strip(), *place, self.photo)


class Close(Request, frozen=True):
    """Close a volume of airspace: no vehicle may enter it, and vehicles inside leave it."""

    makes = events.AirspaceClosed
    role = "fly"
    path = "/airspace/{do}"
    operation = "airspace_{do}"
    example: ClassVar = {
        "name": "helicopter",
        "corners": [[36.3642, -84.1409], [36.3661, -84.1391], [36.3642, -84.1391]],
        "floor_amsl_m": 300.0,
        "ceiling_amsl_m": 900.0,
        "for_s": 1800.0,
    }

    name: Name
    corners: Annotated[
        tuple[tuple[Latitude, Longitude], ...],
        Meta(min_length=3, max_length=1000, description="Latitude and longitude of each corner."),
    ]
    floor_amsl_m: FloorAmsl = None
    ceiling_amsl_m: CeilingAmsl = None
    for_s: Annotated[
        Annotated[float, Meta(gt=0, le=MAX_DURATION_S)] | None,
        Meta(description="Time after which the volume opens; default: an operator opens it."),
    ] = None

    def event(self, at_us: int) -> events.AnyOperatorEvent:
        """Return the event ``AirspaceClosed``; raises RequestError for an impossible volume."""
        _refuse_no_volume("close", self.corners, self.floor_amsl_m, self.ceiling_amsl_m)
        return super().event(at_us)


class Open(Request, frozen=True):
    """Open a closed volume of airspace again."""

    makes = events.AirspaceOpened
    role = "fly"
    path = "/airspace/{do}"
    operation = "airspace_{do}"
    example: ClassVar = {"name": "helicopter"}

    name: Name


class Clear(Request, frozen=True):
    """Clear the airspace: all vehicles land, or leave a volume; none takes off meanwhile."""

    makes = events.ClearingOrdered
    role = "fly"
    path = "/airspace/{do}"
    operation = "airspace_{do}"
    example: ClassVar = {
        "volume": "air tanker",
        "corners": [[36.3642, -84.1409], [36.3661, -84.1391], [36.3642, -84.1391]],
        "floor_amsl_m": 300.0,
        "ceiling_amsl_m": 900.0,
    }

    volume: Annotated[
        str,
        Meta(
            max_length=80,
            pattern=PRINTED,
            description="Name of the volume that vehicles leave. With corners the request closes "
            "the volume; without corners it must be closed already. Empty: all vehicles land at "
            "home.",
        ),
    ] = ""
    corners: Annotated[
        tuple[tuple[Latitude, Longitude], ...],
        Meta(max_length=1000, description="Latitude and longitude of each corner."),
    ] = ()
    floor_amsl_m: FloorAmsl = None
    ceiling_amsl_m: CeilingAmsl = None

    def event(self, at_us: int) -> events.AnyOperatorEvent:
        """Return the event ``ClearingOrdered``; raises RequestError for an impossible volume."""
        volume = self.volume.strip()
        if self.corners and not volume:
            raise RequestError("clear: corners require a name; add `volume`")
        if not self.corners and (self.floor_amsl_m, self.ceiling_amsl_m) != (None, None):
            raise RequestError("clear: floor_amsl_m and ceiling_amsl_m require corners")
        if self.corners:
            _refuse_no_volume("clear", self.corners, self.floor_amsl_m, self.ceiling_amsl_m)
        return msgspec.structs.replace(super().event(at_us), volume=volume)


class CancelClearing(Request, frozen=True, tag="cancel-clearing"):
    """Stop clearing the airspace: vehicles on their way hold until they are resumed."""

    makes = events.ClearingCancelled
    role = "fly"
    path = "/airspace/{do}"
    operation = "airspace_cancel_clearing"


class Present(Request, frozen=True):
    """Report that the user is present; send this request every few seconds."""

    makes = events.OperatorHeartbeat
    role = "approve"
    path = "/burn/{do}"
    operation = "burn_{do}"
    over_mqtt = False


class OrderRequest(Request, frozen=True):
    """An order to a vehicle.

    The reply to an order without ``confirmed`` is a line that begins with ``confirm:``, if the
    order would end a mode selected by the autopilot or the pilot, such as a failsafe, or would use
    the energy that is needed for the flight home.
    """

    role = "fly"
    path = "/vehicles/{name}/{do}"
    operation = "{do}"
    example: ClassVar = {"vehicle": "hawk", "confirmed": False}

    vehicle: AnyVehicle = ""
    confirmed: Annotated[
        bool,
        Meta(
            description="Execute the order even if it ends a mode that the autopilot or pilot "
            "selected, or uses energy that is needed for the flight home."
        ),
    ] = False

    def event(self, at_us: int) -> events.AnyOperatorEvent:
        """Return the event ``OrderGiven``, with the request's name as the order."""
        order = cast("events.Order", name_of(type(self)))
        return events.OrderGiven(*self.user(at_us), self.vehicle, order, self.confirmed)


class Hold(OrderRequest, frozen=True):
    """Loiter at the present position until another order."""


class Resume(OrderRequest, frozen=True):
    """Follow the planner again after a hold, return or abort."""


class Return(OrderRequest, frozen=True):
    """Fly home."""


class Land(OrderRequest, frozen=True):
    """Land at home: planes and VTOLs by a mission, multirotors by a return."""


class GoAround(OrderRequest, frozen=True, tag="go-around"):
    """Break off the landing, climb and hold. On its last leg, hold and abort do the same."""

    operation = "go_around"


class Start(OrderRequest, frozen=True):
    """Arm and fly the mission on board."""


class Takeoff(Request, frozen=True):
    """Sign off the pre-flight checks of a vehicle on the ground, and start its flight."""

    role = "fly"
    path = "/vehicles/{name}/{do}"
    operation = "{do}"
    example: ClassVar = {"vehicle": "hawk", "override": "battery monitor is not calibrated"}

    vehicle: OneVehicle
    override: Annotated[
        str,
        Meta(
            max_length=200,
            pattern=PRINTED,
            description="Reason to take off although checks fail; empty: no override. The "
            "checks of position, estimator and airspace cannot be overridden.",
        ),
    ] = ""

    def event(self, at_us: int) -> events.AnyOperatorEvent:
        """Return the event ``OrderGiven``."""
        override = self.override.strip()
        return events.OrderGiven(*self.user(at_us), self.vehicle, "takeoff", override=override)


class MissionRequest(Request, frozen=True):
    """A decision on a vehicle's mission."""

    role = "fly"
    path = "/vehicles/{name}/mission/{do}"
    operation = "mission_{do}"
    example: ClassVar = {"vehicle": "hawk", "hash": HASH}


class Renew(MissionRequest, frozen=True):
    """Plan a new mission and send it now."""

    makes = events.MissionRequested
    example: ClassVar = {"vehicle": "hawk"}

    vehicle: AnyVehicle = ""


class Accept(MissionRequest, frozen=True):
    """Accept the proposed mission with this hash: the mission is sent to the vehicle."""

    makes = events.MissionAccepted
    vehicle: OneVehicle
    hash: Hash


class Refuse(MissionRequest, frozen=True):
    """Refuse the proposed mission with this hash: the mission is not flown."""

    makes = events.MissionRefused
    vehicle: OneVehicle
    hash: Hash


def _settings_event(request: Any, at_us: int) -> events.AnyOperatorEvent:
    if all(getattr(request, name) is None for name in events.TUNED):
        *others, last = events.TUNED
        raise RequestError(f"settings: specify {', '.join(others)} or {last}")
    return Request.event(request, at_us)


# The keys are the fields of the event: all settings that may be changed in flight.
Settings = cast(
    "type[Request]",
    msgspec.defstruct(
        "Settings",
        [(name, kind, None) for name, kind in events.TUNED.items()],
        bases=(Request,),
        module=__name__,
        frozen=True,
        namespace={
            "__doc__": "Change settings of the planner from now on.",
            "makes": events.SettingsChanged,
            "role": "fly",
            "path": "/planner",
            "method": "PATCH",
            "example": {"alpha": 0.7},
            "event": _settings_event,
        },
    ),
)


class Replay(Request, frozen=True):
    """Pause or resume a replay, change its speed or its position."""

    role = "fly"
    path = "/replay"
    example: ClassVar = {"paused": False, "speed": 10.0, "seek_s": 120.0}

    paused: bool | None = None
    speed: Annotated[
        Annotated[float, Meta(ge=MIN_SPEED, le=MAX_SPEED)] | Literal["max"] | None,
        Meta(description=f"{MIN_SPEED:g} to {MAX_SPEED:g}, or max."),
    ] = None
    seek_s: Annotated[Seconds | None, Meta(description="Time from the start of the replay.")] = None

    def event(self, at_us: int) -> events.AnyOperatorEvent:
        """Raise RequestError; only replays accept this request, which results in no event."""
        raise RequestError("replay: this run is not a replay")


OF_EVERY_RUN = (
    *(Abort, Correct, Observe, Raster, Erase, Undo, Redo, Lit, Wind, Note, Present),
    *(Acknowledge, Close, Open, Clear, CancelClearing),
)
OF_VEHICLES = (
    *(Hold, Resume, Return, Land, GoAround, Start, Takeoff),
    *(Renew, Accept, Refuse, Settings),
)


def refuse_no_polygon(do: str, points: tuple[tuple[float, float], ...]) -> None:
    """Raise RequestError if corners (lat_deg, lon_deg) form no polygon."""
    import shapely

    if len(points) < 3:
        raise RequestError(f"{do}: {len(points)} corners, but a polygon requires 3")
    polygon = shapely.Polygon([(lon, lat) for lat, lon in points])
    if not polygon.is_valid or polygon.area == 0.0:
        raise RequestError(
            f"{do}: these corners do not form a polygon: the sides cross, or there is no area"
        )


def _refuse_no_volume(
    do: str,
    corners: tuple[tuple[float, float], ...],
    floor_amsl_m: float | None,
    ceiling_amsl_m: float | None,
) -> None:
    """Raise RequestError if corners (lat_deg, lon_deg) and limits form no volume."""
    refuse_no_polygon(do, corners)
    if floor_amsl_m is None or ceiling_amsl_m is None:
        return
    if floor_amsl_m >= ceiling_amsl_m:
        raise RequestError(f"{do}: ceiling_amsl_m must be above floor_amsl_m")
