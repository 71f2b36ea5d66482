"""Predicts from an autopilot's parameters how it reacts to the loss of the ground station. Pure.

Sources: ``failsafe.cpp``, ``framework.cpp`` and ``Commander.cpp`` of PX4 1.17, ``events.cpp`` and
``system.cpp`` of ArduPlane 4.6.2, ``events.cpp`` of ArduCopter 4.6.2. ArduPlane's FS_SHORT_ACTN is
absent: 4.6.2 executes it only after a loss of the remote control.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.stacks.return_flight import return_height_m
from autopilot_bridge.stacks.stacks import Stack

Phase = Literal["mission", "guided", "hold"]
Action = Literal[
    "continue",
    "hold",
    "return",
    "return or land",
    "land",
    "mission",
    "glide",
    "parachute",
    "terminate",
    "disarm",
]
Wanted = Literal["continue", "hold", "return", "land"]
Values = Mapping[str, float]

PHASES: tuple[Phase, ...] = ("mission", "guided", "hold")
WANTED: tuple[Wanted, ...] = ("continue", "hold", "return", "land")
STATION_ID = 255  # default system id of the native client's heartbeats
DANGEROUS = ("glide", "parachute", "terminate", "disarm")
VERBS: dict[Action, str] = {
    "continue": "continues",
    "hold": "holds",
    "return": "returns",
    "return or land": "returns by SmartRTL, or lands where it is",
    "land": "lands where it is",
    "mission": "flies its mission",
    "glide": "glides without throttle (FBWA)",
    "parachute": "releases its parachute",
    "terminate": "terminates the flight",
    "disarm": "disarms in the air",
}


class TimedAction(NamedTuple):
    """An action of the autopilot, ``after_s`` seconds after the last heartbeat of the station."""

    after_s: float
    action: Action


Reaction = tuple[TimedAction, ...]  # empty if the vehicle continues


@dataclass(frozen=True, slots=True)
class LinkLoss:
    """The reaction of a vehicle to the loss of its ground station, in each phase of a flight.

    ``return_height_m`` is the height above home; it is None if the autopilot returns at its current
    height or the parameter was not read. ``fence`` describes the reaction to a breached fence.
    ``warnings`` name undefined and dangerous values.
    """

    reactions: Mapping[Phase, Reaction]
    return_height_m: float | None
    fence: str
    warnings: tuple[str, ...]

    def ends_in(self, phase: Phase) -> Action:
        """Return the last action in a phase."""
        reaction = self.reactions[phase]
        return reaction[-1].action if reaction else "continue"

    def satisfies(self, wanted: Wanted) -> bool:
        """Return whether the reaction is ``wanted`` in all phases; continuing a hold is a hold."""
        allowed = {phase: {wanted} for phase in PHASES}
        if wanted in ("continue", "hold"):
            allowed["hold"] = {"continue", "hold"}
        return all(self.ends_in(phase) in allowed[phase] for phase in PHASES)

    def __str__(self) -> str:
        """Return the reaction in words, such as ``holds after 10 s, returns after 15 s``."""
        phases_of: dict[str, list[Phase]] = {}
        for phase in PHASES:
            phases_of.setdefault(phase_in_words(self.reactions[phase]), []).append(phase)
        if len(phases_of) == 1:
            return next(iter(phases_of))
        return "; ".join(f"in {' and '.join(of)}: {words}" for words, of in phases_of.items())


class Change(NamedTuple):
    """A parameter to set."""

    name: str
    before: float
    after: float

    def __str__(self) -> str:
        """Return the change in words, such as ``NAV_DLL_ACT 0 -> 2``."""
        return f"{self.name} {self.before:g} -> {self.after:g}"


class _Table(NamedTuple):
    """The parameters of one stack and vehicle."""

    needed: tuple[str, ...]  # parameters that determine the reaction
    shown: tuple[str, ...]  # parameters of the return and of the fence
    settings: Mapping[Wanted, Mapping[str, float]]  # values that produce a wanted reaction
    exceptions: tuple[str, tuple[int, ...]] | None  # a bitmask; bits that suppress the reaction


_PX4 = _Table(
    ("NAV_DLL_ACT", "COM_DL_LOSS_T", "COM_DLL_EXCEPT", "COM_FAIL_ACT_T"),
    ("RTL_RETURN_ALT", "RTL_TYPE", "GF_ACTION"),
    {
        "continue": {"NAV_DLL_ACT": 0},
        "hold": {"NAV_DLL_ACT": 1},
        "return": {"NAV_DLL_ACT": 2},
        "land": {"NAV_DLL_ACT": 3},
    },
    ("COM_DLL_EXCEPT", (1, 2)),
)
_ARDUPLANE = _Table(
    ("FS_GCS_ENABL", "FS_LONG_ACTN", "FS_LONG_TIMEOUT", "SYSID_MYGCS"),
    ("RTL_ALTITUDE", "RTL_AUTOLAND", "FENCE_ENABLE", "FENCE_ACTION"),
    {
        "continue": {"FS_GCS_ENABL": 0},
        "return": {"FS_GCS_ENABL": 1, "FS_LONG_ACTN": 1},
    },
    None,
)
_ARDUCOPTER = _Table(
    ("FS_GCS_ENABLE", "FS_GCS_TIMEOUT", "FS_OPTIONS", "SYSID_MYGCS"),
    ("RTL_ALT", "FENCE_ENABLE", "FENCE_ACTION"),
    {
        "continue": {"FS_GCS_ENABLE": 0},
        "hold": {"FS_GCS_ENABLE": 7},
        "return": {"FS_GCS_ENABLE": 1},
        "land": {"FS_GCS_ENABLE": 5},
    },
    ("FS_OPTIONS", (2, 16)),
)

_PX4_ACTIONS: dict[int, Action] = {
    0: "continue",
    1: "hold",
    2: "return",
    3: "land",
    5: "terminate",
    6: "disarm",
}
_COPTER_ACTIONS: dict[int, Action] = {
    0: "continue",
    1: "return",
    2: "return",
    3: "return",
    4: "return or land",
    5: "land",
    6: "return",
    7: "hold",
}
_LONG_ACTIONS: dict[int, Action] = {
    0: "continue",
    1: "return",
    2: "glide",
    3: "parachute",
    4: "mission",
}
_PX4_FENCE = dict(
    enumerate(("no reaction", "warning", "hold", "return", "flight termination", "land"))
)
_PLANE_FENCE = {0: "report", 1: "return", 6: "guided", 7: "guided, with the pilot's throttle"}
_COPTER_FENCE = dict(
    enumerate(("report", "return or land", "land", "SmartRTL", "brake or land", "SmartRTL"))
)


def parameters_of(stack: Stack) -> tuple[str, ...]:
    """Return the names of the parameters that ``link_loss_of`` uses."""
    table = _table_of(stack)
    return table.needed + table.shown


def missing(stack: Stack, values: Values) -> tuple[str, ...]:
    """Return the absent parameters that are needed to determine the reaction."""
    return tuple(name for name in _table_of(stack).needed if name not in values)


def link_loss_of(stack: Stack, values: Values, station_id: int = STATION_ID) -> LinkLoss:
    """Return the reaction that results from the parameters.

    Args:
        stack: The autopilot and the kind of vehicle.
        values: The values of ``parameters_of(stack)`` by name; those of the return and of the fence
            may be absent.
        station_id: The system id of the station's heartbeats.

    Returns:
        The reaction in each phase; times are seconds from the last heartbeat.

    Raises:
        BridgeError: A parameter that determines the reaction is absent.
    """
    absent = missing(stack, values)
    if absent:
        raise BridgeError(
            "the reaction to a lost link cannot be determined without the values of "
            f"{', '.join(absent)}"
        )
    height_m = return_height_m(stack, values)
    if stack.name == "px4":
        return _px4(values, height_m)
    react = _arduplane if stack.vehicle == "plane" else _arducopter
    return react(values, station_id, height_m)


def changes_for(
    stack: Stack, wanted: Wanted, values: Values, station_id: int = STATION_ID
) -> tuple[Change, ...]:
    """Return the parameters to set for a vehicle to react as ``wanted``; empty if it already does.

    Timeouts are not changed.

    Raises:
        BridgeError: The stack has no such reaction, or a parameter is absent.
    """
    table = _table_of(stack)
    if wanted not in table.settings:
        known = ", ".join(table.settings)
        raise BridgeError(
            f"{stack.name} {stack.kind} cannot {wanted} after a lost link; supported: {known}"
        )
    if link_loss_of(stack, values, station_id).satisfies(wanted):
        return ()
    after = dict(table.settings[wanted])
    if "SYSID_MYGCS" in values and wanted != "continue":
        after["SYSID_MYGCS"] = station_id
    if table.exceptions is not None:
        name, bits = table.exceptions
        after[name] = int(values[name])
        for bit in bits:
            if not link_loss_of(stack, {**values, **after}, station_id).satisfies(wanted):
                after[name] = int(after[name]) & ~bit
    return tuple(
        Change(name, values[name], value)
        for name, value in sorted(after.items())
        if values[name] != value
    )


def phase_in_words(reaction: Reaction) -> str:
    """Return a reaction in words, such as ``holds after 10 s, returns after 15 s``."""
    if not reaction:
        return VERBS["continue"]
    return ", ".join(f"{VERBS[action]} after {after_s:g} s" for after_s, action in reaction)


def _table_of(stack: Stack) -> _Table:
    if stack.name == "px4":
        return _PX4
    return _ARDUPLANE if stack.vehicle == "plane" else _ARDUCOPTER


def _warnings(values: Values, name: str, known: Mapping[int, Action], instead: str) -> list[str]:
    """Return the warnings about an undefined or dangerous value of an action's parameter."""
    number = int(values[name])
    if number not in known:
        return [f"{name} = {number} is not defined: {instead}"]
    action = known[number]
    return [f"{name} = {number}: it {VERBS[action]}"] if action in DANGEROUS else []


