"""What can happen: the inputs of the core. Each is journalled before it is handled.

``at_us`` is mission time in integer microseconds; 0 is the time of ignition of the scenario.

Limits of values are part of the types: the journal decodes each line before it writes it, so an
event with a value out of range, or one that is not a number, is neither journalled nor handled.
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
Percent = Annotated[float, Meta(ge=0, le=100)]
Radius = Annotated[float, Meta(ge=0, le=1e6)]  # m
Count = Annotated[int, Meta(ge=0, le=2**40)]
CellIndex = Annotated[int, Meta(ge=-(2**31), lt=2**31)]
Name = Annotated[str, Meta(min_length=1)]


class Event(msgspec.Struct, frozen=True, tag=True, tag_field="type"):
    """Something that happened to one vehicle at mission time ``at_us``."""

    at_us: MissionUs
    vehicle: Name


class VehicleConnected(Event, frozen=True, tag=True):
    """An autopilot was heard for the first time; ``stack`` names it (``px4 plane``)."""

    stack: str
    atomic_upload: bool


class LinkLost(Event, frozen=True, tag=True):
    """No heartbeat for ``silent_s``."""

    silent_s: DurationS


class LinkRestored(Event, frozen=True, tag=True):
    """Heartbeats again."""


class VehicleRebooted(Event, frozen=True, tag=True):
    """The autopilot's clock went back to its start."""


class Telemetry(Event, frozen=True, tag=True):
    """Where the vehicle is (WGS84) and how it moves (GLOBAL_POSITION_INT)."""

    lat_deg: Latitude
    lon_deg: Longitude
    altitude_amsl_m: Altitude
    altitude_relative_m: Altitude
    velocity_north_m_s: Velocity
    velocity_east_m_s: Velocity
    heading_deg: Bearing


class MissionProgress(Event, frozen=True, tag=True):
    """The item the vehicle flies now (index into the items of the last mission)."""

    current_seq: Count


class Observed(Event, frozen=True, tag=True):
    """What the camera saw: a window of cells with its north-west cell at (``row``, ``col``).

    Each string is a row from north to south, each character a cell from west to east:
    ``.`` outside the footprint, ``u`` unburned, ``b`` burning or burned. With ``corrects`` it is
    no camera's: people have said what is there, and what was known of these cells was wrong.
    """

    row: CellIndex
    col: CellIndex
    cells: tuple[str, ...]
    corrects: bool = False


class WindMeasured(Event, frozen=True, tag=True):
    """The autopilot's estimate of the wind at the vehicle; from true north."""

    speed_m_s: WindSpeed
    from_deg: Bearing


class AirspeedMeasured(Event, frozen=True, tag=True):
    """The mean airspeed of a while (VFR_HUD), reported when it has changed."""

    airspeed_m_s: Velocity


class ThrustStatusChanged(Event, frozen=True, tag=True):
    """Whether the thrust suffices: it does not where a vehicle sinks at full throttle (VFR_HUD)."""

    sufficient: bool
    throttle_percent: Count
    climb_m_s: Velocity


class UploadFinished(Event, frozen=True, tag=True):
    """The outcome of one ``UploadMission``."""

    mission_id: Count
    outcome: str
    reason: str


class MissionHeld(Event, frozen=True, tag=True):
    """What was read back from a vehicle after a restart of the service.

    ``mission_id`` is that of the mission it is, of those that were sent; 0 for any other, and where
    it could not be read: then ``items`` is None.
    """

    mission_id: Count
    items: Count | None


class CommandFinished(Event, frozen=True, tag=True):
    """The autopilot's answer to an order."""

    command: str
    accepted: bool
    reason: str


class ModeChanged(Event, frozen=True, tag=True):
    """The autopilot changed its flight mode or was armed or disarmed."""

    custom_mode: Count
    armed: bool
    mode: str = ""  # the bridge's name of it


class Heard(Event, frozen=True, tag=True):
    """What a UAV that another process flies has said."""

    message: AnyMessage


class Contact(Event, frozen=True, tag=True):
    """Whether UAVs that other processes fly can be talked to from now on."""

    there: bool


