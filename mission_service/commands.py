"""Defines the commands: the outputs of the core, which makes all decisions in a run.

Each command is journalled after the event that caused it.
"""

from typing import Literal

import msgspec

from autopilot_bridge.items import MissionItem
from mission_service.events import SERVICE, Order
from mission_service.ignition_plan import IgnitionPlan
from mission_service.peer_messages import AnyMessage

Direction = Literal["clockwise", "anticlockwise"]
Level = Literal["info", "warning"]
Severity = Literal["warning", "severe"]
CheckState = Literal["pass", "fail", "unknown"]
ReliefRole = Literal["stands by", "relieves", "resumes", "on task", "leaves"]
LandingPhaseName = Literal["none", "waiting", "sending", "approach", "final", "going around"]
ClearingPhase = Literal[
    "ordered", "acknowledged", "waiting", "on its way", "out", "on the ground", "not reached"
]
CLEARED: tuple[ClearingPhase, ...] = ("out", "on the ground")
ClearingOutcome = Literal["in force", "complete", "cancelled"]
REJECTED = "rejected:"  # prefix of the announcement that a request was not carried out
CONFIRM = "confirm:"  # prefix of the announcement that an order needs confirmation


class Command(msgspec.Struct, frozen=True, tag=True, tag_field="type"):
    """A command for one vehicle."""

    vehicle: str


class UploadMission(Command, frozen=True, tag=True):
    """Replace the vehicle's mission; ``why`` is shown to operators.

    A mission with ``keeps_apart`` separates two vehicles, and a mission with ``lands`` lands at
    home; neither needs an approval.
    """

    mission_id: int
    why: str
    items: tuple[MissionItem, ...]
    keeps_apart: bool = False
    lands: bool = False


class ProposeMission(Command, frozen=True, tag=True):
    """Propose a mission, which is uploaded when an operator accepts the mission's hash."""

    mission_id: int
    why: str
    items: tuple[MissionItem, ...]
    mission_hash: str


class WithdrawMission(Command, frozen=True, tag=True):
    """Withdraw a proposed mission, so that operators can no longer accept the mission."""

    mission_id: int
    why: str


class StartMission(Command, frozen=True, tag=True):
    """Arm if necessary and fly the mission."""


class Hold(Command, frozen=True, tag=True):
    """Loiter at the current position."""


class Return(Command, frozen=True, tag=True):
    """Fly home and land."""


class Land(Command, frozen=True, tag=True):
    """Fly the landing mission on board; a vehicle on the ground is not armed."""


class GoAround(Command, frozen=True, tag=True):
    """Break off a landing on its last leg: climb to this altitude, and hold at this position."""

    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float


class ShowLanding(Command, frozen=True, tag=True):
    """Show the phase of a vehicle's landing.

    If ``holds``, the landing was broken off, and the vehicle holds until an operator's order.
    """

    phase: LandingPhaseName
    holds: bool = False


class ShowRelief(Command, frozen=True, tag=True):
    """Show the vehicle's role in a task that vehicles fly in turn, also in words.

    A vehicle that is now ``on task`` takes over the planner of the vehicle ``takes_over_from``
    (empty: no vehicle).
    """

    role: ReliefRole
    text: str
    takes_over_from: str = ""


class Orbit(Command, frozen=True, tag=True):
    """Orbit a position that is not in the mission; a negative radius means anticlockwise."""

    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float
    radius_m: float


class ChangeSpeed(Command, frozen=True, tag=True):
    """Fly at this airspeed until the next command."""

    airspeed_m_s: float


class DirectionDecision(Command, frozen=True, tag=True):
    """A planner's decision on the flight direction; importances are 0 if the rule uses none.

    ``reversals`` is the planner's own count, which includes decisions that cause no command, such
    as decisions during a hold. Interfaces count the commands with ``reversed``.
    """

    direction: Direction
    reversed: bool
    reversals: int
    importance_back: float
    importance_front: float
    front_cells: int


class Announce(Command, frozen=True, tag=True):
    """Show a line to the operator."""

    text: str
    level: Level = "info"


class RaiseAlarm(Command, frozen=True, tag=True):
    """Raise an alarm until a ``ClearAlarm``; a vehicle has at most one alarm of each kind."""

    alarm: str
    text: str
    severity: Severity = "warning"


class ClearAlarm(Command, frozen=True, tag=True):
    """Clear the vehicle's alarm of the kind ``alarm``."""

    alarm: str


