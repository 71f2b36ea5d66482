"""Each rule about items that an autopilot refuses, changes, drops or misinterprets."""

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot_bridge.items import NO_POSITION, Items, MissionItem, jumps_moved
from autopilot_bridge.missions.check import adapted, check
from autopilot_bridge.missions.read_back import FENCE, RALLY
from autopilot_bridge.stacks.item_treatment import rules_of
from autopilot_bridge.stacks.stacks import STACKS, Stack, stack_named
from tests.bridge.helpers import flight_of, line_of
from tests.bridge.mock_exchange import NOT_VTOLS

PX4, PX4_COPTER = stack_named("px4", "plane"), stack_named("px4", "copter")
PLANE, COPTER = stack_named("ardupilot", "plane"), stack_named("ardupilot", "copter")
ALL = (PX4, PX4_COPTER, PLANE, COPTER)
ARDUPILOT = (PLANE, COPTER)
BOTH_PX4 = (PX4, PX4_COPTER)
AT = 3, 363000000, -842000000, 50.0
NAN, INF = math.nan, math.inf


def at(command: int, *params: Any, **more: Any) -> MissionItem:
    """Return an item with a position and an altitude above home."""
    frame, x, y, z = AT
    return replace(MissionItem(command, frame, x, y, z, *params), **more)


def bare(command: int, *params: Any, **more: Any) -> MissionItem:
    """Return an item without a position, in MAV_FRAME_MISSION."""
    return replace(MissionItem(command, 2, 0, 0, 0.0, *params), **more)


def takes(stack: Stack) -> Items:
    """Return a mission that the stack accepts without changes."""
    yaw = NAN if stack.name == "px4" else 0.0
    return (at(22, 12.0, param4=yaw), at(16, param4=yaw), bare(211, 1.0, 0.0), at(17, 0, 0, -90.0))