class BatteryTold(Event, frozen=True, tag=True):
    """What is left of the battery, told when it changes."""

    percent: Percent


class FixTold(Event, frozen=True, tag=True):
    """Whether the vehicle has a position fix in three dimensions, told when it changes."""

    good: bool
    fix: str


class AutopilotText(Event, frozen=True, tag=True):
    """A text that the autopilot wrote, with its MAV_SEVERITY: 0 emergency to 6 information."""

    severity: int
    text: str


class SystemStateChanged(Event, frozen=True, tag=True):
    """The autopilot's own state: ``standby``, ``active``, ``critical`` (in failsafe) ..."""

    state: str


class LandedStateChanged(Event, frozen=True, tag=True):
    """The landed state by the autopilot's estimate: ``on ground``, ``in air``, ``landing`` ..."""

    state: str


class FenceStatusChanged(Event, frozen=True, tag=True):
    """Whether a fence is breached, and which: ``boundary``, ``highest altitude`` ..."""

    breached: bool
    kind: str


class EstimatorStatusChanged(Event, frozen=True, tag=True):
    """Whether the autopilot's position estimate is healthy, and its problems in words."""

    healthy: bool
    problems: tuple[str, ...]


class DropFinished(Event, frozen=True, tag=True):
    """What became of one ``Drop``. Not ``done`` and not ``refused``: nobody knows."""

    plan_hash: str
    number: Count
    done: bool
    refused: bool
    reason: str

    @property
    def outcome(self) -> str:
        """In a word: done, refused or unknown."""
        return "done" if self.done else "refused" if self.refused else "unknown"


class HostTime(Event, frozen=True, tag=True):
    """The host's monotonic clock at this mission time; in burns, about once a second.

    Mission time follows the autopilot's clock, which may be slow or stop: limits of approvals are
    measured by this clock as well.
    """

    monotonic_us: int


class _ByUser(msgspec.Struct, frozen=True, tag=True, tag_field="type"):
    at_us: MissionUs
    by: str
    station: str


class Crew(_ByUser, frozen=True, tag=True, kw_only=True):
    """What a user did or reported; not of one vehicle. ``station`` is where they are.

    ``may_approve``: whether the user has the role approve, as checked by the interface.
    """

    may_approve: bool = False


Place = tuple[Latitude, Longitude]  # degrees


class Lit(Crew, frozen=True, tag=True):
    """The crew has lit a point or a line, all of it at ``lit_at_us``."""

    points: tuple[Place, ...]
    lit_at_us: MissionUs


class Corrected(Crew, frozen=True, tag=True):
    """The fire at ``marked_at_us`` (past, now, future), on a point, along a line or in a polygon.

    ``burned``: it has come there before; ``burning``: it comes then; ``unburned``: later.
    """

    state: Literal["burned", "burning", "unburned"]
    shape: Literal["point", "line", "polygon"]
    points: tuple[Place, ...]
    marked_at_us: MissionUs


class Erased(Crew, frozen=True, tag=True):
    """Marks within ``radius_m`` of a place are taken away."""

    lat_deg: Latitude
    lon_deg: Longitude
    radius_m: Radius


class Undone(Crew, frozen=True, tag=True):
    """The last correction or erasure is taken back."""


class Redone(Crew, frozen=True, tag=True):
    """What was taken back last holds again."""


class WindTold(Crew, frozen=True, tag=True):
    """The wind 6.1 m above the vegetation, from true north, as the crew has it from now on."""

    speed_m_s: WindSpeed
    from_deg: Bearing


class PersonTold(Crew, frozen=True, tag=True):
    """Somebody is at a place, with ``radius_m`` to be kept clear; 0: is no longer there."""

    name: str
    lat_deg: Latitude
    lon_deg: Longitude
    radius_m: Radius


class UnitTold(Crew, frozen=True, tag=True):
    """The burn unit is this polygon from now on."""

    points: tuple[Place, ...]


class Answered(Crew, frozen=True, tag=True):
    """GO or NO-GO to one item of the list."""

    item: str
    go: bool


