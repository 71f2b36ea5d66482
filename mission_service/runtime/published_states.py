"""The states that interfaces publish: flat JSON with units in its keys."""

import math
from typing import Literal

import msgspec

from autopilot_bridge.items import MissionItem, command_name, place_of
from mission_service.commands import Severity


class TelemetryState(msgspec.Struct, tag="telemetry/1", tag_field="schema"):
    """Where a vehicle was last heard to be (WGS84), and how it moved."""

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
    """The circle round a virtual agent that was ordered, anticlockwise with a negative radius.

    The camera covers a ring along it, ``view_width_m`` wide from the vehicle's height over ground.
    """

    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float
    radius_m: float
    view_width_m: float


class VehicleState(msgspec.Struct, tag="vehicle/1", tag_field="schema"):
    """All that is known of a vehicle but where it is and what it flies."""

    at_us: int
    vehicle: str
    kind: str
    stack: str
    system_id: int
    home_lat_deg: float
    home_lon_deg: float
    link: Literal["never heard", "online", "lost"] = "never heard"
    heard_stack: str = ""
    mode: str = ""
    armed: bool = False
    current_seq: int | None = None  # of the mission on board, the item flown now
    battery_pct: float | None = None
    position_good: bool = True
    position_fix: str = ""
    order: str = ""  # a person's that holds: hold, return
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
    """One item of a mission, as MAVLink carries it; places in degrees where it has one."""

    command: int
    name: str
    frame: int
    lat_deg: float | None
    lon_deg: float | None
    altitude_m: float
    params: tuple[float, float, float, float]


class Mission(msgspec.Struct):
    """One mission and what became of it."""

    mission_id: int
    at_us: int
    why: str
    outcome: str  # proposed, sending, accepted, or the bridge's word for what went wrong
    reason: str
    mission_hash: str
    items: tuple[ItemState, ...]


class MissionState(msgspec.Struct, tag="mission/1", tag_field="schema"):
    """What a vehicle has on board, what is on its way, and what waits for a person's word."""

    at_us: int
    vehicle: str
    on_board: Mission | None = None
    sending: Mission | None = None
    proposed: Mission | None = None


class Alarm(msgspec.Struct, tag="alarm/1", tag_field="schema"):
    """Something that is wrong until it is cleared."""

    alarm: str  # its key: link/hawk, broker, journal
    at_us: int
    vehicle: str
    severity: Severity
    text: str
    cleared_at_us: int | None = None


class Announcement(msgspec.Struct, tag="event/1", tag_field="schema"):
    """A line for people."""

    id: int
    at_us: int
    vehicle: str
    level: str
    text: str


class DropState(msgspec.Struct, tag="drop/1", tag_field="schema"):
    """One sphere: where it was to fall, and what is known of it."""

    at_us: int
    vehicle: str
    plan_hash: str
    number: int
    lat_deg: float
    lon_deg: float
    outcome: str = "ordered"

    @property
    def place(self) -> tuple[float, float]:
        """Latitude and longitude in degrees."""
        return self.lat_deg, self.lon_deg


def item_state(item: MissionItem) -> ItemState:
    """An item for people and programs that know no MAVLink frames."""
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
