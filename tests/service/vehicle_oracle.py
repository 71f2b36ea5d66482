"""Checks the commands of the core, using its events and operators' orders. Pure.

The oracle shares no code with the core. If it is unclear whether a mode was ordered (for example,
if an order to hold was in progress when a fence held the vehicle), it requires nothing.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from mission_service.commands import (
    Announce,
    AnyCommand,
    ChangeSpeed,
    ClearAlarm,
    ClimbAndHold,
    GoAround,
    Hold,
    HoldAt,
    Land,
    Orbit,
    RaiseAlarm,
    Return,
    ShowLanding,
    StartMission,
    UploadMission,
)
from mission_service.core.operator_orders import CLIMB_FIRST_M
from mission_service.events import (
    Aborted,
    AnyEvent,
    Approved,
    CommandFinished,
    EstimatorStatusChanged,
    FenceStatusChanged,
    LinkLost,
    LinkRestored,
    ModeChanged,
    Order,
    OrderGiven,
    Resumed,
    SystemStateChanged,
    Telemetry,
    UploadFinished,
    VehicleConnected,
    VehicleRebooted,
)
from tests.service.autopilot_model import NAMES, Source

Licence = Literal["", "hold", "return", "land", "lead"]
Judged = Literal["ordered", "not ordered", "either"]

AIRBORNE_M = 15.0
GOING_HOME = ("return", "land")
# A reply may arrive before the mode change; a change later than this is not due to the command.
TAKES_EFFECT_S = 15.0
UNANSWERED_S = 60.0
QUESTION = "confirm:"


@dataclass
class Effect:
    """A command that may change the mode, from its sending until the end of its effect."""

    name: str
    mission_id: int
    modes: tuple[str, ...]
    until_s: float = float("inf")
    unanswered: bool = True


@dataclass
class VehicleRecord:
    """The reports of a vehicle, and the operators' orders to it."""

    stack: str
    autostart: bool
    online: bool = False
    armed: bool = False
    airborne: bool = False
    height_m: float = 0.0
    mode: str = ""
    judged: Judged = "ordered"
    # It has flown, or was disarmed or ordered home: no start without an order.
    needs_order: bool = False
    state: str = ""  # system status
    fence_breached: bool = False
    estimator_healthy: bool = True
    home: bool = False  # ordered home by an operator or by the service
    held: bool = False  # held by an operator
    low_energy: bool = False  # the core has raised the alarm
    landing: str = "none"  # phase of a landing as the core shows it
    licence: Licence = ""  # operators' orders since the last mode that was not ordered
    effects: list[Effect] = field(default_factory=list)
    # Modes of orders that were answered before a restart, until the vehicle reports a mode.
    carried: frozenset[str] = frozenset()

    @property
    def failsafe(self) -> bool:
        """Whether the autopilot reports a failsafe."""
        return self.fence_breached or self.state in ("critical", "emergency", "flight termination")

    @property
    def taken(self) -> bool:
        """Whether the autopilot or a pilot has selected the mode."""
        return self.armed and self.judged == "not ordered"


@dataclass(frozen=True)
class Violation:
    """A forbidden command of the core; ``kind`` names the rule."""

    kind: str
    words: str


