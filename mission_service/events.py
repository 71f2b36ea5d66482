"""Defines the events: the inputs of the core. Events are journalled before they are handled.

``at_us`` is mission time in integer microseconds; 0 is the start of the scenario's fire.

The types include the limits of their values. Each journal line is decoded before it is written, so
an event with a value that is out of range or not a number is neither journalled nor handled.
"""

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from mission_service.peer_messages import AnyMessage

MissionUs = Annotated[int, Meta(ge=-(10**15), le=10**15)]  # 30 years
DurationS = Annotated[float, Meta(ge=0, le=1e9)]
Latitude = Annotated[float, Meta(ge=-90, le=90)]
Longitude = Annotated[float, Meta(ge=-180, le=180)]
Altitude = Annotated[float, Meta(ge=-12_000, le=100_000)]  # m
Velocity = Annotated[float, Meta(ge=-1000, le=1000)]  # m/s, one component
WindSpeed = Annotated[float, Meta(ge=0, le=150)]  # m/s
Bearing = Annotated[float, Meta(ge=0, le=360)]
Angle = Annotated[float, Meta(ge=-180, le=180)]  # degrees
Fraction = Annotated[float, Meta(ge=0, lt=1)]
Share = Annotated[float, Meta(ge=0, le=1)]
Percent = Annotated[float, Meta(ge=0, le=100)]
Radius = Annotated[float, Meta(ge=0, le=1e6)]  # m
ParameterValue = Annotated[float, Meta(ge=-4e38, le=4e38)]
Temperature = Annotated[float, Meta(ge=-100, le=5000)]  # degrees Celsius
Count = Annotated[int, Meta(ge=0, le=2**40)]
UtcUs = Annotated[int, Meta(ge=0, le=2**60)]  # microseconds since 1970
GridPlace = Annotated[float, Meta(ge=-(2**31), lt=2**31)]  # row or column, in cells
FrontSpeed = Annotated[float, Meta(ge=0, le=100)]  # m/s
CellIndex = Annotated[int, Meta(ge=-(2**31), lt=2**31)]
Name = Annotated[str, Meta(min_length=1)]


class Event(msgspec.Struct, frozen=True, tag=True, tag_field="type"):
    """An event of one vehicle at mission time ``at_us``."""

    at_us: MissionUs
    vehicle: Name


class VehicleConnected(Event, frozen=True, tag=True):
    """The first heartbeat of an autopilot; ``stack`` names its firmware (``px4 plane``)."""

    stack: str
    atomic_upload: bool


class LinkLost(Event, frozen=True, tag=True):
    """No heartbeat was received for ``silent_s``."""

    silent_s: DurationS


class LinkRestored(Event, frozen=True, tag=True):
    """Heartbeats are received again."""


class LinkQuality(msgspec.Struct, frozen=True):
    """The quality of one link, from the frames of the vehicle that were received over it.

    ``waiting``: no frame yet; ``degraded``: the loss was above 30 % and is still above 15 %;
    ``silent``: no frame for three seconds. ``loss_share`` is the share of frames lost in the last
    ten seconds, by their sequence numbers, and None if there are too few. ``silent_since_us`` is
    the time of the last frame on a silent link.
    """

    link: str
    state: Literal["waiting", "up", "degraded", "silent"]
    loss_share: Share | None = None
    silent_since_us: MissionUs | None = None


class LinksReported(Event, frozen=True, tag=True):
    """The quality of a vehicle's links, the preferred link first, after a change.

    ``in_use`` is the link over which the service sends. If it has changed, ``cause`` states why the
    link used before was left: it was silent or lost frames, or a preferred link has recovered.
    """

    links: tuple[LinkQuality, ...]
    in_use: str
    cause: Literal["", "silent", "loss", "recovered"] = ""


class VehicleRebooted(Event, frozen=True, tag=True):
    """The autopilot was restarted, and its clock was reset."""


class Telemetry(Event, frozen=True, tag=True):
    """Position (WGS84) and velocity of the vehicle (GLOBAL_POSITION_INT)."""

    lat_deg: Latitude
    lon_deg: Longitude
    altitude_amsl_m: Altitude
    altitude_relative_m: Altitude
    velocity_north_m_s: Velocity
    velocity_east_m_s: Velocity
    heading_deg: Bearing


class MissionProgress(Event, frozen=True, tag=True):
    """The vehicle has begun the mission item with the index ``current_seq`` in its mission."""

    current_seq: Count


