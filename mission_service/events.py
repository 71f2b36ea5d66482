"""What can happen: the inputs of the core. Each is journalled before it is handled.

``at_us`` is mission time in integer microseconds; 0 is the time of ignition of the scenario.
"""

import msgspec

from mission_service.formation.messages import AnyMessage


class Event(msgspec.Struct, frozen=True, tag=True, tag_field="type"):
    """Something that happened to one vehicle at mission time ``at_us``."""

    at_us: int
    vehicle: str


class VehicleConnected(Event, frozen=True, tag=True):
    """An autopilot was heard for the first time; ``stack`` names it (``px4 plane``)."""

    stack: str
    atomic_upload: bool


class LinkLost(Event, frozen=True, tag=True):
    """No heartbeat for ``silent_s``."""

    silent_s: float


class LinkRestored(Event, frozen=True, tag=True):
    """Heartbeats again."""


class VehicleRebooted(Event, frozen=True, tag=True):
    """The autopilot's clock went back to its start."""


class Telemetry(Event, frozen=True, tag=True):
    """Where the vehicle is (WGS84) and how it moves (GLOBAL_POSITION_INT)."""

    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float
    altitude_relative_m: float
    velocity_north_m_s: float
    velocity_east_m_s: float
    heading_deg: float


class MissionProgress(Event, frozen=True, tag=True):
    """The item the vehicle flies now (index into the items of the last mission)."""

    current_seq: int


class Observed(Event, frozen=True, tag=True):
    """What the camera saw: a window of cells with its north-west cell at (``row``, ``col``).

    Each string is a row from north to south, each character a cell from west to east:
    ``.`` outside the footprint, ``u`` unburned, ``b`` burning or burned.
    """

    row: int
    col: int
    cells: tuple[str, ...]


class WindMeasured(Event, frozen=True, tag=True):
    """The autopilot's estimate of the wind at the vehicle; from true north."""

    speed_m_s: float
    from_deg: float


class UploadFinished(Event, frozen=True, tag=True):
    """The outcome of one ``UploadMission``."""

    mission_id: int
    outcome: str
    reason: str


class CommandFinished(Event, frozen=True, tag=True):
    """The autopilot's answer to an order."""

    command: str
    accepted: bool
    reason: str


class ModeChanged(Event, frozen=True, tag=True):
    """The autopilot changed its flight mode or was armed or disarmed."""

    custom_mode: int
    armed: bool
    mode: str = ""  # the bridge's name of it


class Heard(Event, frozen=True, tag=True):
    """What a UAV that another process flies has said."""

    message: AnyMessage


class Contact(Event, frozen=True, tag=True):
    """Whether UAVs that other processes fly can be talked to from now on."""

    there: bool


AnyEvent = (
    VehicleConnected
    | LinkLost
    | LinkRestored
    | VehicleRebooted
    | Telemetry
    | MissionProgress
    | Observed
    | WindMeasured
    | UploadFinished
    | CommandFinished
    | ModeChanged
    | Heard
    | Contact
)
