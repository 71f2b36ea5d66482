"""Defines the states that interfaces publish, as flat JSON with units in the keys."""

import math
from typing import Any, Literal

import msgspec

from autopilot_bridge.items import MissionItem, command_name, place_of
from mission_service.commands import (
    CLEARED,
    ClearedVehicle,
    ClearingOutcome,
    PreflightCheck,
    Severity,
    ShowClearing,
)


class TelemetryState(msgspec.Struct, tag="telemetry/1", tag_field="schema"):
    """The last received position (WGS84) and velocity of a vehicle."""

    at_us: int
    vehicle: str
    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float
    altitude_relative_m: float
    height_agl_m: float | None
    heading_deg: float
    ground_speed_m_s: float
    track_deg: float


class OrbitState(msgspec.Struct):
    """The commanded orbit around a virtual agent; a negative radius means anticlockwise.

    The camera covers a ring along the orbit. At the planned height the ring is ``view_width_m``
    wide.
    """

    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float
    radius_m: float
    view_width_m: float


class VolumeState(msgspec.Struct):
    """A closed volume of airspace; ``geometry`` is GeoJSON (longitude, latitude).

    A limit of None means the ground, or no upper limit. The volume is closed from ``from_us`` until
    ``until_us`` (mission time; None: until an operator opens the volume).
    """

    name: str
    geometry: dict[str, Any]
    floor_amsl_m: float | None
    ceiling_amsl_m: float | None
    from_us: int
    until_us: int | None


class ClearingStatus(msgspec.Struct):
    """The progress of clearing the airspace: the last request, and each vehicle concerned.

    ``volume`` is the volume that vehicles leave; empty: they land. ``vehicles_out`` of the vehicles
    are out, or on the ground. ``last_expected_us`` is the predicted time (mission time) at which
    the last vehicle that is reached is out; None if none is expected. ``ended_at_us`` is None while
    vehicles are not out. The vehicles are in the order in which they land.
    """

    volume: str
    by: str
    ordered_at_us: int
    outcome: ClearingOutcome
    ended_at_us: int | None
    vehicles_out: int
    last_expected_us: int | None
    vehicles: tuple[ClearedVehicle, ...]


class AirspaceStatus(msgspec.Struct, tag="airspace/1", tag_field="schema"):
    """The closed volumes of the run, and the highest altitude above ground (None: no limit).

    ``clearing`` is None before the first request to clear the airspace.
    """

    at_us: int
    volumes: list[VolumeState]
    max_altitude_agl_m: float | None
    clearing: ClearingStatus | None = None


class LinkState(msgspec.Struct):
    """The quality of one link of a vehicle."""

    link: str  # its address
    state: Literal["waiting", "up", "degraded", "silent"]
    in_use: bool  # whether the service sends over this link
    loss_pct: float | None  # frames lost in the last ten seconds; null if unknown
    silent_since_us: int | None  # time of the last frame on a silent link


class VehicleState(msgspec.Struct, tag="vehicle/1", tag_field="schema"):
    """The status of a vehicle, without its position and mission."""

    at_us: int
    vehicle: str
    kind: str
    stack: str
    system_id: int
    home_lat_deg: float
    home_lon_deg: float
    link: Literal["never heard", "online", "lost"] = "never heard"
    links: tuple[LinkState, ...] = ()  # the preferred link first
    detected_stack: str = ""
    mode: str = ""
    armed: bool = False
    current_seq: int | None = None  # index of the current item of the mission on board
    battery_pct: float | None = None
    lost_link: str = ""  # reaction to a lost link, in words; empty if unknown
    return_height_m: float | None = None  # of a return, from autopilot parameters; above home
    fence_action: str = ""  # reaction to a breached fence
    # State of the Remote ID module: "ready", "fails: ...", "lost: ..."; empty before a message.
    remote_id: str = ""
    # In flight: the time until the vehicle must fly home (negative after this time), the duration
    # of the flight home (null: unknown, or the wind prevents it) and of the landing, the mission
    # time by which the vehicle must have landed (with the reserve remaining), and the source of the
    # estimate.
    time_on_task_s: int | None = None
    time_home_s: int | None = None
    time_landing_s: int | None = None
    must_land_at_us: int | None = None
    energy_source: str = ""
    # On the ground: the pre-flight checks, whether the next takeoff needs a person's sign-off, and
    # the person whose sign-off is in force.
    checks: tuple[PreflightCheck, ...] = ()
    waits_for_signoff: bool = False
    signed_off_by: str = ""
    position_good: bool = True
    position_fix: str = ""
    order: str = ""  # the order in force: hold, return, land
    landing: str = ""  # phase of a landing: waiting, sending, approach, final, going around
    # In a task that vehicles fly in turn: "on task", "relieves hawk in 4 min", "stands by", ...
    relief: str = ""
    direction: str = ""
    decisions: int = 0
    reversals: int = 0
    reversed_at_us: int | None = None
    importance_back: float = 0.0
    importance_front: float = 0.0
    front_cells: int = 0
    orbit: OrbitState | None = None
    ordered_airspeed_m_s: float | None = None
    wind_speed_m_s: float | None = None
    wind_from_deg: float | None = None
    uploads_accepted: int = 0
    uploads_failed: int = 0
    drops_done: int = 0
    drops_refused: int = 0
    drops_unknown: int = 0