class Oracle:
    """Processes events and commands, and finds violations of rules."""

    def __init__(self, vehicles: Mapping[str, tuple[str, bool]], burn: bool = False) -> None:
        """``vehicles``: stack and autostart of each, by name.

        In a burn operators cannot order a vehicle home: the service ends the hold of an abort when
        the battery is low.
        """
        self._burn = burn
        self.records = {name: VehicleRecord(*section) for name, section in vehicles.items()}
        self.met: list[str] = []  # situations since the last call, for statistics

    def judge(
        self, event: AnyEvent, commands: list[AnyCommand], chosen_by: Source
    ) -> list[Violation]:
        """Process an event and the core's commands;

        ``chosen_by`` is the source of a reported mode.
        """
        self.met.clear()
        found: list[Violation] = []
        at_s = event.at_us / 1e6
        match event:
            case OrderGiven():
                for name in [event.vehicle] if event.vehicle else list(self.records):
                    found += self._ordered(name, event, commands)
            case Aborted():
                for name in self.records:
                    found += self._aborted(name, commands)
            case Approved():  # a burn's plan may be flown; it ends earlier orders
                for record in self.records.values():
                    record.held = False  # the last mission of a vehicle whose control was returned
                    if not record.taken:
                        record.held = record.home = record.needs_order = False
                        record.licence = "lead"
            case Resumed():
                for record in self.records.values():
                    record.online = False
                    self._sign_off_ends(record, healthy=False)
                    record.carried |= {
                        each.name
                        for each in record.effects
                        if each.name in ("hold", "return") and not each.unanswered
                    }
                    for effect in record.effects:
                        effect.until_s = at_s + UNANSWERED_S
            case _ if (name := getattr(event, "vehicle", "")) in self.records:
                self._happened(self.records[name], event, at_s, chosen_by)
            case _:
                pass
        for command in commands:
            found += self._commanded(command, at_s)
        return found

    # Reports ----------------------------------------------------------------------------------

    def _happened(
        self, record: VehicleRecord, event: AnyEvent, at_s: float, chosen_by: Source
    ) -> None:
        match event:
            case VehicleConnected() | LinkRestored():
                record.online = True
            case LinkLost():
                record.online = False
            case Telemetry(altitude_relative_m=height_m):
                record.airborne |= height_m >= AIRBORNE_M
                record.height_m = height_m
            case CommandFinished(command=name):
                self._answered(record, name, 0, at_s)
            case UploadFinished(mission_id=mission_id):
                self._answered(record, "upload", mission_id, at_s)
            case SystemStateChanged(state=state):
                record.state = state
            case FenceStatusChanged(breached=breached):
                record.fence_breached = breached
            case EstimatorStatusChanged(healthy=healthy):
                record.estimator_healthy = healthy
                self._sign_off_ends(record, healthy)
            case VehicleRebooted():
                record.estimator_healthy = True
                self._sign_off_ends(record, healthy=False)
                self.met.append("reboot in the air" if record.airborne else "reboot on the ground")
                record.needs_order |= record.armed or record.airborne
                if record.airborne:  # perhaps by a watchdog: undecided until its mode is reported
                    record.judged = "either"
                record.airborne = False  # until a position is reported again
            case ModeChanged():
                self._mode_changed(record, event, at_s, chosen_by)
            case _:
                pass

    def _sign_off_ends(self, record: VehicleRecord, healthy: bool) -> None:
        """End an order to start that was given on the ground, unless it has taken effect."""
        on_ground = not (record.airborne or record.armed)
        if on_ground and not healthy and record.licence == "lead" and not self._burn:
            record.needs_order, record.licence = True, ""

    def _answered(self, record: VehicleRecord, name: str, mission_id: int, at_s: float) -> None:
        for effect in record.effects:
            same = (effect.name, effect.mission_id) == (name, mission_id)
            if same and effect.unanswered:
                effect.unanswered = False
                effect.until_s = min(effect.until_s, at_s + TAKES_EFFECT_S)
                return

    def _mode_changed(
        self, record: VehicleRecord, event: ModeChanged, at_s: float, chosen_by: Source
    ) -> None:
        same = record.armed and event.armed and record.mode == event.mode
        carried, record.carried = record.carried, frozenset()
        was_armed, record.armed, record.mode = record.armed, event.armed, event.mode
        if not event.armed:
            if was_armed or record.airborne:
                self.met.append("landed" if record.airborne else "disarmed")
                record.needs_order, record.licence = True, ""
            record.airborne, record.judged = False, "ordered"
            return
        if same:
            if event.mode == "mission":
                record.judged = "ordered"
            return
        record.effects = [each for each in record.effects if each.until_s > at_s]
        may_be = event.mode in carried or any(event.mode in each.modes for each in record.effects)
        # In this mode it flies the mission on board, so control is returned.
        if event.mode == "mission":
            record.judged = "ordered"
            if chosen_by == "pilot":
                record.home = False
        elif chosen_by in ("service", "transfer"):
            record.judged = "ordered" if may_be and chosen_by == "service" else "either"
        else:
            record.judged = "either" if may_be else "not ordered"
        if record.judged == "not ordered":
            record.licence = ""
            self.met.append(f"{event.mode} by {chosen_by}")

    # Operators' orders ------------------------------------------------------------------------

    def _ordered(self, name: str, event: OrderGiven, commands: list[AnyCommand]) -> list[Violation]:
        record, order = self.records[name], event.order
        words = f"order {order} to {name} in {record.mode!r} ({record.judged})"
        asked = any(_asks(command, name) for command in commands)
        found: list[Violation] = []
        confirmed = event.confirmed
        refused = order == "start" and record.held
        if _rejected(commands, name):
            committed = record.landing in ("final", "going around")
            starts = order in ("start", "resume", "takeoff")
            if starts or order in ("land", "go-around") or (committed and order != "hold"):
                return found
        if self._must_ask(record, order) and not (confirmed or asked or refused):
            found.append(Violation("no question", words))
        if asked and (confirmed or not self._may_ask(record, order)):
            found.append(Violation("needless question", words))
        if asked:
            self.met.append("question")
            return found
        self.met.append(f"{order} ordered" + (" of one that was taken" if record.taken else ""))
        return found + self._carried_out(name, record, order, commands, words)

    def _must_ask(self, record: VehicleRecord, order: Order) -> bool:
        if not (record.taken and record.airborne and record.online) or record.licence:
            return False  # one confirmed order since then is sufficient
        return record.mode == "land" if order == "return" else True

    def _may_ask(self, record: VehicleRecord, order: Order) -> bool:
        # A failsafe that does not change the mode.
        failsafe = record.failsafe and record.mode in GOING_HOME
        low_energy = record.low_energy and order in ("start", "resume")
        return record.armed and (record.judged != "ordered" or failsafe or low_energy)

    def _carried_out(
        self, name: str, record: VehicleRecord, order: Order, commands: list[AnyCommand], words: str
    ) -> list[Violation]:
        flies = record.online and record.airborne and record.armed
        due: type[AnyCommand] | None = None
        match order:
            case "hold":
                record.held, record.home, record.licence = True, False, "hold"
                due = GoAround if _has(commands, GoAround, name) else Hold
            case "return":
                record.held, record.home, record.licence = False, True, "return"
                record.needs_order = True
                due = Return
            case "go-around":
                # It holds now or after its go-around, unless it is not landing.
                if _has(commands, Hold, name) or _has(commands, GoAround, name):
                    record.held, record.home, record.licence = True, False, "hold"
            case "land":
                if _lands(commands, name):
                    record.held, record.home, record.licence = False, False, "land"
                    record.needs_order = True
            case "start" if record.held:
                return []
            case "start" | "resume" | "takeoff":
                record.held = record.home = record.needs_order = False
                record.licence = "lead"
        if due is Hold and (_has(commands, HoldAt, name) or record.height_m < CLIMB_FIRST_M):
            return []  # a plane in its takeoff climbs first
        if flies and due is not None and not _has(commands, due, name):
            return [Violation("order not carried out", words)]
        return []

    def _aborted(self, name: str, commands: list[AnyCommand]) -> list[Violation]:
        record = self.records[name]
        left_alone = record.taken and record.mode in GOING_HOME
        self.met.append("abort" + (" of one that was taken" if record.taken else ""))
        record.held, record.licence = True, "" if left_alone else "hold"
        record.home &= left_alone
        flies = record.online and record.airborne and record.armed and record.mode not in GOING_HOME
        if self._burn:  # it already holds at the safe height, and without a position it cannot hold
            return []
        stops = any(_has(commands, kind, name) for kind in (Hold, HoldAt, GoAround))
        stops |= record.height_m < CLIMB_FIRST_M  # a plane in its takeoff climbs first
        if flies and record.judged == "ordered" and not stops:
            return [Violation("order not carried out", f"abort of {name} in {record.mode!r}")]
        return []

    # Commands of the core -------------------------------------------------------------------

    def _commanded(self, command: AnyCommand, at_s: float) -> list[Violation]:
        record = self.records.get(command.vehicle)
        if record is None:
            return []
        kind = self._breaks(record, command)
        words = (
            f"{type(command).__name__} to {command.vehicle}: "
            f"mode {record.mode!r} ({record.judged}), armed {record.armed}, "
            f"airborne {record.airborne}, held {record.held}, home {record.home}, "
            f"needs an order {record.needs_order}, licence {record.licence!r}"
        )
        self._note(record, command)
        if isinstance(command, ShowLanding):
            record.landing = command.phase
            record.held |= command.holds
        if isinstance(command, RaiseAlarm | ClearAlarm) and command.alarm == "energy":
            record.low_energy = isinstance(command, RaiseAlarm)
        return [Violation(kind, words)] if kind else []

    def _breaks(self, record: VehicleRecord, command: AnyCommand) -> str:
        """Return the rule that a command breaks; empty if it breaks none."""
        name = type(command).__name__
        led = record.licence == "lead"
        match command:
            case Land() | UploadMission(lands=True) | GoAround():
                if isinstance(command, Land) and not record.airborne:
                    return "Land on the ground"
                taken = record.taken and record.licence not in ("land", "hold")
                return f"{name} to one that was taken" if taken else ""
            case StartMission() if not record.armed and not record.estimator_healthy:
                return "" if record.airborne or self._burn else "started with a failing check"
            case StartMission() if not record.armed and not led:
                if record.held:
                    return "started while held"
                if record.home:
                    return "started after an order home"
                if record.needs_order:
                    return "started after a landing"
                return "" if record.autostart else "started without an order"
            case StartMission() | UploadMission() | Orbit() | ChangeSpeed():
                harmless = isinstance(command, UploadMission) and not record.airborne
                if not record.armed or led or harmless:
                    return ""
                if record.taken:
                    return f"{name} to one that was taken"
                if record.held:
                    return f"{name} undoes a hold"
                return f"{name} undoes an order home" if record.home else ""
            case Hold() | ClimbAndHold() if record.armed:
                if record.taken:
                    allowed = record.licence in ("hold", "lead")
                    return "" if allowed else f"{name} to one that was taken"
                return f"{name} undoes an order home" if record.home and not record.held else ""
            case Return() if record.armed and record.mode != "return":
                if record.taken:
                    allowed = record.licence in ("return", "lead")
                    return "" if allowed else f"{name} to one that was taken"
                return "Return undoes a hold" if record.held and not self._burn else ""
            case _:
                return ""

    def _note(self, record: VehicleRecord, command: AnyCommand) -> None:
        """Record the modes to which a command may lead, and its effect on later commands."""
        hold_like = ("guided", "hold", "orbit")
        match command:
            case Land():
                modes: tuple[str, ...] = ("mission",)
            case GoAround():
                modes = (*hold_like, "mission")
            case StartMission():
                modes = ("mission", "guided", "takeoff")
            case Hold():
                modes = ("hold", "guided")
            case Return():
                modes = ("return",)
                record.home, record.needs_order = True, True
                record.licence = "return" if record.licence == "lead" else record.licence
            case Orbit() | ClimbAndHold():
                modes = hold_like
            case UploadMission():
                record.effects.append(Effect("upload", command.mission_id, ("hold", "mission")))
                return
            case _:
                return
        record.effects.append(Effect(NAMES[type(command)], 0, modes))


def _asks(command: AnyCommand, name: str) -> bool:
    if not isinstance(command, Announce) or command.vehicle != name:
        return False
    return command.text.startswith(QUESTION)


def _rejected(commands: Iterable[AnyCommand], name: str) -> bool:
    lines = (each for each in commands if isinstance(each, Announce) and each.vehicle == name)
    return any(line.text.startswith("rejected:") for line in lines)


def _lands(commands: Iterable[AnyCommand], name: str) -> bool:
    return any(isinstance(each, ShowLanding) and each.vehicle == name for each in commands)


def _has(commands: Iterable[AnyCommand], kind: type[AnyCommand], name: str) -> bool:
    return any(isinstance(each, kind) and each.vehicle == name for each in commands)
