"""Checks of missions before upload: items that the autopilot would refuse, change or misfly.

Pure functions over the data of ``stack_rules``. Items are the user's: without ArduPilot's home,
DO_JUMP targets by place from 0.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import Items, MissionItem, has_position
from autopilot_bridge.missions.check_places import bad_fence, bad_place, bad_rally
from autopilot_bridge.missions.problems import Kind, Problem, problem
from autopilot_bridge.missions.read_back import (
    FENCE,
    MISSION,
    RALLY,
    kept_param,
    takes_position,
    words_of,
)
from autopilot_bridge.stacks.rules import (
    ENDLESS,
    GOES_ON,
    INSTEAD,
    LAND_SEQUENCES,
    SAME_AS,
    TWIN,
    Rules,
    rules_of,
)
from autopilot_bridge.stacks.stacks import Stack

_JUMP = mavlink.MAV_CMD_DO_JUMP
_PARAMS = ("param1", "param2", "param3", "param4")
# Changes of these are not reported: see ``stacks/rules.py``.
_QUIET = ("keep", "hint", "hidden", "yaw", "side", "flag")
_MOST = {"u8": 255, "u16": 65535, "i8": 127, "i16": 32767, "cm16": 655.35, "radius": 65535}


def check(items: Sequence[MissionItem], stack: Stack, mission_type: int = MISSION) -> list[Problem]:
    """Find items of a mission, fence or rally list that a stack refuses, changes or never flies.

    Args:
        items: The items, without ArduPilot's home.
        stack: The autopilot and the kind of vehicle.
        mission_type: MAV_MISSION_TYPE: 0 mission, 1 fence, 2 rally points.

    Returns:
        The problems in the order of the items; ``str`` of one is a line for users.

    Source: see ``stacks/rules.py``.
    """
    rules = rules_of(stack)
    if mission_type == FENCE:
        return list(bad_fence(items, rules))
    if mission_type == RALLY:
        return list(bad_rally(items, rules))
    found = [
        each for index, item in enumerate(items) for each in _bad_item(index, item, stack, rules)
    ]
    found += _bad_jumps(items)
    found += _never_reached(items, rules)
    found += _too_long(items, stack)
    return found


def _bad_item(index: int, item: MissionItem, stack: Stack, rules: Rules) -> Iterator[Problem]:
    instead = INSTEAD.get((stack.name, item.command), f"{stack.name} has nothing like it")
    if item.command not in rules.position and item.command not in rules.bare:
        reason = f"{stack.name} does not take this command"
        yield problem("refused", index, item, "command", reason, instead)
        return
    if item.command in rules.never_valid:
        reason = "it is stored, and then the whole mission is rejected"
        yield problem("refused", index, item, "command", reason, instead)
    if item.command in rules.not_run:
        reason = f"an {stack.name} {stack.vehicle} stores it and passes over it in flight"
        yield problem("dropped", index, item, "command", reason, instead)
    with_position = takes_position(item, rules)
    if with_position:
        yield from bad_place(index, item, rules)
    elif rules.bare_frame not in (None, item.frame) or item.command not in rules.bare:
        reason, remedy = "without a position it needs frame 2", "give MAV_FRAME_MISSION"
        if item.command not in rules.bare:
            reason, remedy = "it needs a position", "give a global frame and a position"
        yield problem("refused", index, item, "frame", reason, remedy)
    yield from _bad_params(index, item, rules)
    allowed = rules.allowed.get((item.command, with_position))
    if allowed is not None and item.param1 not in allowed:
        shown = ", ".join(f"{value:g}" for value in allowed)
        yield problem("refused", index, item, "param1", "it is not taken here", f"give {shown}")
    low = rules.trusting and item.frame in (3, 6) and item.z <= 0.0
    if low and item.command in (mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_NAV_VTOL_TAKEOFF):
        reason = "a takeoff to home's altitude or below gets the whole mission rejected"
        yield problem("refused", index, item, "z", reason, "give an altitude above home")


def _bad_params(index: int, item: MissionItem, rules: Rules) -> Iterator[Problem]:
    nan_ok = None if rules.nan_ok is None else rules.nan_ok.get(item.command, ())
    for place, (field, word) in enumerate(zip(_PARAMS, words_of(item, rules), strict=True), 1):
        value: float = getattr(item, field)
        if math.isinf(value):
            kind: Kind = "dangerous" if rules.trusting else "refused"
            yield problem(kind, index, item, field, "it is infinite", "give a number")
        elif math.isnan(value):
            if nan_ok is not None and place not in nan_ok:
                remedy = "give a number; 0 is the default of most"
                yield problem("refused", index, item, field, "it is no number", remedy)
        elif (item.command, field) != (_JUMP, "param1"):  # see _bad_jumps
            yield from _changed(index, item, field, word, value)


def _changed(
    index: int, item: MissionItem, field: str, word: str, value: float
) -> Iterator[Problem]:
    if word == "-":
        if value != 0.0:
            reason = "the autopilot does not keep it"
            yield problem("changed", index, item, field, reason, "leave it 0 or do without")
        return
    most = _MOST.get(word)
    least = -most - 1 if most and word in ("i8", "i16") else -(most or 0) * (word == "radius")
    kept = kept_param(word, value)
    if most is not None and not least - 1 < value < most + (0.01 if word == "cm16" else 1):
        reason = f"it overflows and becomes {kept:g}"
        remedy = f"give a number from {least:g} to {most:g}"
        yield problem("dangerous", index, item, field, reason, remedy)
    elif word == "sign":
        if abs(value) not in (0.0, 1.0):
            reason = "only the direction is kept; the autopilot's own radius is flown"
            yield problem("changed", index, item, field, reason, "give 1 or -1")
    elif word not in _QUIET and abs(kept - value) > 1e-6 * max(1.0, abs(value)):
        reason, remedy = f"it becomes {kept:g}", f"give {kept:g}"
        yield problem("changed", index, item, field, reason, remedy)


def _bad_jumps(items: Sequence[MissionItem]) -> Iterator[Problem]:
    for index, item in enumerate(items):
        there = math.isfinite(item.param1) and item.param1 == math.trunc(item.param1)
        if item.command == _JUMP and not (there and 0 <= item.param1 < len(items)):
            reason = "no item has that place; accepted, and the mission ends or strays there"
            remedy = f"give a place from 0 to {len(items) - 1}"
            yield problem("dangerous", index, item, "param1", reason, remedy)


def _never_reached(items: Sequence[MissionItem], rules: Rules) -> Iterator[Problem]:
    """Items after an endless loiter, and items at the end that an ArduPlane does not run."""
    jumps = [item.param1 for item in items if item.command == _JUMP]
    ends = [index for index, item in enumerate(items) if item.command == ENDLESS]
    dead = set[int]()
    for start in ends[:1]:
        for index in range(start + 1, len(items)):
            if items[index].command in LAND_SEQUENCES or index in jumps:
                break
            reason = f"the loiter at item {start} never ends"
            yield problem("dropped", index, items[index], "command", reason, "put it before")
            dead.add(index)
    goes_on = [
        index
        for index, item in enumerate(items)
        if item.command <= mavlink.MAV_CMD_NAV_LAST or item.command in GOES_ON
    ]
    first = (goes_on[-1] if goes_on else -1) + 2
    for index in range(first, len(items) if rules.one_trailing_do else 0):
        if index not in dead:
            reason = "after the last NAV item only one item runs, then the plane returns home"
            remedy = "put a NAV item after it"
            yield problem("dropped", index, items[index], "command", reason, remedy)


def _too_long(items: Sequence[MissionItem], stack: Stack) -> Iterator[Problem]:
    most = stack.max_items - int(stack.item_0_is_home)  # home takes one
    if len(items) > most:
        reason = f"the autopilot holds {most} items"
        yield Problem("refused", None, "", "count", len(items), reason, "send fewer")


def adapted(items: Sequence[MissionItem], stack: Stack) -> Items:
    """The mission with items replaced that have an exact equivalent on the stack.

    Args:
        items: The items of a mission.
        stack: The autopilot and the kind of vehicle.

    Returns:
        As many items, in the same order.

    Frames: INT twins where the stack reads the plain ones back, MAV_FRAME_MISSION where items
    without position need it. NAV_ROI becomes DO_SET_ROI, a NaN becomes 0 where the stack refuses
    it and takes 0 for its default. A drop is not translated: the output of DO_SET_SERVO or
    DO_SET_ACTUATOR is configured on the vehicle; all stacks accept DO_GRIPPER.
    """
    rules = rules_of(stack)
    return tuple(_adapted(item, rules) for item in items)


def _adapted(item: MissionItem, rules: Rules) -> MissionItem:
    item = replace(item, command=SAME_AS.get(item.command, item.command))
    for place in rules.zero_is_default.get(item.command, ()):
        if math.isnan(getattr(item, _PARAMS[place - 1])):
            item = _with(item, _PARAMS[place - 1], 0.0)
    if rules.bare_frame is None:
        return replace(item, frame=TWIN.get(item.frame, item.frame))
    if item.command in rules.bare and item.command not in rules.position:
        # A position given to DO_LAND_START is not used, one given to DO_SET_HOME is.
        if item.frame == rules.bare_frame or item.command == mavlink.MAV_CMD_DO_SET_HOME:
            return item
        placed = has_position(item.command)
        x, y, z = (0, 0, 0.0) if placed else (item.x, item.y, item.z)
        return replace(item, frame=rules.bare_frame, x=x, y=y, z=z)
    return item


def _with(item: MissionItem, field: str, value: float) -> MissionItem:
    changes: dict[str, float] = {field: value}
    return replace(item, **changes)  # type: ignore[arg-type]