# Cases with one item: stacks, item, (kind, field), and words of the reason or the remedy.
RULES: list[tuple[tuple[Stack, ...], MissionItem, tuple[str, str], str]] = [
    # Commands.
    (ALL, bare(31999), ("refused", "command"), "does not accept this command"),
    (ALL, at(34, 100.0), ("refused", "command"), "NAV_LOITER_UNLIM"),
    (BOTH_PX4, at(18, 2.0), ("refused", "command"), "NAV_LOITER_TIME"),
    (BOTH_PX4, bare(183, 9.0, 1900.0), ("refused", "command"), "DO_GRIPPER"),
    (BOTH_PX4, bare(181, 1.0, 1.0), ("refused", "command"), "DO_GRIPPER"),
    (BOTH_PX4, bare(216, 1.0), ("refused", "command"), "DO_SET_ACTUATOR"),
    (BOTH_PX4, at(82), ("refused", "command"), "NAV_WAYPOINT"),
    (ARDUPILOT, bare(187, 1.0), ("refused", "command"), "DO_SET_SERVO"),
    (ARDUPILOT, bare(400, 1.0), ("refused", "command"), "arm by command"),
    ((PLANE,), at(82), ("refused", "command"), "does not accept"),
    (BOTH_PX4, bare(112, 1.0), ("refused", "command"), "mission is rejected; use NAV_DELAY"),
    (BOTH_PX4, bare(114, 1.0), ("refused", "command"), "mission is rejected; add a waypoint"),
    ((PLANE,), bare(42600, 1.0), ("dropped", "command"), "skips it"),
    ((PLANE,), bare(115, 90.0), ("dropped", "command"), "skips it"),
    ((COPTER,), at(30, 1.0), ("dropped", "command"), "skips it"),
    # Frames.
    (ALL, at(16, frame=1), ("refused", "frame"), "the frame is not accepted"),
    (ALL, at(16, frame=7), ("refused", "frame"), "the frame is not accepted"),
    (BOTH_PX4, at(16, frame=10), ("refused", "frame"), "above terrain"),
    (BOTH_PX4, at(16, frame=11), ("refused", "frame"), "above terrain"),
    (ARDUPILOT, at(16, frame=2), ("dangerous", "frame"), "above mean sea level"),
    (BOTH_PX4, at(16, frame=2), ("refused", "frame"), "needs a position"),
    (BOTH_PX4, bare(211, 1.0, frame=3), ("refused", "frame"), "needs frame 2"),
    (BOTH_PX4, at(189), ("refused", "frame"), "needs frame 2"),
    # Places.
    (BOTH_PX4, at(16, x=910000000), ("dangerous", "x"), "latitude is beyond 90"),
    (BOTH_PX4, at(16, y=-1810000000), ("dangerous", "y"), "longitude is beyond 180"),
    (BOTH_PX4, at(16, x=NO_POSITION), ("dangerous", "x"), "latitude"),
    (BOTH_PX4, at(16, z=NAN), ("dangerous", "z"), "the altitude is not a number"),
    (BOTH_PX4, at(16, z=INF), ("dangerous", "z"), "the altitude is not a number"),
    (BOTH_PX4, at(16, x=0, y=0), ("dangerous", "x"), "latitude 0"),
    (ARDUPILOT, at(16, x=910000000), ("refused", "x"), "latitude is beyond 90"),
    (ARDUPILOT, at(16, y=1810000000), ("refused", "y"), "longitude is beyond 180"),
    (ARDUPILOT, at(16, z=NAN), ("refused", "z"), "the altitude is not a number"),
    (ARDUPILOT, at(16, z=83000.0), ("refused", "z"), "below 83000 m"),
    (BOTH_PX4, at(22, z=0.0), ("refused", "z"), "home altitude"),
    (BOTH_PX4, at(84, z=-1.0), ("refused", "z"), "home altitude"),
    # Values that are not numbers.
    (ARDUPILOT, at(17, 0, 0, NAN), ("refused", "param3"), "it is not a number"),
    (ARDUPILOT, at(19, 1.0, 0, 1.0, NAN), ("refused", "param4"), "it is not a number"),
    (ARDUPILOT, bare(183, 9.0, INF), ("refused", "param2"), "infinite"),
    (BOTH_PX4, bare(187, INF), ("dangerous", "param1"), "infinite"),
    # Values that overflow or are truncated.
    (ARDUPILOT, at(17, 0, 0, 70000.0), ("dangerous", "param3"), "becomes 4464; use"),
    (ARDUPILOT, at(17, 0, 0, -70000.0), ("dangerous", "param3"), "becomes -4464"),
    (ARDUPILOT, at(17, 0, 0, 123.7), ("changed", "param3"), "becomes 123"),
    (ARDUPILOT, at(31, 0, -70000.0), ("dangerous", "param2"), "becomes -4464"),
    (ARDUPILOT, at(18, 2.5, 0, 100.0), ("changed", "param1"), "becomes 2"),
    (ARDUPILOT, at(18, 300.0, 0, 100.0), ("changed", "param1"), "becomes 255"),
    (ARDUPILOT, at(18, 2.0, 0, 333.0), ("changed", "param3"), "becomes 330"),
    (ARDUPILOT, at(18, 2.0, 0, -3000.0), ("changed", "param3"), "becomes -2550"),
    (ARDUPILOT, at(18, 2.0, 0, 99.5), ("changed", "param3"), "becomes 99"),
    (ARDUPILOT, at(19, 30.0, 0, -90.0), ("changed", "param3"), "only the direction"),
    (ARDUPILOT, at(19, 30.6), ("changed", "param1"), "becomes 30"),
    (ARDUPILOT, at(19, 65536.0), ("dangerous", "param1"), "becomes 0"),
    (ARDUPILOT, at(22, -1.0), ("dangerous", "param1"), "overflows"),
    (ARDUPILOT, bare(183, 300.0, 1900.0), ("dangerous", "param1"), "becomes 44"),
    (ARDUPILOT, bare(177, 0.0, 40000.0), ("dangerous", "param2"), "becomes -25536"),
    ((COPTER,), bare(115, 90.0, 5.0, 128.0), ("dangerous", "param3"), "becomes -128"),
    ((COPTER,), at(94, 700.0), ("dangerous", "param1"), "overflows"),
    (ARDUPILOT, at(16, param4=91.5), ("changed", "param4"), "does not store it"),
    ((PLANE,), at(16, 7.0), ("changed", "param1"), "does not store it"),
    ((PLANE,), at(16, 0, 300.0), ("changed", "param2"), "becomes 255"),
    ((PLANE,), at(16, 0, 0, 40.5), ("changed", "param3"), "becomes 40"),
    ((COPTER,), at(16, 0, 30.0), ("changed", "param2"), "does not store it"),
    (BOTH_PX4, at(16, 0, 0, 40.0), ("changed", "param3"), "does not store it"),
    (BOTH_PX4, at(21, 10.0), ("changed", "param1"), "does not store it"),
    # Modes.
    (BOTH_PX4, at(201, 1.0), ("refused", "param1"), "use 0, 3"),
    (BOTH_PX4, bare(201, 3.0), ("refused", "param1"), "use 0, 1, 2"),
    (BOTH_PX4, at(80, 2.0), ("refused", "param1"), "use 0, 3"),
    (BOTH_PX4, bare(80, 4.0), ("refused", "param1"), "use 0, 1, 2"),
    # Jumps without a valid target.
    (ALL, bare(177, 99.0), ("dangerous", "param1"), "no item has this index"),
    (ALL, bare(177, -1.0), ("dangerous", "param1"), "no item has this index"),
    (ALL, bare(177, 0.5), ("dangerous", "param1"), "no item has this index"),
]
CASES = [(stack, *rule) for stacks, *rule in RULES for stack in stacks]


