"""Finds items of a mission that the autopilot would reject, change or execute wrongly.

The functions apply the data in ``stacks/item_treatment.py``. The items are those of a user: a list
does not contain ArduPilot's home, and DO_JUMP targets are indexes from 0.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import TAKEOFFS, Items, MissionItem, has_position
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
from autopilot_bridge.stacks.item_treatment import (
    ENDLESS,
    INSTEAD,
    LAND_SEQUENCES,
    OTHER_NAVIGATION,
    SAME_AS,
    TWIN,
    Rules,
    rules_of,
)
from autopilot_bridge.stacks.stacks import Stack

_JUMP = mavlink.MAV_CMD_DO_JUMP
_PARAMS = ("param1", "param2", "param3", "param4")
# Changes described by these words (see ``stacks/item_treatment.py``) are not reported.
_QUIET = ("keep", "hint", "hidden", "yaw", "side", "flag")
_MAXIMA = {"u8": 255, "u16": 65535, "i8": 127, "i16": 32767, "cm16": 655.35, "radius": 65535}


def check(items: Sequence[MissionItem], stack: Stack, mission_type: int = MISSION) -> list[Problem]:
    """Return the problems of items that a stack rejects, changes, misinterprets or never executes.

    Args:
        items: The items of a mission, a fence or a rally list, without ArduPilot's home.
        stack: The autopilot and the kind of vehicle.
        mission_type: The MAV_MISSION_TYPE: 0 for a mission, 1 for a fence, 2 for rally points.

    Returns:
        The problems; those of single items come first. ``str`` of a problem is a line for users.

    Source: see ``stacks/item_treatment.py``.
    """
    rules = rules_of(stack)
    if mission_type == FENCE:
        return list(bad_fence(items, rules))
    if mission_type == RALLY:
        return list(bad_rally(items, rules))
    of_items = (_bad_item(index, item, stack, rules) for index, item in enumerate(items))
    return [
        *chain.from_iterable(of_items),
        *_bad_jumps(items),
        *_never_reached(items, rules),
        *_too_long(items, stack),
    ]


def _bad_item(index: int, item: MissionItem, stack: Stack, rules: Rules) -> Iterator[Problem]:
    instead = INSTEAD.get((stack.name, item.command), f"{stack.name} has no equivalent")
    if item.command not in rules.position and item.command not in rules.bare:
        reason = f"{stack.name} does not accept this command"
        yield problem("refused", index, item, "command", reason, instead)
        return
    if item.command in rules.invalidates_mission:
        reason = "the item is stored, and then the whole mission is rejected"
        yield problem("refused", index, item, "command", reason, instead)
    if item.command in rules.not_run:
        reason = f"{stack.name} stores it, but a {stack.kind} skips it in flight"
        yield problem("dropped", index, item, "command", reason, instead)
    with_position = takes_position(item, rules)
    if with_position:
        yield from bad_place(index, item, rules)
    elif rules.bare_frame not in (None, item.frame) or item.command not in rules.bare:
        reason, remedy = "without a position it needs frame 2", "use MAV_FRAME_MISSION"
        if item.command not in rules.bare:
            reason, remedy = "it needs a position", "use a global frame and a position"
        yield problem("refused", index, item, "frame", reason, remedy)
    yield from _bad_params(index, item, rules)
    allowed = rules.allowed.get((item.command, with_position))
    if allowed is not None and item.param1 not in allowed:
        shown = ", ".join(f"{value:g}" for value in allowed)
        yield problem("refused", index, item, "param1", "it is not accepted", f"use {shown}")
    takeoff_low = rules.accepts_bad_numbers and item.frame in (3, 6) and item.z <= 0.0
    if takeoff_low and item.command in TAKEOFFS:
        reason = "a takeoff to the home altitude or below causes the whole mission to be rejected"
        yield problem("refused", index, item, "z", reason, "use an altitude above home")
    climbs_by_z = stack.vtol and stack.name == "ardupilot" and item.command in TAKEOFFS
    if climbs_by_z and item.frame not in (3, 6):
        reason = "a quadplane climbs vertically by z above its position, in every frame"
        yield problem("dangerous", index, item, "frame", reason, "use frame 3 and a height")


def _bad_params(index: int, item: MissionItem, rules: Rules) -> Iterator[Problem]:
    nan_ok = None if rules.nan_ok is None else rules.nan_ok.get(item.command, ())
    for number, (field, word) in enumerate(zip(_PARAMS, words_of(item, rules), strict=True), 1):
        value: float = getattr(item, field)
        if math.isinf(value):
            kind: Kind = "dangerous" if rules.accepts_bad_numbers else "refused"
            yield problem(kind, index, item, field, "it is infinite", "give a number")
        elif math.isnan(value):
            if nan_ok is not None and number not in nan_ok:
                remedy = "specify a number; 0 is the default of most params"
                yield problem("refused", index, item, field, "it is not a number", remedy)
        elif (item.command, field) != (_JUMP, "param1"):  # see _bad_jumps
            yield from _changed(index, item, field, word, value)


def _changed(
    index: int, item: MissionItem, field: str, word: str, value: float
) -> Iterator[Problem]:
    if word == "-":
        if value != 0.0:
            reason = "the autopilot does not store it"
            yield problem("changed", index, item, field, reason, "give 0")
        return
    maximum = _MAXIMA.get(word)
    minimum = (
        -maximum - 1 if maximum and word in ("i8", "i16") else -(maximum or 0) * (word == "radius")
    )
    kept = kept_param(word, value)
    if maximum is not None and not minimum - 1 < value < maximum + (0.01 if word == "cm16" else 1):
        reason = f"it overflows and becomes {kept:g}"
        remedy = f"use a number from {minimum:g} to {maximum:g}"
        yield problem("dangerous", index, item, field, reason, remedy)
    elif word == "sign":
        if abs(value) not in (0.0, 1.0):
            reason = "only the direction is stored; the autopilot uses its default radius"
            yield problem("changed", index, item, field, reason, "use 1 or -1")
    elif word not in _QUIET and abs(kept - value) > 1e-6 * max(1.0, abs(value)):
        reason, remedy = f"it becomes {kept:g}", f"use {kept:g}"
        yield problem("changed", index, item, field, reason, remedy)


def _bad_jumps(items: Sequence[MissionItem]) -> Iterator[Problem]:
    for index, item in enumerate(items):
        whole = math.isfinite(item.param1) and item.param1 == math.trunc(item.param1)
        if item.command == _JUMP and not (whole and 0 <= item.param1 < len(items)):
            reason = "no item has this index; the jump is accepted, but the mission fails"
            remedy = f"use an index from 0 to {len(items) - 1}"
            yield problem("dangerous", index, item, "param1", reason, remedy)


def _never_reached(items: Sequence[MissionItem], rules: Rules) -> Iterator[Problem]:
    """Yield problems of items after an unlimited loiter and of last items ignored by ArduPlane."""
    jumps = [item.param1 for item in items if item.command == _JUMP]
    ends = [index for index, item in enumerate(items) if item.command == ENDLESS]
    reported = set[int]()
    for start in ends[:1]:
        for index in range(start + 1, len(items)):
            if items[index].command in LAND_SEQUENCES or index in jumps:
                break
            reason = f"the loiter at item {start} never ends"
            yield problem(
                "dropped",
                index,
                items[index],
                "command",
                reason,
                "move this item before the loiter",
            )
            reported.add(index)
    navigation = [
        index
        for index, item in enumerate(items)
        if item.command <= mavlink.MAV_CMD_NAV_LAST or item.command in OTHER_NAVIGATION
    ]
    first = (navigation[-1] if navigation else -1) + 2
    for index in range(first, len(items) if rules.one_trailing_do else 0):
        if index not in reported:
            reason = "after the last NAV item only one item is executed, then the plane returns"
            remedy = "add a NAV item after it"
            yield problem("dropped", index, items[index], "command", reason, remedy)


def _too_long(items: Sequence[MissionItem], stack: Stack) -> Iterator[Problem]:
    maximum = stack.max_items - int(stack.item_0_is_home)
    if len(items) > maximum:
        reason = f"the autopilot stores at most {maximum} items"
        yield Problem("refused", None, "", "count", len(items), reason, "send fewer")


def adapted(items: Sequence[MissionItem], stack: Stack) -> Items:
    """Return the mission with some items replaced by their exact equivalents on the stack.

    Args:
        items: The items of a mission.
        stack: The autopilot and the kind of vehicle.

    Returns:
        The same number of items, in the same order.

    Deprecated INT frames become the equivalent frames, and items without a position get
    MAV_FRAME_MISSION if the stack requires it. NAV_ROI becomes DO_SET_ROI. NaN becomes 0 where the
    stack rejects NaN and 0 means the default. Drop commands are not changed: the output of a
    DO_SET_SERVO or a DO_SET_ACTUATOR is configured on the vehicle, and all stacks accept
    DO_GRIPPER.
    """
    rules = rules_of(stack)
    return tuple(_adapted(item, rules) for item in items)


def _adapted(item: MissionItem, rules: Rules) -> MissionItem:
    item = replace(item, command=SAME_AS.get(item.command, item.command))
    params = [_PARAMS[number - 1] for number in rules.zero_is_default.get(item.command, ())]
    zeros = {param: 0.0 for param in params if math.isnan(getattr(item, param))}
    item = replace(item, **zeros)  # type: ignore[arg-type]
    if rules.bare_frame is None:
        return replace(item, frame=TWIN.get(item.frame, item.frame))
    if item.command in rules.bare and item.command not in rules.position:
        # PX4 does not use the position of DO_LAND_START, but it uses that of DO_SET_HOME.
        if item.frame == rules.bare_frame or item.command == mavlink.MAV_CMD_DO_SET_HOME:
            return item
        placed = has_position(item.command)
        x, y, z = (0, 0, 0.0) if placed else (item.x, item.y, item.z)
        return replace(item, frame=rules.bare_frame, x=x, y=y, z=z)
    return item