class ReportEnergy(Command, frozen=True, tag=True):
    """Report how long the vehicle's energy lasts; None without an estimate, as on the ground.

    ``time_on_task_s`` is the time until the vehicle must fly home, negative after this time, by
    ``source``. ``time_home_s`` is the time of the flight home; None if the wind prevents it.
    ``time_landing_s`` is the time of the landing after the arrival at home.
    """

    time_on_task_s: int | None
    time_home_s: int | None
    time_landing_s: int | None
    source: str


class PreflightCheck(msgspec.Struct, frozen=True):
    """A pre-flight check: its result, and a line with the figures and the remedy."""

    name: str
    state: CheckState
    text: str


class ReportChecks(Command, frozen=True, tag=True):
    """Report the pre-flight checks of a vehicle on the ground; in the air there are none.

    ``waits`` is whether the next takeoff needs a sign-off, and ``signed_off_by`` the person whose
    sign-off is in force.
    """

    checks: tuple[PreflightCheck, ...]
    waits: bool = False
    signed_off_by: str = ""


class BroadcastMessage(Command, frozen=True, tag=True):
    """Send a message to the UAVs that other processes control."""

    message: AnyMessage


class ClimbAndHold(Command, frozen=True, tag=True):
    """Leave the mission, climb at this position to this altitude, and hold there."""

    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float


class HoldAt(Command, frozen=True, tag=True):
    """Fly to a position and altitude, and hold there; planes circle."""

    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float


class AlertOnAircraft(Command, frozen=True, tag=True):
    """The alert level (0 to 3) of a vehicle about another aircraft has changed."""

    aircraft: str
    level: int


class OrderByService(Command, frozen=True, tag=True):
    """Give the vehicle an order: the event ``OrderGiven`` by ``by`` follows.

    ``hold_at`` is that of the event. ``by`` is the service, or the operator whose request to clear
    the airspace the order carries out.
    """

    order: Order
    hold_at: tuple[float, float, float] | None = None
    by: str = SERVICE


class ClearedVehicle(msgspec.Struct, frozen=True):
    """The progress of one vehicle while the airspace is cleared (mission time in microseconds).

    ``why`` states why the vehicle is not reached. The vehicle should be out by ``out_by_us``, which
    is stated once; ``expected_us`` is the present prediction. Both times are None if no prediction
    is possible.
    """

    vehicle: str
    phase: ClearingPhase
    why: str
    out_by_us: int | None
    expected_us: int | None


class ShowClearing(Command, frozen=True, tag=True):
    """Show the progress of clearing the airspace.

    ``volume`` is the name of the volume that the vehicles leave; empty: all vehicles land.
    ``vehicles`` are in the order in which they land.
    """

    volume: str
    by: str
    ordered_at_us: int
    outcome: ClearingOutcome
    vehicles: tuple[ClearedVehicle, ...]


class ProposePlan(Command, frozen=True, tag=True):
    """Propose an ignition plan, which an operator approves by the plan's hash."""

    plan: IgnitionPlan
    plan_hash: str


class WithdrawPlan(Command, frozen=True, tag=True):
    """Withdraw a plan that was proposed or approved."""

    plan_hash: str
    why: str


class Drop(Command, frozen=True, tag=True):
    """Release one ignition sphere now: drop ``number`` of the plan with this hash.

    ``lat_deg`` and ``lon_deg`` are the landing point predicted from height, speed and wind.
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
    | Land
    | GoAround
    | ShowLanding
    | ShowRelief
    | Orbit
    | ChangeSpeed
    | DirectionDecision
    | Announce
    | RaiseAlarm
    | ClearAlarm
    | ReportEnergy
    | ReportChecks
    | BroadcastMessage
    | ClimbAndHold
    | HoldAt
    | AlertOnAircraft
    | OrderByService
    | ShowClearing
    | ProposePlan
    | WithdrawPlan
    | Drop
)

# The commands that the vehicle's client executes, with their names in the bridge's table
# (``autopilot_bridge/vehicle/orders.py``). A command's fields are the arguments, in order.
ORDER_NAMES: dict[type[AnyCommand], str] = {
    StartMission: "start mission",
    Hold: "hold",
    Return: "return",
    Land: "fly landing",
    GoAround: "go around",
    Orbit: "orbit",
    ChangeSpeed: "change speed",
    ClimbAndHold: "climb and hold",
    HoldAt: "hold at another height",
}
