"""What the core may command, judged by what it was told and by what people ordered. Pure.

It shares no code with the core. Where it is open whether a mode was ordered (an order to hold was
under way when a fence held the vehicle) it demands nothing.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from mission_service.commands import (
    Announce,
    AnyCommand,
    ChangeSpeed,
    ClimbAndHold,
    Hold,
    Orbit,
    Return,
    StartMission,
    UploadMission,
)
from mission_service.events import (
    Aborted,
    AnyEvent,
    Approved,
    CommandFinished,
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

Licence = Literal["", "hold", "return", "lead"]
Judged = Literal["ordered", "not ordered", "either"]

AIRBORNE_M = 15.0
GOING_HOME = ("return", "land")
# An answer may come before the mode that it announces; afterwards a change is not the command's.
TAKES_EFFECT_S = 15.0
UNANSWERED_S = 60.0
QUESTION = "confirm:"


@dataclass
class Effect:
    """A command that may change the mode, from when it was issued until it can do so no more."""

    name: str
    mission_id: int
    modes: tuple[str, ...]
    until_s: float = float("inf")
    unanswered: bool = True


@dataclass
class Told:
    """What was told of a vehicle, and what people have ordered of it since."""

    stack: str
    autostart: bool
    online: bool = False
    armed: bool = False
    airborne: bool = False
    mode: str = ""
    judged: Judged = "ordered"
    needs_order: bool = False  # has flown, or was disarmed or ordered home: no start by itself
    state: str = ""  # of its system
    fence_breached: bool = False
    home: bool = False  # ordered home, by a person or by the service
    held: bool = False  # by a person
    licence: Licence = ""  # what people have ordered since the last mode that was not ordered
    effects: list[Effect] = field(default_factory=list)

    @property
    def failsafe(self) -> bool:
        """Whether its autopilot reports one."""
        return self.fence_breached or self.state in ("critical", "emergency", "flight termination")

    @property
    def taken(self) -> bool:
        """Whether an autopilot or a pilot has chosen what it flies."""
        return self.armed and self.judged == "not ordered"


@dataclass(frozen=True)
class Violation:
    """Something the core must not have done; ``kind`` names the rule."""

    kind: str
    words: str


class Oracle:
    """Folds events and commands, and finds what breaks a rule."""

    def __init__(self, vehicles: Mapping[str, tuple[str, bool]], burn: bool = False) -> None:
        """``vehicles``: stack and autostart of each, by name.

        A burn's crew cannot order anybody home: it is the service that ends the hold of an abort
        when the battery is low.
        """
        self._burn = burn
        self.told = {name: Told(*section) for name, section in vehicles.items()}
        self.met: list[str] = []  # situations since the last call, for the statistics

    def judge(
        self, event: AnyEvent, commands: list[AnyCommand], chosen_by: Source
    ) -> list[Violation]:
        """Take in an event and what the core answered; ``chosen_by`` is of the mode told of."""
        self.met.clear()
        found: list[Violation] = []
        at_s = event.at_us / 1e6
        match event:
            case OrderGiven():
                for name in [event.vehicle] if event.vehicle else list(self.told):
                    found += self._ordered(name, event, commands)
            case Aborted():
                for name in self.told:
                    found += self._aborted(name, commands)
            case Approved():  # a burn's plan may be flown; it ends what was ordered before
                for told in self.told.values():
                    told.held = False  # of one that was taken once it is handed back
                    if not told.taken:
                        told.held = told.home = told.needs_order = False
                        told.licence = "lead"
            case Resumed():
                for told in self.told.values():
                    told.online = False
                    for effect in told.effects:
                        effect.until_s = at_s + UNANSWERED_S
            case _ if (name := getattr(event, "vehicle", "")) in self.told:
                self._happened(self.told[name], event, at_s, chosen_by)
            case _:
                pass
        for command in commands:
            found += self._commanded(command, at_s)
        return found

    # What was told ----------------------------------------------------------------------------

    def _happened(self, told: Told, event: AnyEvent, at_s: float, chosen_by: Source) -> None:
        match event:
            case VehicleConnected() | LinkRestored():
                told.online = True
            case LinkLost():
                told.online = False
            case Telemetry(altitude_relative_m=height_m) if height_m >= AIRBORNE_M:
                told.airborne = True
            case CommandFinished(command=name):
                self._answered(told, name, 0, at_s)
            case UploadFinished(mission_id=mission_id):
                self._answered(told, "upload", mission_id, at_s)
            case SystemStateChanged(state=state):
                told.state = state
            case FenceStatusChanged(breached=breached):
                told.fence_breached = breached
            case VehicleRebooted():
                self.met.append("reboot in the air" if told.airborne else "reboot on the ground")
                told.needs_order |= told.armed or told.airborne
                if told.airborne:  # a watchdog's, perhaps: open until its mode is reported
                    told.judged = "either"
                told.airborne = False  # until a position is known again
            case ModeChanged():
                self._mode_changed(told, event, at_s, chosen_by)
            case _:
                pass

    def _answered(self, told: Told, name: str, mission_id: int, at_s: float) -> None:
        for effect in told.effects:
            same = (effect.name, effect.mission_id) == (name, mission_id)
            if same and effect.unanswered:
                effect.unanswered = False
                effect.until_s = min(effect.until_s, at_s + TAKES_EFFECT_S)
                return

    def _mode_changed(self, told: Told, event: ModeChanged, at_s: float, chosen_by: Source) -> None:
        same = told.armed and event.armed and told.mode == event.mode
        arms = event.armed and not told.armed
        was_armed, told.armed, told.mode = told.armed, event.armed, event.mode
        if not event.armed:
            if was_armed or told.airborne:
                self.met.append("landed" if told.airborne else "disarmed")
                told.needs_order, told.licence = True, ""
            told.airborne, told.judged = False, "ordered"
            return
        if same:
            if event.mode == "mission":
                told.judged = "ordered"
            return
        told.effects = [each for each in told.effects if each.until_s > at_s]
        may_be = [
            each
            for each in told.effects
            if event.mode in each.modes or (arms and each.name == "start mission")
        ]
        if event.mode == "mission":  # flown by what is on board: whoever did so hands it over
            told.judged = "ordered"
            if chosen_by == "pilot":
                told.home = False
        elif chosen_by in ("service", "transfer"):
            told.judged = "ordered" if may_be and chosen_by == "service" else "either"
        else:
            told.judged = "either" if may_be else "not ordered"
        if told.judged == "not ordered":
            told.licence = ""
            self.met.append(f"{event.mode} by {chosen_by}")

    # What people order ------------------------------------------------------------------------

    def _ordered(self, name: str, event: OrderGiven, commands: list[AnyCommand]) -> list[Violation]:
        told, order = self.told[name], event.order
        words = f"order {order} to {name} in {told.mode!r} ({told.judged})"
        asked = any(_asks(command, name) for command in commands)
        found: list[Violation] = []
        confirmed = event.confirmed
        refused = order == "start" and told.held
        if self._must_ask(told, order) and not (confirmed or asked or refused):
            found.append(Violation("no question", words))
        if asked and (confirmed or not self._may_ask(told, order)):
            found.append(Violation("needless question", words))
        if asked:
            self.met.append("question")
            return found
        self.met.append(f"{order} ordered" + (" of one that was taken" if told.taken else ""))
        return found + self._carried_out(name, told, order, commands, words)

    def _must_ask(self, told: Told, order: Order) -> bool:
        if not (told.taken and told.airborne and told.online) or told.licence:
            return False  # an order that was confirmed since is enough
        return told.mode == "land" if order == "return" else True

    def _may_ask(self, told: Told, order: Order) -> bool:
        failsafe = told.failsafe and told.mode in GOING_HOME  # which does not change the mode
        return told.armed and (told.judged != "ordered" or failsafe)

    def _carried_out(
        self, name: str, told: Told, order: Order, commands: list[AnyCommand], words: str
    ) -> list[Violation]:
        flies = told.online and told.airborne and told.armed
        due: type[AnyCommand] | None = None
        match order:
            case "hold":
                told.held, told.home, told.licence = True, False, "hold"
                due = Hold
            case "return":
                told.held, told.home, told.licence = False, True, "return"
                told.needs_order = True
                due = Return
            case "start" if told.held:
                return []
            case "start" | "resume":
                told.held = told.home = told.needs_order = False
                told.licence = "lead"
        if flies and due is not None and not _has(commands, due, name):
            return [Violation("order not carried out", words)]
        return []

    def _aborted(self, name: str, commands: list[AnyCommand]) -> list[Violation]:
        told = self.told[name]
        left_alone = told.taken and told.mode in GOING_HOME
        self.met.append("abort" + (" of one that was taken" if told.taken else ""))
        told.held, told.licence = True, "" if left_alone else "hold"
        told.home &= left_alone
        flies = told.online and told.airborne and told.armed and told.mode not in GOING_HOME
        if self._burn:  # at the safe height it holds already, and without a position it cannot
            return []
        if flies and told.judged == "ordered" and not _has(commands, Hold, name):
            return [Violation("order not carried out", f"abort of {name} in {told.mode!r}")]
        return []

    # What the core commands -------------------------------------------------------------------

    def _commanded(self, command: AnyCommand, at_s: float) -> list[Violation]:
        told = self.told.get(command.vehicle)
        if told is None:
            return []
        kind = self._breaks(told, command)
        words = (
            f"{type(command).__name__} to {command.vehicle}: mode {told.mode!r} ({told.judged}), "
            f"armed {told.armed}, airborne {told.airborne}, held {told.held}, home {told.home}, "
            f"needs an order {told.needs_order}, licence {told.licence!r}"
        )
        self._note(told, command)
        return [Violation(kind, words)] if kind else []

    def _breaks(self, told: Told, command: AnyCommand) -> str:
        """The rule that a command breaks, or nothing."""
        name = type(command).__name__
        led = told.licence == "lead"
        match command:
            case StartMission() if not told.armed and not led:
                if told.held:
                    return "started while held"
                if told.home:
                    return "started after an order home"
                if told.needs_order:
                    return "started after a landing"
                return "" if told.autostart else "started without an order"
            case StartMission() | UploadMission() | Orbit() | ChangeSpeed():
                harmless = isinstance(command, UploadMission) and not told.airborne
                if not told.armed or led or harmless:
                    return ""
                if told.taken:
                    return f"{name} to one that was taken"
                if told.held:
                    return f"{name} undoes a hold"
                return f"{name} undoes an order home" if told.home else ""
            case Hold() | ClimbAndHold() if told.armed:
                if told.taken:
                    allowed = told.licence in ("hold", "lead")
                    return "" if allowed else f"{name} to one that was taken"
                return f"{name} undoes an order home" if told.home and not told.held else ""
            case Return() if told.armed and told.mode != "return":
                if told.taken:
                    allowed = told.licence in ("return", "lead")
                    return "" if allowed else f"{name} to one that was taken"
                return "Return undoes a hold" if told.held and not self._burn else ""
            case _:
                return ""

    def _note(self, told: Told, command: AnyCommand) -> None:
        """The modes that it may lead to, and what follows for later commands."""
        hold_like = ("guided", "hold", "orbit")
        match command:
            case StartMission():
                modes: tuple[str, ...] = ("mission", "guided", "takeoff")
            case Hold():
                modes = ("hold", "guided")
            case Return():
                modes = ("return",)
                told.home, told.needs_order = True, True
                told.licence = "return" if told.licence == "lead" else told.licence
            case Orbit() | ClimbAndHold():
                modes = hold_like
            case UploadMission():
                told.effects.append(Effect("upload", command.mission_id, ("hold", "mission")))
                return
            case _:
                return
        told.effects.append(Effect(NAMES[type(command)], 0, modes))


def _asks(command: AnyCommand, name: str) -> bool:
    if not isinstance(command, Announce) or command.vehicle != name:
        return False
    return command.text.startswith(QUESTION)


def _has(commands: Iterable[AnyCommand], kind: type[AnyCommand], name: str) -> bool:
    return any(isinstance(each, kind) and each.vehicle == name for each in commands)