def _px4(values: Values, height_m: float | None) -> LinkLoss:
    action = _PX4_ACTIONS.get(int(values["NAV_DLL_ACT"]), "continue")
    lost_s, delay_s = values["COM_DL_LOSS_T"], values["COM_FAIL_ACT_T"]
    reaction: Reaction = () if action == "continue" else (TimedAction(lost_s, action),)
    if action in ("return", "land") and delay_s > 0.1:
        reaction = (TimedAction(lost_s, "hold"), TimedAction(lost_s + delay_s, action))
    excepted = int(values["COM_DLL_EXCEPT"])
    in_hold: Reaction = () if excepted & 2 else reaction
    # PX4 executes a DO_REPOSITION in its hold mode.
    reactions: dict[Phase, Reaction] = {
        "mission": () if excepted & 1 else reaction,
        "guided": in_hold,
        "hold": in_hold,
    }
    fence = "unknown"
    if "GF_ACTION" in values:
        number = int(values["GF_ACTION"])
        fence = _PX4_FENCE.get(number, f"undefined ({number})")
    warnings = _warnings(values, "NAV_DLL_ACT", _PX4_ACTIONS, "PX4 does not react")
    return LinkLoss(reactions, height_m, fence, tuple(warnings))


def _arduplane(values: Values, station_id: int, height_m: float | None) -> LinkLoss:
    enabled, number = int(values["FS_GCS_ENABL"]), int(values["FS_LONG_ACTN"])
    after_s = values["FS_LONG_TIMEOUT"]
    long = _LONG_ACTIONS.get(number, "continue")
    flown: Reaction = () if long == "continue" else (TimedAction(after_s, long),)
    # Without an action, ArduPlane stays in AUTO or GUIDED, but returns from LOITER.
    held = flown or (TimedAction(after_s, "return"),)
    reactions: dict[Phase, Reaction] = {
        "mission": () if long == "mission" else flown,
        "guided": flown,
        "hold": held,
    }
    if enabled == 3:  # only in AUTO
        reactions = {"mission": reactions["mission"], "guided": (), "hold": ()}
    elif enabled not in (1, 2):
        reactions = dict.fromkeys(PHASES, ())
    warnings = []
    if enabled not in range(4):
        warnings.append(f"FS_GCS_ENABL = {enabled} is not defined: ArduPlane does not react")
    elif enabled:
        instead = "ArduPlane continues in AUTO and GUIDED, and returns from LOITER"
        warnings += _warnings(values, "FS_LONG_ACTN", _LONG_ACTIONS, instead)
    return _ardupilot(values, station_id, reactions, warnings, height_m, _PLANE_FENCE)