class ItemState(msgspec.Struct):
    """One MAVLink mission item; its position, if it has one, in degrees."""

    command: int
    name: str
    frame: int
    lat_deg: float | None
    lon_deg: float | None
    altitude_m: float
    params: tuple[float, float, float, float]


class Mission(msgspec.Struct):
    """One mission and its outcome."""

    mission_id: int
    at_us: int
    why: str
    outcome: str  # proposed, sending, accepted, or the bridge's word for a failure
    reason: str
    mission_hash: str
    items: tuple[ItemState, ...]


class MissionState(msgspec.Struct, tag="mission/1", tag_field="schema"):
    """The missions of a vehicle: on board, being uploaded, and proposed to the operator."""

    at_us: int
    vehicle: str
    on_board: Mission | None = None
    sending: Mission | None = None
    proposed: Mission | None = None


class Alarm(msgspec.Struct, tag="alarm/1", tag_field="schema"):
    """A fault, active until it is cleared.

    ``acknowledged_by`` names the operator that has acknowledged it; an alarm that becomes severe
    must be acknowledged again.
    """

    alarm: str  # key of the alarm: link/hawk, broker, journal
    at_us: int
    vehicle: str
    severity: Severity
    text: str
    cleared_at_us: int | None = None
    acknowledged_by: str = ""
    acknowledged_at_us: int | None = None


class Announcement(msgspec.Struct, tag="event/1", tag_field="schema"):
    """An announcement to the operators, one line."""

    id: int
    at_us: int
    vehicle: str
    level: str
    text: str


RecordKind = Literal["fire", "settings", "note", "mission", "alarm"]


class Record(msgspec.Struct, tag="record/1", tag_field="schema"):
    """A line of the log that is not announced: a correction of the fire, a mission, an alarm.

    ``note`` is the text of an operator's note about the place ``lat_deg``, ``lon_deg``, and
    ``photo`` the name of its photo.
    """

    id: int
    at_us: int
    vehicle: str
    level: str
    text: str
    kind: RecordKind
    note: str = ""
    lat_deg: float | None = None
    lon_deg: float | None = None
    photo: str = ""


SourceKind = Literal["camera", "sensor", "detector", "person"]
SourceStatus = Literal["waiting", "live", "late", "silent", "contradicts", "failed"]


class SourceState(msgspec.Struct, tag="source/1", tag_field="schema"):
    """The contribution and the state of a source of observations.

    A ``camera`` is that of a vehicle, a ``sensor`` is named in the scenario; a ``detector`` and a
    ``person`` send reports. ``waiting`` means that nothing was received yet; docs/sensors.md states
    when a source is late or silent.
    """

    at_us: int
    source: str
    kind: SourceKind
    state: SourceStatus
    problem: str  # why the source is not live, or what the sensor reports; may be empty
    observations: int
    not_used: int  # observations that contradicted other sources
    burned_cells: int  # sum over all observations
    unburned_cells: int
    last_at_us: int | None  # time of the latest observation
    age_s: float | None  # of the latest observation, at ``at_us``
    usual_interval_s: float | None  # median interval between observations
    position_sd_m: float | None  # standard deviation of the position of the last observation


AircraftAlert = Literal["none", "preventive", "corrective", "warning"]


class NearbyAircraft(msgspec.Struct, tag="aircraft/1", tag_field="schema"):
    """Another aircraft, relative to the vehicle with the highest alert or the smallest distance.

    ``age_s`` is the age of the position that was extrapolated to ``at_us``.
    """

    at_us: int
    aircraft: str  # ICAO address in hexadecimal digits, or another identifier
    callsign: str
    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float
    ground_speed_m_s: float
    track_deg: float
    climb_m_s: float
    age_s: float
    source: str
    alert: AircraftAlert
    vehicle: str
    distance_m: float  # horizontal
    above_m: float  # height above the vehicle; negative below it


class DropState(msgspec.Struct, tag="drop/1", tag_field="schema"):
    """One sphere: the sphere's planned position and the status of its drop."""

    at_us: int
    vehicle: str
    plan_hash: str
    number: int
    lat_deg: float
    lon_deg: float
    outcome: str = "ordered"

    @property
    def lat_lon(self) -> tuple[float, float]:
        """The latitude and longitude in degrees."""
        return self.lat_deg, self.lon_deg


def item_state(item: MissionItem) -> ItemState:
    """Return a mission item as a state, with the position in degrees."""
    lat_deg, lon_deg = place_of(item) or (None, None)
    params = tuple(
        0.0 if math.isnan(value) else value
        for value in (item.param1, item.param2, item.param3, item.param4)
    )
    return ItemState(
        item.command,
        command_name(item.command),
        item.frame,
        lat_deg,
        lon_deg,
        item.z,
        (params[0], params[1], params[2], params[3]),
    )


def clearing_status(shown: ShowClearing, at_us: int) -> ClearingStatus:
    """Return the progress that a command shows at the given mission time."""
    out = [each for each in shown.vehicles if each.phase in CLEARED]
    expected = [each.expected_us for each in shown.vehicles if each.expected_us is not None]
    in_force = shown.outcome == "in force"
    return ClearingStatus(
        shown.volume,
        shown.by,
        shown.ordered_at_us,
        shown.outcome,
        None if in_force else at_us,
        len(out),
        max(expected, default=None) if in_force else None,
        shown.vehicles,
    )