class Observed(Event, frozen=True, tag=True, omit_defaults=True):
    """A camera's observation of a window of cells with the north-west cell (``row``, ``col``).

    Each string is a row, from north to south, and each character of a row is a cell, from west to
    east. ``.`` is a cell outside the footprint or behind smoke, ``u`` is unburned, and ``b`` is
    burning or burned.
    With ``corrects`` the window is an operator's correction and replaces earlier observations of
    these cells. With ``estimated`` the window is not from a camera: in a run without images,
    planners receive the part of the estimate that a camera would show.

    ``position_sd_m`` is the standard deviation of the window's position, ``missed`` the fraction of
    burned cells that are reported as unburned, and ``false_alarms`` the fraction of unburned cells
    that are reported as burned. ``source`` names the sensor and is empty for the vehicle's camera.
    A ``distrusted`` window contradicts other sources and is used neither by planners nor by the
    estimate. ``file`` names the file from which the sensor read the window
    (``sensors/sensor_files.py``), and is empty if there is none.
    """

    row: CellIndex
    col: CellIndex
    cells: tuple[str, ...]
    corrects: bool = False
    estimated: bool = False
    source: str = ""
    position_sd_m: Radius = 10.0
    missed: Fraction = 0.0
    false_alarms: Fraction = 0.0
    distrusted: bool = False
    file: str = ""


class EstimatedFront(msgspec.Struct, frozen=True):
    """A closed front of the estimated fire, as n points in clockwise order on the map.

    An ``inner`` front surrounds an unburned island. ``rows`` and ``cols`` are grid coordinates, in
    cells. At each point ``speeds_m_s`` is the speed of the front towards unburned ground,
    ``speed_sds_m_s`` the standard deviation of this speed, and ``unseen_s`` the time since the last
    observation of the front.
    """

    inner: bool
    rows: tuple[GridPlace, ...]
    cols: tuple[GridPlace, ...]
    speeds_m_s: tuple[FrontSpeed, ...]
    speed_sds_m_s: tuple[FrontSpeed, ...]
    unseen_s: tuple[DurationS, ...]


class FrontsEstimated(Event, frozen=True, tag=True):
    """The fronts of the estimated fire, for planners that follow fronts of any shape.

    The fronts were computed when a position of ``vehicle`` was received.
    """

    fronts: tuple[EstimatedFront, ...]


class CameraDirection(Event, frozen=True, tag=True):
    """The direction of a vehicle's camera; without ``gimbal``, the attitude of the airframe.

    The direction is reported after a change of half a degree, and at least once a second. The yaw
    is clockwise from true north, a pitch of -90 is straight down, and the roll is about the line of
    sight. This event and the four events below occur only in runs with sensors.
    """

    yaw_deg: Bearing
    pitch_deg: Angle
    roll_deg: Angle
    gimbal: bool


class ImageCaptured(Event, frozen=True, tag=True):
    """A camera took an image at this time and position (CAMERA_IMAGE_CAPTURED, CAMERA_FEEDBACK).

    ``direction`` is the yaw, pitch and roll as in ``CameraDirection``, or None if unknown.
    ``file_name`` is empty, and ``taken_utc_us`` is None, if the camera does not report the value.
    """

    lat_deg: Latitude
    lon_deg: Longitude
    altitude_amsl_m: Altitude
    direction: tuple[Bearing, Angle, Angle] | None
    gimbal: bool
    index: Count
    file_name: str
    taken_utc_us: UtcUs | None


class CameraFieldOfView(Event, frozen=True, tag=True):
    """The field of view of a vehicle's camera has changed; an unknown vertical angle is None."""

    horizontal_deg: Bearing
    vertical_deg: Bearing | None = None


class HotPointSeen(Event, frozen=True, tag=True):
    """A thermal image contains a temperature of at least ``hot_c`` (CAMERA_THERMAL_RANGE).

    ``x`` and ``y`` are fractions of the image's width and height, from the top left corner.
    """

    temperature_c: Temperature
    x: Share
    y: Share


class TargetTracked(Event, frozen=True, tag=True):
    """The position of a tracked object (CAMERA_TRACKING_GEO_STATUS), at most once a second."""

    lat_deg: Latitude
    lon_deg: Longitude
    horizontal_sd_m: Radius | None


class WindMeasured(Event, frozen=True, tag=True):
    """The autopilot's estimate of the wind at the vehicle.

    ``from_deg`` is the direction from which the wind blows, clockwise from true north.
    """

    speed_m_s: WindSpeed
    from_deg: Bearing