def _arducopter(values: Values, station_id: int, height_m: float | None) -> LinkLoss:
    number, options = int(values["FS_GCS_ENABLE"]), int(values["FS_OPTIONS"])
    action = _COPTER_ACTIONS.get(number, "return")
    reaction: Reaction = ()
    if action != "continue":
        reaction = (TimedAction(values["FS_GCS_TIMEOUT"], action),)
    reactions: dict[Phase, Reaction] = {
        "mission": () if options & 2 else reaction,
        "guided": reaction,
        # The hold mode is BRAKE, which counts as a pilot mode.
        "hold": () if options & 16 else reaction,
    }
    warnings = _warnings(values, "FS_GCS_ENABLE", _COPTER_ACTIONS, "ArduCopter returns")
    return _ardupilot(values, station_id, reactions, warnings, height_m, _COPTER_FENCE)


def _ardupilot(
    values: Values,
    station_id: int,
    reactions: Mapping[Phase, Reaction],
    warnings: list[str],
    height_m: float | None,
    fence_actions: Mapping[int, str],
) -> LinkLoss:
    """Return the reaction of ArduPilot, which monitors the heartbeats of one system id."""
    monitored = int(values["SYSID_MYGCS"])
    if monitored != station_id and any(reactions.values()):
        reactions = dict.fromkeys(PHASES, ())
        warnings.append(
            f"SYSID_MYGCS = {monitored}: the autopilot does not monitor the heartbeats of this "
            f"station, whose system id is {station_id}"
        )
    fence = "unknown"
    if values.get("FENCE_ENABLE") == 0.0:
        fence = "no fence"
    elif "FENCE_ENABLE" in values and "FENCE_ACTION" in values:
        number = int(values["FENCE_ACTION"])
        fence = fence_actions.get(number, f"undefined ({number})")
    return LinkLoss(reactions, height_m, fence, tuple(warnings))
