"""Finds positions, fences and rally points that an autopilot would reject or misinterpret."""

import math
from collections.abc import Iterator, Sequence
from itertools import groupby

import shapely
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.missions.fence_file import CIRCLES, POLYGONS
from autopilot_bridge.missions.problems import Kind, Problem, problem
from autopilot_bridge.stacks.item_treatment import FENCE_COMMANDS, TERRAIN_FRAMES, Rules

_FRAME = "frames 0 (above sea level) and 3 (above home) are accepted"


def bad_place(index: int, item: MissionItem, rules: Rules) -> Iterator[Problem]:
    """Yield the problems of an item's frame, latitude, longitude and altitude."""
    yield from _bad_frame(index, item, rules)
    kind: Kind = "dangerous" if rules.accepts_bad_numbers else "refused"
    for field, maximum, name in (("x", 900_000_000, "latitude"), ("y", 1_800_000_000, "longitude")):
        if abs(getattr(item, field)) > maximum:
            reason = f"the {name} is beyond {maximum // 10_000_000} degrees"
            yield problem(kind, index, item, field, reason, f"specify the {name} in 1e-7 degrees")
    if item.x == 0 and item.y == 0 and not rules.zero_is_current_position:
        reason = "the vehicle would fly to latitude 0, longitude 0"
        yield problem("dangerous", index, item, "x", reason, "specify the position")
    if not math.isfinite(item.z):
        yield problem(
            kind, index, item, "z", "the altitude is not a number", "specify it in metres"
        )
    elif abs(item.z) >= rules.max_altitude_m:
        reason = f"altitudes must be below {rules.max_altitude_m:g} m"
        yield problem("refused", index, item, "z", reason, "specify it in metres")


def _bad_frame(index: int, item: MissionItem, rules: Rules) -> Iterator[Problem]:
    if item.frame in rules.frames:
        return
    if item.frame == mavlink.MAV_FRAME_MISSION and rules.bare_frame is None:
        reason = "without a frame, the altitude is interpreted as above mean sea level"
        yield problem(
            "dangerous", index, item, "frame", reason, "specify the frame of the altitude"
        )
        return
    terrain = item.frame in TERRAIN_FRAMES
    reason = f"{'altitudes above terrain are' if terrain else 'the frame is'} not accepted"
    yield problem("refused", index, item, "frame", reason, _FRAME)


def bad_rally(points: Sequence[MissionItem], rules: Rules) -> Iterator[Problem]:
    """Yield the problems of rally points."""
    for index, item in enumerate(points):
        if item.command != mavlink.MAV_CMD_NAV_RALLY_POINT:
            reason = "it is not a rally point"
            yield problem("refused", index, item, "command", reason, "remove it from the list")
        yield from bad_place(index, item, rules)
        if rules.whole_m_rally and math.isfinite(item.z) and item.z != math.trunc(item.z):
            reason = f"the altitude is truncated to {math.trunc(item.z)} m"
            yield problem("changed", index, item, "z", reason, "use whole metres")
    yield from _too_many("rally points", len(points), rules.max_rally)


def bad_fence(points: Sequence[MissionItem], rules: Rules) -> Iterator[Problem]:
    """Yield the problems of the items of a fence."""
    returns = 0
    kind: Kind = "dangerous" if rules.accepts_bad_numbers else "refused"
    for index, item in enumerate(points):
        if item.command not in FENCE_COMMANDS:
            reason = "it is not a fence item"
            yield problem(kind, index, item, "command", reason, "remove it from the list")
        yield from bad_place(index, item, rules)
        if item.command in CIRCLES and not (item.param1 > 0.0 and math.isfinite(item.param1)):
            reason = "a circle needs a radius above 0"
            yield problem(kind, index, item, "param1", reason, "specify it in metres")
        if item.command == mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT:
            returns += 1
            if returns > 1:
                reason = "the fence already has a return point"
                yield problem("refused", index, item, "command", reason, "keep one")
    yield from _bad_polygons(points, rules)
    yield from _too_many("fence points", len(points), rules.max_fence)


def _bad_polygons(points: Sequence[MissionItem], rules: Rules) -> Iterator[Problem]:
    numbered = list(enumerate(points))
    for (command, count), run in groupby(numbered, lambda at: (at[1].command, at[1].param1)):
        if command not in POLYGONS:
            continue
        vertices = list(run)
        index, first = vertices[0]
        if not count >= 3.0:
            reason = "a polygon needs at least three vertices"
            yield problem("refused", index, first, "param1", reason, "add vertices")
            continue
        if rules.max_vertices is not None and count > rules.max_vertices:
            reason = f"a polygon may have at most {rules.max_vertices} vertices"
            yield problem("refused", index, first, "param1", reason, "simplify it")
        if len(vertices) % count:
            kind: Kind = "dangerous" if rules.accepts_bad_numbers else "refused"
            reason = f"{len(vertices)} vertices cannot be divided into polygons of {count:g}"
            yield problem(kind, index, first, "param1", reason, "correct the number of vertices")
            continue
        for start in range(0, len(vertices), int(count)):
            ring = vertices[start : start + int(count)]
            if not shapely.LinearRing([(item.y, item.x) for _, item in ring]).is_simple:
                reason = "the polygon crosses itself, so its inside and outside are undefined"
                at, item = ring[0]
                yield problem("dangerous", at, item, "param1", reason, "reorder its vertices")


def _too_many(name: str, count: int, maximum: int | None) -> Iterator[Problem]:
    if maximum is not None and count > maximum:
        reason = f"the autopilot stores at most {maximum} {name}"
        yield Problem("refused", None, "", "count", count, reason, "send fewer")