class AirspeedMeasured(Event, frozen=True, tag=True):
    """The mean airspeed (VFR_HUD) has changed."""

    airspeed_m_s: Velocity


class AirDataMeasured(Event, frozen=True, tag=True):
    """A plane's true airspeed per measured airspeed, and the wind, from flight on several headings.

    ``wind_from_deg`` is the direction from which the wind blows, clockwise from true north.
    """

    true_airspeed_factor: Annotated[float, Meta(ge=0.5, le=2.0)]
    wind_speed_m_s: WindSpeed
    wind_from_deg: Bearing


class ThrustStatusChanged(Event, frozen=True, tag=True):
    """Thrust has become insufficient (sinking at full throttle, VFR_HUD) or sufficient again."""

    sufficient: bool
    throttle_percent: Count
    climb_m_s: Velocity


class UploadFinished(Event, frozen=True, tag=True):
    """The outcome of one ``UploadMission``."""

    mission_id: Count
    outcome: str
    reason: str


class MissionReadBack(Event, frozen=True, tag=True):
    """The mission on board, read back from a vehicle after a restart of the service.

    ``mission_id`` is the number of the mission if the service sent it, and otherwise 0. ``items``
    is the number of mission items, or None if the mission could not be read.
    """

    mission_id: Count
    items: Count | None


class CommandFinished(Event, frozen=True, tag=True):
    """The autopilot accepted or refused a command, or a later order replaced the command."""

    command: str
    accepted: bool
    reason: str
    replaced: bool = False


class ModeChanged(Event, frozen=True, tag=True):
    """The autopilot changed its flight mode or was armed or disarmed."""

    custom_mode: Count
    armed: bool
    mode: str = ""  # the bridge's name for the mode


class PeerMessage(Event, frozen=True, tag=True):
    """A message from a UAV that another process controls."""

    message: AnyMessage


class PeerLinkChanged(Event, frozen=True, tag=True):
    """The link to the UAVs that other processes control was lost or restored."""

    there: bool


class BatteryUpdated(Event, frozen=True, tag=True):
    """The state of the battery with the least charge; None where the vehicle reports no value.

    Reported when the charge has changed, and otherwise every half minute. ``consumed_mah`` counts
    from the start of the autopilot; ``time_remaining_s`` is the autopilot's own estimate.
    """

    percent: Percent | None
    voltage_v: float | None = None
    current_a: float | None = None
    consumed_mah: float | None = None
    time_remaining_s: float | None = None


class GpsFixChanged(Event, frozen=True, tag=True):
    """The type of the position fix has changed; ``good`` means a 3-D fix."""

    good: bool
    fix: str


class AutopilotText(Event, frozen=True, tag=True):
    """A STATUSTEXT of the autopilot, with its MAV_SEVERITY (0 emergency to 6 information)."""

    severity: int
    text: str


class SystemStateChanged(Event, frozen=True, tag=True):
    """The system state has changed: ``standby``, ``active``, ``critical`` (a failsafe) ..."""

    state: str


class LandedStateChanged(Event, frozen=True, tag=True):
    """The autopilot's estimate of the landed state: ``on ground``, ``in air``, ``landing`` ..."""

    state: str


class FenceStatusChanged(Event, frozen=True, tag=True):
    """A breach of a fence has begun or ended; ``kind`` is ``boundary``, ``highest altitude`` ..."""

    breached: bool
    kind: str


class EstimatorStatusChanged(Event, frozen=True, tag=True):
    """The health of the autopilot's position estimate has changed; ``problems`` are in words."""

    healthy: bool
    problems: tuple[str, ...]


class RemoteIdChanged(Event, frozen=True, tag=True):
    """The state of the vehicle's Remote ID module has changed.

    ``text`` is the module's error, or how the state was determined; it may be empty.
    """

    state: Literal["ready", "fails", "lost"]
    text: str


class ParametersReported(Event, frozen=True, tag=True):
    """The autopilot's parameters of the reaction to a lost link and of the return were read.

    ``stack`` is that of ``VehicleConnected``, and ``station_id`` the system id of the service's
    heartbeats. The autopilot did not reply for the parameters ``missing``.
    """

    stack: str
    station_id: Count
    values: dict[str, ParameterValue]
    missing: tuple[str, ...] = ()


