"""What a vehicle's client reports. ``at_us`` is the link's clock when it was noticed."""

from dataclasses import dataclass

from autopilot_bridge.stacks import Stack
from autopilot_bridge.transfer import Kind, TransferResult


@dataclass(frozen=True, slots=True)
class Connected:
    """The first HEARTBEAT of a known autopilot."""

    at_us: int
    stack: Stack


@dataclass(frozen=True, slots=True)
class LinkLost:
    """No HEARTBEAT for ``silent_us``."""

    at_us: int
    silent_us: int


@dataclass(frozen=True, slots=True)
class LinkRestored:
    """HEARTBEATs again."""

    at_us: int


@dataclass(frozen=True, slots=True)
class Rebooted:
    """The autopilot's time since boot went back."""

    at_us: int


@dataclass(frozen=True, slots=True)
class Position:
    """GLOBAL_POSITION_INT in units people use."""

    at_us: int
    boot_us: int
    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float
    altitude_relative_m: float
    velocity_north_m_s: float
    velocity_east_m_s: float
    velocity_down_m_s: float
    heading_deg: float


@dataclass(frozen=True, slots=True)
class MissionProgress:
    """The item being flown has changed (index into the user's items)."""

    at_us: int
    current_seq: int


@dataclass(frozen=True, slots=True)
class ItemReached:
    """MISSION_ITEM_REACHED, repeats left out."""

    at_us: int
    seq: int


@dataclass(frozen=True, slots=True)
class TransferFinished:
    """A transfer asked for has ended."""

    at_us: int
    transfer_id: int
    action: str  # upload, download, clear
    result: TransferResult
    kind: Kind = "mission"


@dataclass(frozen=True, slots=True)
class CommandFinished:
    """A sequence of commands has ended."""

    at_us: int
    name: str
    accepted: bool
    reason: str


@dataclass(frozen=True, slots=True)
class ModeChanged:
    """Flight mode or arming changed."""

    at_us: int
    custom_mode: int
    armed: bool


@dataclass(frozen=True, slots=True)
class Text:
    """STATUSTEXT."""

    at_us: int
    severity: int
    text: str


ClientEvent = (
    Connected
    | LinkLost
    | LinkRestored
    | Rebooted
    | Position
    | MissionProgress
    | ItemReached
    | TransferFinished
    | CommandFinished
    | ModeChanged
    | Text
)
