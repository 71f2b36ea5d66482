"""What the core wants done or known: its outputs. Journalled after the event that caused them."""

from typing import Literal

import msgspec

from autopilot_bridge.items import MissionItem
from mission_service.ignition_plan import IgnitionPlan
from mission_service.peer_messages import AnyMessage

Direction = Literal["clockwise", "anticlockwise"]
Level = Literal["info", "warning"]
Severity = Literal["warning", "severe"]
CONFIRM = "confirm:"  # a line that begins so is a question: the order was not carried out


class Command(msgspec.Struct, frozen=True, tag=True, tag_field="type"):
    """Something to do for one vehicle."""

    vehicle: str


class UploadMission(Command, frozen=True, tag=True):
    """Replace the vehicle's mission; ``why`` is for people.

    ``keeps_apart``: it keeps the vehicle clear of another one, and waits for no approval.
    """

    mission_id: int
    why: str
    items: tuple[MissionItem, ...]
    keeps_apart: bool = False


class ProposeMission(Command, frozen=True, tag=True):
    """A mission that goes to the vehicle when a person accepts it, by its hash."""

    mission_id: int
    why: str
    items: tuple[MissionItem, ...]
    mission_hash: str


class WithdrawMission(Command, frozen=True, tag=True):
    """Withdraw a proposed mission, so that it can no longer be accepted."""

    mission_id: int
    why: str


class StartMission(Command, frozen=True, tag=True):
    """Arm where needed and fly the mission."""


class Hold(Command, frozen=True, tag=True):
    """Loiter where you are: the mission on board cannot be trusted."""


class Return(Command, frozen=True, tag=True):
    """Fly home: the time in the air is nearly over."""


class Orbit(Command, frozen=True, tag=True):
    """Circle a place from now on, anticlockwise with a negative radius; not by the mission."""

    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float
    radius_m: float


class ChangeSpeed(Command, frozen=True, tag=True):
    """Fly this airspeed until told otherwise."""

    airspeed_m_s: float


class Decided(Command, frozen=True, tag=True):
    """One decision of a planner; importances are 0 where its rule has none."""

    direction: Direction
    reversed: bool
    reversals: int
    importance_back: float
    importance_front: float
    front_cells: int


class Announce(Command, frozen=True, tag=True):
    """A line for the operator."""

    text: str
    level: Level = "info"


class RaiseAlarm(Command, frozen=True, tag=True):
    """Raise an alarm until it is cleared; ``alarm`` is its kind, one of a kind per vehicle."""

    alarm: str
    text: str
    severity: Severity = "warning"


class ClearAlarm(Command, frozen=True, tag=True):
    """Clear the alarm of this kind."""

    alarm: str


class Say(Command, frozen=True, tag=True):
    """Tell the UAVs that other processes fly."""

    message: AnyMessage


class ClimbAndHold(Command, frozen=True, tag=True):
    """Stop what is flown, climb at this place to this altitude, and hold there."""

    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float


class Propose(Command, frozen=True, tag=True):
    """A plan for people to approve, by its hash."""

    plan: IgnitionPlan
    plan_hash: str


class Withdraw(Command, frozen=True, tag=True):
    """A plan that was proposed or approved is void from now on."""

    plan_hash: str
    why: str


class Drop(Command, frozen=True, tag=True):
    """Let go of one sphere now: of the plan of this hash, the drop of this number.

    It is to fall at ``lat_deg``, ``lon_deg`` by what is known of height, speed and wind.
    """

    plan_hash: str
    number: int
    lat_deg: float
    lon_deg: float


AnyCommand = (
    UploadMission
    | ProposeMission
    | WithdrawMission
    | StartMission
    | Hold
    | Return
    | Orbit
    | ChangeSpeed
    | Decided
    | Announce
    | RaiseAlarm
    | ClearAlarm
    | Say
    | ClimbAndHold
    | Propose
    | Withdraw
    | Drop
)

# Commands that the vehicle's client carries out, by their names in the bridge's table
# (``autopilot_bridge/vehicle/orders.py``); their fields are its arguments, in order.
ORDER_NAMES: dict[type[AnyCommand], str] = {
    StartMission: "start mission",
    Hold: "hold",
    Return: "return",
    Orbit: "orbit",
    ChangeSpeed: "change speed",
    ClimbAndHold: "climb and hold",
}