class AircraftState(msgspec.Struct, frozen=True):
    """Another aircraft near a vehicle, with the position extrapolated to the event's time.

    ``aircraft`` is the ICAO address in hexadecimal digits or another identifier, and ``age_s`` the
    time since the position was received from ``source``.
    """

    aircraft: Name
    callsign: str
    lat_deg: Latitude
    lon_deg: Longitude
    altitude_amsl_m: Altitude
    velocity_north_m_s: Velocity
    velocity_east_m_s: Velocity
    climb_m_s: Velocity
    age_s: DurationS
    source: str


class AircraftReported(Event, frozen=True, tag=True, omit_defaults=True):
    """The other aircraft within range of a vehicle, once a second while there are any.

    One event without aircraft follows after the last aircraft has left. If ``own_position_unknown``
    is set, the vehicle's own position is too old to determine which aircraft are near, and the
    event contains none. Only runs with the table ``[surveillance]`` have this event.
    """

    aircraft: tuple[AircraftState, ...]
    own_position_unknown: bool = False


class DropFinished(Event, frozen=True, tag=True):
    """The outcome of one ``Drop``, which is unknown if neither ``done`` nor ``refused`` is set."""

    plan_hash: str
    number: Count
    done: bool
    refused: bool
    reason: str

    @property
    def outcome(self) -> str:
        """The outcome as a word: ``done``, ``refused`` or ``unknown``."""
        return "done" if self.done else "refused" if self.refused else "unknown"


class HostTime(Event, frozen=True, tag=True):
    """The time of the host's monotonic clock at a mission time; sent about once a second in burns.

    Mission time follows the autopilot's clock, which may run slow or stop. The time limits of
    approvals are therefore measured by the host's clock as well.
    """

    monotonic_us: int


class _ByUser(msgspec.Struct, frozen=True, tag=True, tag_field="type"):
    at_us: MissionUs
    by: str
    station: str


class OperatorEvent(_ByUser, frozen=True, tag=True, kw_only=True):
    """An action or a report of an operator at ``station``.

    ``may_approve`` states whether the user has the role approve, as checked by the interface.
    """

    may_approve: bool = False


Place = tuple[Latitude, Longitude]  # degrees


class IgnitionReported(OperatorEvent, frozen=True, tag=True):
    """The crew lit a point or a line; the whole line ignited at ``lit_at_us``."""

    points: tuple[Place, ...]
    lit_at_us: MissionUs


class Corrected(OperatorEvent, frozen=True, tag=True):
    """A correction of the fire at a point, along a line or in a polygon.

    ``state`` is the state at ``marked_at_us``, which may be in the past or in the future. The fire
    arrives before that time for the state ``burned``, at that time for ``burning``, and after that
    time for ``unburned``. At that time a ``burning`` polygon burns on its outline, and its inside
    has already burned.
    """

    state: Literal["burned", "burning", "unburned"]
    shape: Literal["point", "line", "polygon"]
    points: tuple[Place, ...]
    marked_at_us: MissionUs


class FireObserved(OperatorEvent, frozen=True, tag=True):
    """A person, detector or satellite observed the fire at places at ``seen_at_us``.

    Unlike a correction, an observation may be wrong; the estimate weighs observations by their
    errors. ``source`` names the sensor and is empty for a person. ``position_sd_m``, ``missed`` and
    ``false_alarms`` have the meaning that they have in ``Observed``. ``hot`` ground has the
    temperature ``temperature_c``. An area with the state ``smoke`` was hidden from ``source``, or
    from the sender if ``source`` is empty. ``role`` is the highest role of the sender, as checked
    by the interface, and is empty if the interface identifies no user. ``islands`` are the outlines
    of parts of a polygon about which the report states nothing. ``file`` names the file from which
    a sensor read the observation (``sensors/sensor_files.py``); ``by`` is then the sensor.
    """

    state: Literal["burned", "burning", "unburned", "hot", "smoke"]
    shape: Literal["points", "line", "polygon"]
    points: tuple[Place, ...]
    seen_at_us: MissionUs
    position_sd_m: Radius
    false_alarms: Fraction
    source: str
    temperature_c: Temperature | None = None
    missed: Fraction = 0.0
    role: str = ""
    islands: tuple[tuple[Place, ...], ...] = ()
    file: str = ""


class RasterObserved(OperatorEvent, frozen=True, tag=True):
    """A detector classified the cells of a raster at ``seen_at_us``.

    The raster covers the area between its edges in equal steps of latitude and longitude (WGS84).
    ``rows`` are from north to south, all of the same length; a cell is ``b`` (burned), ``u``
    (unburned) or ``.`` (not seen). The other fields are those of ``FireObserved``.
    """

    south_deg: Latitude
    west_deg: Longitude
    north_deg: Latitude
    east_deg: Longitude
    rows: tuple[str, ...]
    seen_at_us: MissionUs
    position_sd_m: Radius
    false_alarms: Fraction
    source: str
    missed: Fraction = 0.0
    role: str = ""


