"""The events of a vehicle's client; ``at_us`` is the time of detection by the link's clock."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from autopilot_bridge.missions.transfer import Kind, TransferResult
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.parameters import ParametersResult

DropOutcome = Literal["done", "refused", "unknown"]


@dataclass(frozen=True, slots=True)
class Connected:
    """The first HEARTBEAT of a supported autopilot has arrived."""

    at_us: int
    stack: Stack


@dataclass(frozen=True, slots=True)
class LinkLost:
    """No HEARTBEAT has arrived for ``silent_us``."""

    at_us: int
    silent_us: int


@dataclass(frozen=True, slots=True)
class LinkRestored:
    """A HEARTBEAT has arrived after the link was lost."""

    at_us: int


@dataclass(frozen=True, slots=True)
class Rebooted:
    """The autopilot has restarted: its time since boot began again at zero."""

    at_us: int


@dataclass(frozen=True, slots=True)
class Position:
    """GLOBAL_POSITION_INT in degrees, metres and m/s."""

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
class Attitude:
    """ATTITUDE: roll right wing down, pitch nose up, yaw clockwise from north (0 to 360)."""

    at_us: int
    boot_us: int
    roll_deg: float
    pitch_deg: float
    yaw_deg: float


@dataclass(frozen=True, slots=True)
class Speed:
    """VFR_HUD; the airspeed is None without a sensor."""

    at_us: int
    airspeed_m_s: float | None
    groundspeed_m_s: float
    climb_m_s: float
    throttle_percent: int


@dataclass(frozen=True, slots=True)
class Wind:
    """The autopilot's wind estimate: direction from, and speed."""

    at_us: int
    from_deg: float
    speed_m_s: float


class Status:
    """A state that is reported when it changes."""

    __slots__: tuple[str, ...] = ()

    def without_time(self) -> tuple[object, ...]:
        """Return the fields of which changes are reported."""
        return tuple(getattr(self, name) for name in self.__slots__ if name != "at_us")


@dataclass(frozen=True, slots=True)
class Battery(Status):
    """The state of a battery, reported on change; None for unknown values."""

    at_us: int
    battery_id: int
    percent: int | None
    voltage_v: float | None
    current_a: float | None


@dataclass(frozen=True, slots=True)
class Health(Status):
    """The names of enabled, unhealthy sensors, reported on change; () if all are healthy."""

    at_us: int
    unhealthy: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class GpsFix(Status):
    """Type of fix (``3d``, ``rtk fixed``, ``no fix`` ...) and satellites, reported on change."""

    at_us: int
    fix: str
    satellites: int | None


@dataclass(frozen=True, slots=True)
class SystemState(Status):
    """HEARTBEAT.system_status in a word (``active``, ``critical`` ...), reported on change."""

    at_us: int
    state: str


@dataclass(frozen=True, slots=True)
class LandedState(Status):
    """EXTENDED_SYS_STATE in words: ``on ground``, ``in air`` ...; reported on change."""

    at_us: int
    state: str


@dataclass(frozen=True, slots=True)
class FenceStatus(Status):
    """FENCE_STATUS: whether and where a fence is breached (``boundary`` ...), on change.

    Only ArduPilot sends it, while its fence is enabled; PX4 sends a text.
    """

    at_us: int
    breached: bool
    kind: str  # "" without a breach


@dataclass(frozen=True, slots=True)
class EstimatorStatus(Status):
    """Problems of the position estimate, in words, reported on change."""

    at_us: int
    healthy: bool
    problems: tuple[str, ...]


StatusEvent = SystemState | LandedState | FenceStatus | EstimatorStatus
TelemetryEvent = Position | Attitude | Speed | Wind | Battery | Health | GpsFix | StatusEvent


@dataclass(frozen=True, slots=True)
class MissionProgress:
    """The current item has changed; the number is an index into the user's items."""

    at_us: int
    current_seq: int


@dataclass(frozen=True, slots=True)
class ItemReached:
    """MISSION_ITEM_REACHED, without repetitions."""

    at_us: int
    seq: int


@dataclass(frozen=True, slots=True)
class TransferFinished:
    """A requested transfer has ended."""

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
    command_id: int = 0


@dataclass(frozen=True, slots=True)
class DropFinished:
    """The outcome of one drop. ``refused``: nothing was released. ``unknown``: it may have been
    released. ``done``: the autopilot has accepted the command; it does not detect the fall.
    """

    at_us: int
    drop_id: int
    outcome: DropOutcome
    reason: str


@dataclass(frozen=True, slots=True)
class ParametersFinished:
    """A parameter request has ended."""

    at_us: int
    request_id: int
    result: ParametersResult


@dataclass(frozen=True, slots=True)
class ModeChanged:
    """Flight mode or arming changed."""

    at_us: int
    custom_mode: int
    armed: bool
    name: str = ""  # the name of the mode in ``Stack.modes``


@dataclass(frozen=True, slots=True)
class Text:
    """STATUSTEXT."""

    at_us: int
    severity: int
    text: str


AlarmKind = Literal["source", "clock", "jump", "value"]


@dataclass(frozen=True, slots=True)
class SameSystemId:
    """Two remotes of one link send with one system id; messages of ``left_out`` are discarded."""

    at_us: int
    kept: str
    left_out: str
    kind: ClassVar[AlarmKind] = "source"

    def __str__(self) -> str:
        return (
            f"{self.kept} and {self.left_out} both send with this system id; the messages of "
            f"{self.left_out} are discarded: give it another system id or a separate link, "
            "or sign the link if it is forged"
        )


@dataclass(frozen=True, slots=True)
class RemoteChanged:
    """The vehicle is bound to another remote after the previous one stopped sending."""

    at_us: int
    before: str
    after: str
    kind: ClassVar[AlarmKind] = "source"

    def __str__(self) -> str:
        return (
            f"messages arrive from {self.after} now, no longer from {self.before}; if the "
            "autopilot was not restarted and its network has not changed, the sender may not be "
            "the vehicle"
        )


@dataclass(frozen=True, slots=True)
class Implausible:
    """A message of the vehicle is implausible (``clock``, ``jump``, ``value``)."""

    at_us: int
    kind: AlarmKind
    text: str

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class AlarmEnded:
    """The cause of the alarms of a kind has not occurred for some time."""

    at_us: int
    kind: AlarmKind


@dataclass(frozen=True, slots=True)
class ClockChanged:
    """The autopilot's time since boot continues from another value without a restart."""

    at_us: int


LinkAlarm = SameSystemId | RemoteChanged | Implausible


ClientEvent = (
    LinkAlarm
    | AlarmEnded
    | ClockChanged
    | Connected
    | LinkLost
    | LinkRestored
    | Rebooted
    | TelemetryEvent
    | MissionProgress
    | ItemReached
    | TransferFinished
    | CommandFinished
    | DropFinished
    | ParametersFinished
    | ModeChanged
    | Text
)