def named(value: object) -> str | None:
    return f"{value.name}-{value.vehicle}" if isinstance(value, Stack) else None


each_stack = pytest.mark.parametrize("stack", NOT_VTOLS, ids=named)


@pytest.mark.parametrize(("stack", "item", "expected", "words"), CASES, ids=named)
def test_a_bad_item_is_reported_once(
    stack: Stack, item: MissionItem, expected: tuple[str, str], words: str
) -> None:
    before, *after = takes(stack)
    found = [p for p in check((before, item, *after), stack) if (p.kind, p.field) == expected]
    (problem,) = found
    assert problem.index == 1
    assert words in str(problem)
    assert str(problem).startswith(f"item 1 {problem.command}: {problem.field} ")
    assert problem.value == getattr(item, expected[1]) or math.isnan(problem.value)
    assert "\n" not in str(problem)


# Valid items that are similar to invalid ones, for which no problem may be reported.
WELL: list[tuple[tuple[Stack, ...], MissionItem]] = [
    (ALL, at(16, param4=NAN)),
    (ALL, at(16, frame=6)),
    (ALL, at(16, frame=5)),
    (ALL, at(19, 30.0, 0, -1.0)),
    (ALL, at(31, 0, 120.0)),
    (ALL, bare(211, 1.0, 1.0)),
    (ALL, bare(177, 0.0, -1.0)),
    (ALL, bare(20)),
    (ALL, at(195)),
    (ARDUPILOT, at(16, frame=10)),
    (ARDUPILOT, at(16, x=0, y=0)),
    (ARDUPILOT, at(18, 255.0, 0, -2550.0)),
    (ARDUPILOT, at(18, 0.5, 0, 255.0)),
    (ARDUPILOT, bare(183, 9.0, 1900.0, frame=3)),
    (ARDUPILOT, at(22, x=0, y=0)),
    ((PLANE,), at(16, 0, 30.0)),
    ((COPTER,), at(16, 7.0)),
    ((COPTER,), at(94, 10.25)),
    ((COPTER,), at(82)),
    (BOTH_PX4, at(16, 7.6, 30.4, 0, 91.5)),
    (BOTH_PX4, at(19, 0, 0, 70000.5)),
    (BOTH_PX4, at(22, 0, frame=0, z=0.0)),
    (BOTH_PX4, at(201, 3.0)),
    (BOTH_PX4, bare(187, 0.5, NAN, NAN)),
    # Commands that can drop a load.
    (ARDUPILOT, bare(181, 1.0, 1.0)),
    (ARDUPILOT, bare(182, 1.0, 2.0, 1.5)),
    (ARDUPILOT, bare(216, 1.0)),
    ((*BOTH_PX4, COPTER), bare(42600, 1.0, 1.0, 5.0, 1.0)),
    (BOTH_PX4, bare(189)),
]


@pytest.mark.parametrize(
    ("stack", "item"), [(stack, item) for stacks, item in WELL for stack in stacks], ids=named
)
def test_a_good_item_is_left_alone(stack: Stack, item: MissionItem) -> None:
    before, *after = takes(stack)
    assert check((before, item, at(16), *after), stack) == []


@each_stack
def test_a_mission_that_is_taken_has_no_problems(stack: Stack) -> None:
    assert check(takes(stack), stack) == []
    assert check(flight_of(), stack) == []
    assert check((), stack) == []


@pytest.mark.parametrize(("stack", "most"), [(PLANE, 654), (COPTER, 649), (PX4, 5000)], ids=named)
def test_the_longest_mission_counts_the_home_that_is_sent_along(stack: Stack, most: int) -> None:
    assert check(line_of(most), stack) == []
    (problem,) = check(line_of(most + 1), stack)
    assert (problem.kind, problem.index, problem.value) == ("refused", None, most + 1)
    assert str(problem) == (
        f"mission: count {most + 1}: the autopilot stores at most {most} items; send fewer"
    )