class PlanWanted(Crew, frozen=True, tag=True):
    """Plan the next line; spacings from now on, where they are given."""

    line_spacing_m: float | None = None
    drop_spacing_m: float | None = None


class Approved(Crew, frozen=True, tag=True):
    """A person approves exactly the plan of this hash."""

    plan_hash: str


class Rejected(Crew, frozen=True, tag=True):
    """A person wants no plan of this hash flown."""

    plan_hash: str


class Aborted(Crew, frozen=True, tag=True):
    """Stop at once: no further drop, climb to the safe height and hold."""


class Present(Crew, frozen=True, tag=True):
    """Somebody is there and watches; told every few seconds."""


class Resumed(Crew, frozen=True, tag=True):
    """The service runs again after ``down_s``; whatever was approved before is in doubt."""

    down_s: DurationS


class LinesSkipped(Crew, frozen=True, tag=True):
    """Lines of the journal that a restart has skipped, as (segment, line, why).

    They could not be read or handled. The restart applied the rest of the journal without them,
    with the commands that it records.
    """

    lines: tuple[tuple[Count, Count, str], ...]


Order = Literal["hold", "resume", "return", "start"]


class Ordered(Crew, frozen=True, tag=True):
    """What a vehicle is to do by a person's word; all of them without a name.

    ``confirmed``: even if that ends a mode that autopilot or pilot selected, such as a failsafe.
    """

    vehicle: str
    order: Order
    confirmed: bool = False


SERVICE = "service"  # ``by`` of the service's own orders; no interface accepts it


class MissionWanted(Crew, frozen=True, tag=True):
    """A new mission is to be planned and sent now; for all vehicles without a name."""

    vehicle: str


class MissionAccepted(Crew, frozen=True, tag=True):
    """The mission of this hash, which was proposed, may go to the vehicle."""

    vehicle: Name
    mission_hash: str


class MissionRefused(Crew, frozen=True, tag=True):
    """The mission of this hash, which was proposed, is not to be flown."""

    vehicle: Name
    mission_hash: str


class SettingsTold(Crew, frozen=True, tag=True):
    """Settings of the planners from now on, where they are given; all that may change in flight.

    Each has the name that it has in the scenario's table ``[planner]``.
    """

    alpha: Annotated[
        Annotated[float, Meta(ge=0, le=100)] | None,
        Meta(description="How uneven the fire is taken to be; 0: the vehicle circles."),
    ] = None
    reversal_margin: Annotated[
        Annotated[float, Meta(ge=0, le=100)] | None,
        Meta(description="How much more importance behind than ahead makes a vehicle turn."),
    ] = None
    dwell_s: Annotated[
        Annotated[float, Meta(ge=0, le=1e7)] | None, Meta(description="From one turn to the next.")
    ] = None

    @property
    def given(self) -> dict[str, Any]:
        """Those that are given, by their names."""
        told = {name: getattr(self, name) for name in TUNED}
        return {name: value for name, value in told.items() if value is not None}


TUNED: dict[str, Any] = dict(SettingsTold.__annotations__)  # their types with bounds, by name


CrewEvent = (
    Lit
    | Corrected
    | Erased
    | Undone
    | Redone
    | WindTold
    | PersonTold
    | UnitTold
    | Answered
    | PlanWanted
    | Approved
    | Rejected
    | Aborted
    | Present
    | Ordered
    | MissionWanted
    | MissionAccepted
    | MissionRefused
    | SettingsTold
    | Resumed
    | LinesSkipped
)

VehicleEvent = (
    VehicleConnected
    | LinkLost
    | LinkRestored
    | VehicleRebooted
    | Telemetry
    | MissionProgress
    | Observed
    | WindMeasured
    | AirspeedMeasured
    | ThrustStatusChanged
    | UploadFinished
    | MissionHeld
    | CommandFinished
    | ModeChanged
    | Heard
    | Contact
    | BatteryTold
    | FixTold
    | AutopilotText
    | SystemStateChanged
    | LandedStateChanged
    | FenceStatusChanged
    | EstimatorStatusChanged
    | DropFinished
    | HostTime
)
AnyEvent = VehicleEvent | CrewEvent
