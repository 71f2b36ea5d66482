"""Defines the events of a vehicle's client; ``at_us`` is the detection time on the link's clock."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from operator import attrgetter
from typing import ClassVar, Literal

from autopilot_bridge.missions.transfer import Kind, TransferResult
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.aircraft_seen import AircraftSeen
from autopilot_bridge.vehicle.camera_telemetry import CameraEvent
from autopilot_bridge.vehicle.link_selection import Cause, LinkStatus
from autopilot_bridge.vehicle.parameters import ParametersResult

DropOutcome = Literal["done", "refused", "unknown"]
RemoteIdState = Literal["ready", "fails", "lost"]


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
class LinksChanged:
    """The states of the vehicle's links, the preferred link first, and the link in use.

    ``cause`` is set if the link in use has changed: the link used before was silent, lost frames,
    or was less preferred than a link that has recovered.
    """

    at_us: int
    links: tuple[LinkStatus, ...]
    in_use: str
    cause: Cause


@dataclass(frozen=True, slots=True)
class Rebooted:
    """The autopilot has restarted: its time since boot began again from zero."""

    at_us: int


@dataclass(frozen=True, slots=True)
class Position:
    """The position and velocity from a GLOBAL_POSITION_INT, in degrees, metres and m/s."""

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
    """The roll (right wing down), pitch (nose up) and yaw (clockwise from north, 0 to 360)."""

    at_us: int
    boot_us: int
    roll_deg: float
    pitch_deg: float
    yaw_deg: float


@dataclass(frozen=True, slots=True)
class Speed:
    """The speeds from a VFR_HUD; the airspeed is None if the vehicle has no airspeed sensor."""

    at_us: int
    airspeed_m_s: float | None
    groundspeed_m_s: float
    climb_m_s: float
    throttle_percent: int


@dataclass(frozen=True, slots=True)
class Wind:
    """The autopilot's wind estimate: the speed, and the direction from which the wind blows."""

    at_us: int
    from_deg: float
    speed_m_s: float


class Status:
    """A state that is reported when it changes."""

    __slots__: tuple[str, ...] = ()

    def without_time(self) -> object:
        """Return the values of all fields but ``at_us``; a change of these values is an event."""
        return _reported_fields(self.__slots__)(self)


@cache
def _reported_fields(names: tuple[str, ...]) -> Callable[[Status], object]:
    return attrgetter(*(name for name in names if name != "at_us"))


@dataclass(frozen=True, slots=True)
class Battery(Status):
    """The state of a battery, reported on change and every ten seconds; unknown values are None.

    ``consumed_mah`` is the charge used; ``remaining_s`` is the autopilot's own estimate.
    """

    at_us: int
    battery_id: int
    percent: int | None
    voltage_v: float | None
    current_a: float | None
    consumed_mah: int | None = None
    remaining_s: int | None = None


@dataclass(frozen=True, slots=True)
class Health(Status):
    """The names of enabled but unhealthy sensors, reported on change; empty if all are healthy."""

    at_us: int
    unhealthy: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class GpsFix(Status):
    """The type of fix (``3d``, ``no fix`` ...) and number of satellites, reported on change."""

    at_us: int
    fix: str
    satellites: int | None


@dataclass(frozen=True, slots=True)
class SystemState(Status):
    """The system status in a HEARTBEAT as a word (``active`` ...), reported on change."""

    at_us: int
    state: str


@dataclass(frozen=True, slots=True)
class LandedState(Status):
    """The landed state in words (``on ground``, ``in air`` ...), reported on change."""

    at_us: int
    state: str


@dataclass(frozen=True, slots=True)
class FenceStatus(Status):
    """The state of the fence (breached or not, ``kind`` of breach), reported on change.

    Only ArduPilot sends FENCE_STATUS, and only while its fence is enabled; PX4 sends a text
    instead.
    """

    at_us: int
    breached: bool
    kind: str  # "" if the fence is not breached


@dataclass(frozen=True, slots=True)
class EstimatorStatus(Status):
    """The problems of the position estimate in words, reported on change."""

    at_us: int
    healthy: bool
    problems: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class RemoteIdStatus(Status):
    """The state of the vehicle's Remote ID module, reported on change.

    ``text`` is the module's error, or how the state was determined; "" if there is no error.
    """

    at_us: int
    state: RemoteIdState
    text: str


StatusEvent = SystemState | LandedState | FenceStatus | EstimatorStatus | RemoteIdStatus
TelemetryEvent = Position | Attitude | Speed | Wind | Battery | Health | GpsFix | StatusEvent


@dataclass(frozen=True, slots=True)
class MissionProgress:
    """A change of the current item; the number is an index into the user's items."""

    at_us: int
    current_seq: int


@dataclass(frozen=True, slots=True)
class ItemReached:
    """The arrival at a mission item, reported once (MISSION_ITEM_REACHED is repeated)."""

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
    """A sequence of commands has ended; ``replaced`` if a later order ended it."""

    at_us: int
    name: str
    accepted: bool
    reason: str
    command_id: int = 0
    replaced: bool = False


@dataclass(frozen=True, slots=True)
class DropFinished:
    """The outcome of one drop.

    ``refused``: nothing was released. ``unknown``: the object may have been released. ``done``: the
    autopilot has accepted the command; the autopilot cannot detect whether the object fell.
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
    """The flight mode has changed, or the vehicle was armed or disarmed."""

    at_us: int
    custom_mode: int
    armed: bool
    name: str = ""  # the name of the mode in ``Stack.modes``


@dataclass(frozen=True, slots=True)
class Text:
    """A text from the autopilot (STATUSTEXT)."""

    at_us: int
    severity: int
    text: str


AlarmKind = Literal["source", "clock", "jump", "value"]


@dataclass(frozen=True, slots=True)
class SameSystemId:
    """Two remote endpoints use one system id; messages from ``left_out`` are discarded."""

    at_us: int
    kept: str
    left_out: str
    kind: ClassVar[AlarmKind] = "source"

    def __str__(self) -> str:
        return (
            f"{self.kept} and {self.left_out} both send with this system id; the messages of "
            f"{self.left_out} are discarded: assign it another system id or a separate link, or "
            "sign the link if it is forged"
        )


@dataclass(frozen=True, slots=True)
class RemoteChanged:
    """The vehicle was bound to another remote endpoint after the previous one stopped sending."""

    at_us: int
    before: str
    after: str
    kind: ClassVar[AlarmKind] = "source"

    def __str__(self) -> str:
        return (
            f"messages now arrive from {self.after} and no longer from {self.before}; if the "
            "autopilot was not restarted and its network has not changed, the sender may not be "
            "the vehicle"
        )


@dataclass(frozen=True, slots=True)
class Implausible:
    """A report that the time, the position or another value in a message is implausible."""

    at_us: int
    kind: AlarmKind
    text: str

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class AlarmEnded:
    """The end of an alarm: its cause has not occurred for some time."""

    at_us: int
    kind: AlarmKind


@dataclass(frozen=True, slots=True)
class ClockChanged:
    """The autopilot's time since boot continues from another value, without a restart."""

    at_us: int


LinkAlarm = SameSystemId | RemoteChanged | Implausible


ClientEvent = (
    LinkAlarm
    | AlarmEnded
    | ClockChanged
    | Connected
    | LinkLost
    | LinkRestored
    | LinksChanged
    | Rebooted
    | TelemetryEvent
    | CameraEvent
    | AircraftSeen
    | MissionProgress
    | ItemReached
    | TransferFinished
    | CommandFinished
    | DropFinished
    | ParametersFinished
    | ModeChanged
    | Text
)