class Erased(OperatorEvent, frozen=True, tag=True):
    """Corrections within ``radius_m`` of a place are removed."""

    lat_deg: Latitude
    lon_deg: Longitude
    radius_m: Radius


class Undone(OperatorEvent, frozen=True, tag=True):
    """The last correction or erasure is undone."""


class Redone(OperatorEvent, frozen=True, tag=True):
    """The last undone correction or erasure is restored."""


class WindSet(OperatorEvent, frozen=True, tag=True):
    """The crew set the wind 6.1 m above the vegetation.

    ``from_deg`` is the direction from which the wind blows, clockwise from true north.
    """

    speed_m_s: WindSpeed
    from_deg: Bearing


class PersonReported(OperatorEvent, frozen=True, tag=True):
    """A person is at a place, with a circle of ``radius_m`` that is kept clear.

    A radius of 0 removes the person.
    """

    name: str
    lat_deg: Latitude
    lon_deg: Longitude
    radius_m: Radius


class BurnUnitSet(OperatorEvent, frozen=True, tag=True):
    """The boundary of the burn unit was set to this polygon."""

    points: tuple[Place, ...]


class ChecklistAnswered(OperatorEvent, frozen=True, tag=True):
    """An answer, GO or NO-GO, to one item of the checklist."""

    item: str
    go: bool


class PlanRequested(OperatorEvent, frozen=True, tag=True):
    """A plan of the next ignition line is requested; a spacing of None remains unchanged."""

    line_spacing_m: float | None = None
    drop_spacing_m: float | None = None


class Approved(OperatorEvent, frozen=True, tag=True):
    """An operator approved the plan with this hash."""

    plan_hash: str


class Rejected(OperatorEvent, frozen=True, tag=True):
    """An operator rejected the plan with this hash."""

    plan_hash: str


class NoteAdded(OperatorEvent, frozen=True, tag=True):
    """A note about a place; it changes neither the fire nor a vehicle.

    ``photo`` is the name of a stored photo of the place, which contains its SHA-256, or empty.
    """

    text: str
    lat_deg: Latitude
    lon_deg: Longitude
    photo: str = ""


class AirspaceClosed(OperatorEvent, frozen=True, tag=True):
    """A volume of airspace is closed to all vehicles from now on.

    ``corners`` are latitude and longitude in degrees. A limit of None means the ground, or no upper
    limit. The volume opens after ``for_s``, or never by itself if this is None.
    """

    name: str
    corners: tuple[tuple[Latitude, Longitude], ...]
    floor_amsl_m: Altitude | None = None
    ceiling_amsl_m: Altitude | None = None
    for_s: DurationS | None = None


class AirspaceOpened(OperatorEvent, frozen=True, tag=True):
    """The closed volume with this name is open again."""

    name: str


class ClearingOrdered(OperatorEvent, frozen=True, tag=True):
    """All vehicles leave a volume of airspace, or land if ``volume`` is empty.

    ``corners`` and limits are those of ``AirspaceClosed``; without corners the volume is a volume
    of the run that is closed already.
    """

    volume: str = ""
    corners: tuple[tuple[Latitude, Longitude], ...] = ()
    floor_amsl_m: Altitude | None = None
    ceiling_amsl_m: Altitude | None = None


class ClearingCancelled(OperatorEvent, frozen=True, tag=True):
    """The airspace is not cleared any longer: vehicles on their way hold."""


class Aborted(OperatorEvent, frozen=True, tag=True):
    """An operator ordered an abort: drops end, and vehicles climb to the safe height and hold."""


class AlarmAcknowledged(OperatorEvent, frozen=True, tag=True):
    """An operator has read an alarm (its key) and attends to it."""

    alarm: str


class OperatorHeartbeat(OperatorEvent, frozen=True, tag=True):
    """A report, every few seconds, that an operator's display is open."""


class Resumed(OperatorEvent, frozen=True, tag=True):
    """The service was restarted after a pause of ``down_s``; earlier approvals are unconfirmed."""

    down_s: DurationS


class LinesSkipped(OperatorEvent, frozen=True, tag=True):
    """Lines of the journal that a restart skipped, as (segment, line, reason).

    These lines could not be read or handled. The restart applied the other lines, with the commands
    recorded in them.
    """

    lines: tuple[tuple[Count, Count, str], ...]