@each_stack
def test_items_after_an_endless_loiter_are_reported(stack: Stack) -> None:
    mission = (*takes(stack), at(16), bare(211, 1.0))
    assert [(p.kind, p.index) for p in check(mission, stack)] == [("dropped", 4), ("dropped", 5)]
    drops = (bare(211, 1.0), bare(206, 5.0), bare(206, 5.0))
    assert [p.index for p in check((*takes(stack), *drops), stack)] == [4, 5, 6]
    reached = bare(177, 4.0, 1.0)
    assert check((mission[0], reached, mission[1], mission[3], *mission[4:], at(16)), stack) == []
    land = bare(189) if stack.name == "px4" else at(189)
    assert check((*takes(stack), land, at(16), at(21, param4=NAN)), stack) == []


def test_only_one_item_runs_after_the_last_nav_item_of_a_plane() -> None:
    tail = (at(16), bare(211, 1.0), bare(183, 9.0, 1900.0), bare(206, 5.0))
    (first, second) = check(tail, PLANE)
    assert [(p.kind, p.index) for p in (first, second)] == [("dropped", 2), ("dropped", 3)]
    assert "the plane returns" in first.reason
    assert check(tail, COPTER) == []
    assert check((*tail, at(16)), PLANE) == []
    assert check((*tail, bare(177, 0.0, -1.0)), PLANE) == []


def polygon(*places: tuple[int, int], command: int = 5001, count: float | None = None) -> Items:
    number = float(len(places)) if count is None else count
    return tuple(MissionItem(command, 0, x, y, 0.0, number) for x, y in places)


SQUARE = ((0, 1), (0, 9), (9, 9), (9, 1))
CIRCLE = MissionItem(5003, 0, 5, 5, 0.0, 40.0)
RETURN = MissionItem(5000, 3, 5, 5, 30.0)


@each_stack
def test_a_good_fence_and_good_rally_points_have_no_problems(stack: Stack) -> None:
    fence = (*polygon(*SQUARE), *polygon(*SQUARE), *polygon(*SQUARE, command=5002), CIRCLE, RETURN)
    assert check(fence, stack, FENCE) == []
    assert check((MissionItem(5100, 3, 5, 5, 60.0),) * 2, stack, RALLY) == []


FENCES: list[tuple[tuple[Stack, ...], Items, tuple[str, int | None, str], str]] = [
    (ALL, polygon((0, 1), (0, 9)), ("refused", 0, "param1"), "three vertices"),
    (ALL, polygon(*SQUARE, count=NAN), ("refused", 0, "param1"), "three vertices"),
    (ARDUPILOT, polygon(*SQUARE, count=5.0), ("refused", 0, "param1"), "4 vertices cannot"),
    (BOTH_PX4, polygon(*SQUARE, count=5.0), ("dangerous", 0, "param1"), "4 vertices cannot"),
    (ALL, polygon((0, 1), (9, 9), (0, 9), (9, 1)), ("dangerous", 0, "param1"), "crosses itself"),
    (
        ALL,
        (*polygon(*SQUARE), *polygon((0, 1), (9, 9), (0, 9), (9, 1))),
        ("dangerous", 4, "param1"),
        "crosses itself",
    ),
    (ARDUPILOT, (replace(CIRCLE, param1=0.0),), ("refused", 0, "param1"), "radius above 0"),
    (BOTH_PX4, (replace(CIRCLE, param1=NAN),), ("dangerous", 0, "param1"), "radius above 0"),
    (ARDUPILOT, (at(16),), ("refused", 0, "command"), "not a fence item"),
    (BOTH_PX4, (at(16),), ("dangerous", 0, "command"), "not a fence item"),
    (ALL, (RETURN, CIRCLE, RETURN), ("refused", 2, "command"), "already has a return point"),
    (ARDUPILOT, (replace(CIRCLE, x=910000000),), ("refused", 0, "x"), "latitude"),
    (ALL, (replace(CIRCLE, frame=1),), ("refused", 0, "frame"), "not accepted"),
    (BOTH_PX4, (CIRCLE,) * 65, ("refused", None, "count"), "64 fence points"),
]