class FireReachedEdge(OperatorEvent, frozen=True, tag=True):
    """The simulated fire has reached the edge of the landscape.

    The position is that of the first burned cell at the edge, which ignited at ``arrived_at_us``.
    """

    arrived_at_us: MissionUs
    lat_deg: Latitude
    lon_deg: Longitude


Order = Literal["hold", "resume", "return", "start", "land", "go-around", "takeoff"]


class OrderGiven(OperatorEvent, frozen=True, tag=True):
    """An order of an operator, or of the service (``SERVICE``), to one vehicle or to all ("").

    A ``confirmed`` order may end a mode that the autopilot or the pilot selected, such as a
    failsafe, and may use the energy that is needed for the flight home. A hold with ``hold_at`` is
    at this position and altitude (latitude, longitude, m AMSL) instead of the current position. A
    takeoff with ``override``, the operator's reason, is executed although pre-flight checks fail.
    """

    vehicle: str
    order: Order
    confirmed: bool = False
    hold_at: tuple[Latitude, Longitude, Altitude] | None = None
    override: str = ""


SERVICE = "service"  # ``by`` in the service's own orders; interfaces refuse this name


class MissionRequested(OperatorEvent, frozen=True, tag=True):
    """A new mission is requested for a vehicle, or for all vehicles if ``vehicle`` is empty."""

    vehicle: str


class MissionAccepted(OperatorEvent, frozen=True, tag=True):
    """An operator accepted the proposed mission with this hash."""

    vehicle: Name
    mission_hash: str


class MissionRefused(OperatorEvent, frozen=True, tag=True):
    """An operator refused the proposed mission with this hash."""

    vehicle: Name
    mission_hash: str


class SettingsChanged(OperatorEvent, frozen=True, tag=True):
    """Settings of the planners changed; a setting of None remains unchanged.

    The names are those of the scenario's table ``[planner]``.
    """

    alpha: Annotated[
        Annotated[float, Meta(ge=0, le=100)] | None,
        Meta(description="Weight of uneven spread in decisions; 0: the vehicle circles."),
    ] = None
    reversal_margin: Annotated[
        Annotated[float, Meta(ge=0, le=100)] | None,
        Meta(
            description="Share by which importance behind must exceed importance ahead for a turn."
        ),
    ] = None
    dwell_s: Annotated[
        Annotated[float, Meta(ge=0, le=1e7)] | None,
        Meta(description="Minimum time from one turn to the next."),
    ] = None

    @property
    def given(self) -> dict[str, Any]:
        """The settings that change, by name."""
        values = {name: getattr(self, name) for name in TUNED}
        return {name: value for name, value in values.items() if value is not None}


TUNED: dict[str, Any] = dict(SettingsChanged.__annotations__)  # type and bounds of each setting


AnyOperatorEvent = (
    IgnitionReported
    | Corrected
    | FireObserved
    | RasterObserved
    | Erased
    | Undone
    | Redone
    | WindSet
    | PersonReported
    | BurnUnitSet
    | ChecklistAnswered
    | PlanRequested
    | Approved
    | Rejected
    | Aborted
    | NoteAdded
    | AlarmAcknowledged
    | AirspaceClosed
    | AirspaceOpened
    | ClearingOrdered
    | ClearingCancelled
    | OperatorHeartbeat
    | OrderGiven
    | MissionRequested
    | MissionAccepted
    | MissionRefused
    | SettingsChanged
    | Resumed
    | LinesSkipped
    | FireReachedEdge
)

VehicleEvent = (
    VehicleConnected
    | LinkLost
    | LinkRestored
    | LinksReported
    | VehicleRebooted
    | Telemetry
    | MissionProgress
    | Observed
    | FrontsEstimated
    | CameraDirection
    | ImageCaptured
    | CameraFieldOfView
    | HotPointSeen
    | TargetTracked
    | WindMeasured
    | AirspeedMeasured
    | AirDataMeasured
    | ThrustStatusChanged
    | UploadFinished
    | MissionReadBack
    | CommandFinished
    | ModeChanged
    | PeerMessage
    | PeerLinkChanged
    | BatteryUpdated
    | GpsFixChanged
    | AutopilotText
    | SystemStateChanged
    | LandedStateChanged
    | FenceStatusChanged
    | EstimatorStatusChanged
    | RemoteIdChanged
    | ParametersReported
    | AircraftReported
    | DropFinished
    | HostTime
)
AnyEvent = VehicleEvent | AnyOperatorEvent