@pytest.mark.parametrize(
    ("stack", "fence", "expected", "words"),
    [(stack, *rule) for stacks, *rule in FENCES for stack in stacks],
    ids=named,
)
def test_a_bad_fence_is_reported(
    stack: Stack, fence: Items, expected: tuple[str, int | None, str], words: str
) -> None:
    (problem,) = check(fence, stack, FENCE)
    assert (problem.kind, problem.index, problem.field) == expected
    assert words in str(problem)


def test_a_polygon_of_an_ardupilot_may_have_255_vertices() -> None:
    ring = [(round(1e6 * math.sin(a / 50)), round(1e6 * math.cos(a / 50))) for a in range(256)]
    assert check(polygon(*ring[:255]), PLANE, FENCE) == []
    (problem,) = check(polygon(*ring), PLANE, FENCE)
    assert "255 vertices" in problem.reason


@pytest.mark.parametrize(
    ("stack", "points", "expected"),
    [
        (PLANE, (at(16),), ("refused", "command")),
        (PX4, (at(16),), ("refused", "command")),
        (PLANE, (at(5100, z=60.7),), ("changed", "z")),
        (PX4, (at(5100, z=NAN),), ("dangerous", "z")),
        (PX4, (at(5100, frame=10),), ("refused", "frame")),
        (PX4, (at(5100),) * 33, ("refused", "count")),
    ],
    ids=named,
)
def test_bad_rally_points_are_reported(
    stack: Stack, points: Items, expected: tuple[str, str]
) -> None:
    (problem,) = check(points, stack, RALLY)
    assert (problem.kind, problem.field) == expected


ADAPTED: list[tuple[tuple[Stack, ...], MissionItem, MissionItem]] = [
    (ARDUPILOT, at(16, frame=6), at(16)),
    (ARDUPILOT, at(16, frame=5), at(16, frame=0)),
    (ARDUPILOT, at(16, frame=11), at(16, frame=10)),
    (ARDUPILOT, at(17, 0.0, 0.0, NAN), at(17)),
    (ARDUPILOT, at(80, 3.0), at(201, 3.0)),
    (BOTH_PX4, bare(211, 1.0, frame=0), bare(211, 1.0)),
    (BOTH_PX4, bare(211, 1.0, frame=3), bare(211, 1.0)),
    (BOTH_PX4, at(189), bare(189)),
    (BOTH_PX4, at(80, 3.0), at(201, 3.0)),
    # Items without an equivalent, or with several: adapted() leaves them to check().
    (BOTH_PX4, at(16, frame=10), at(16, frame=10)),
    (BOTH_PX4, bare(183, 9.0, 1900.0), bare(183, 9.0, 1900.0)),
    (BOTH_PX4, at(179, 0.0), at(179, 0.0)),
    (BOTH_PX4, at(17, 0, 0, NAN), at(17, 0, 0, NAN)),
    (ARDUPILOT, bare(187, 1.0), bare(187, 1.0)),
    (ARDUPILOT, at(16, frame=2), at(16, frame=2)),
    (ARDUPILOT, at(18, NAN), at(18, NAN)),
]


@pytest.mark.parametrize(
    ("stack", "item", "due"),
    [(stack, *rule) for stacks, *rule in ADAPTED for stack in stacks],
    ids=named,
)
def test_what_has_an_equivalent_is_replaced(
    stack: Stack, item: MissionItem, due: MissionItem
) -> None:
    assert repr(adapted((item,), stack)) == repr((due,))


commands = sorted({*rules_of(PX4).position, *rules_of(PX4).bare, *rules_of(COPTER).bare, 18, 82})
any_item = st.builds(
    MissionItem,
    st.sampled_from(commands),
    st.sampled_from([0, 1, 2, 3, 5, 6, 10, 11]),
    st.integers(-950_000_000, 950_000_000),
    st.integers(-1_900_000_000, 1_900_000_000),
    *[st.just(NAN) | st.floats(-1e5, 1e5)] * 5,
)


@given(st.sampled_from(STACKS), st.lists(any_item, max_size=6))
def test_adapting_never_makes_it_worse_and_is_done_at_once(
    stack: Stack, mission: list[MissionItem]
) -> None:
    once = adapted(mission, stack)
    assert repr(adapted(once, stack)) == repr(once)
    assert {p.index for p in check(once, stack)} <= {p.index for p in check(mission, stack)}


def test_jumps_follow_the_home_that_is_sent_along() -> None:
    mission = (at(16), bare(177, 0.0, 2.0))
    assert jumps_moved(mission, 1) == (at(16), bare(177, 1.0, 2.0))
    assert jumps_moved(jumps_moved(mission, 1), -1) == mission
