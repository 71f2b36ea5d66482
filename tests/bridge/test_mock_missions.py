"""The main features of each stack's mission protocol, in short exchanges."""

from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem, loiter_unlimited
from autopilot_bridge.stacks.stacks import Stack
from tests.bridge.helpers import line_of
from tests.bridge.mock_exchange import (
    COPTER,
    OTHER,
    PLANE,
    PX4,
    TARGET,
    UNKNOWN,
    WAYPOINT,
    ack,
    brief,
    clear,
    command,
    count,
    current,
    each_stack,
    item,
    listing,
    player_of,
    read,
    texts,
    upload,
)

# Uploads ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stack", "asks"), [(PX4, "MISSION_REQUEST_INT"), (PLANE, "MISSION_REQUEST")]
)
def test_items_are_asked_for_in_the_words_of_the_stack(stack: Stack, asks: str) -> None:
    player = player_of(stack)
    assert brief(player.send(count(2))) == [(asks, 0)]
    assert brief(player.send(item(0, line_of(2)[0]))) == [(asks, 1)]
    assert brief(player.send(item(1, line_of(2)[1]))) == [("MISSION_ACK", 0)]


def test_an_item_out_of_order_is_scolded_by_ardupilot_and_passed_over_by_px4() -> None:
    for stack, answer in ((PLANE, [("MISSION_ACK", 13)]), (PX4, [])):
        player = player_of(stack)
        player.send(count(3))
        player.send(item(0, line_of(3)[0]))
        assert brief(player.send(item(2, line_of(3)[2]))) == answer
        again = brief(player.listen(1.1))
        assert again[0] == (f"MISSION_REQUEST{'' if stack is PLANE else '_INT'}", 1)
        assert brief(player.send(item(1, line_of(3)[1])))[-1][1] == 2


def test_a_silent_uploader_is_asked_again_and_given_up() -> None:
    player = player_of(PLANE)
    player.send(count(3))
    replies = player.listen(12.0)
    assert brief(replies) == [("MISSION_REQUEST", 0)] * 7 + [("MISSION_ACK", 15)]
    assert "Mission upload timeout" in texts(replies)
    player = player_of(PX4)
    player.send(count(3))
    replies = player.listen(12.0)
    assert len(brief(replies)) == pytest.approx(19, abs=1)
    # The mock sends no MISSION_ACK.
    assert {name for name, _ in brief(replies)} == {"MISSION_REQUEST_INT"}
    assert texts(replies) == ["Operation timeout"]


def test_a_cancelled_upload_ends_on_px4_and_goes_on_on_ardupilot() -> None:
    for stack, still_asks in ((PX4, False), (PLANE, True)):
        player = player_of(stack)
        player.send(count(3))
        player.send(ack(15, 1))  # for another list
        assert brief(player.send(item(0, line_of(3)[0])))[0][1] == 1
        assert brief(player.send(ack(15))) == []
        assert bool(brief(player.listen(3.0))) == still_asks


def test_another_station_has_to_wait() -> None:
    player = player_of(PLANE)
    player.send(count(3))
    assert brief(player.send(count(2), OTHER)) == [("MISSION_ACK", 14)]
    assert brief(player.send(listing(), OTHER)) == [("MISSION_ACK", 14)]
    assert brief(player.send(count(3))) == [("MISSION_REQUEST", 0)]
    player = player_of(PX4)
    player.send(count(3))
    assert brief(player.send(count(2), OTHER)) == [("MISSION_ACK", 1)]
    assert brief(player.send(listing(), OTHER)) == [("MISSION_COUNT", 0)]


def test_px4_takes_a_second_count_only_before_the_first_item() -> None:
    player = player_of(PX4)
    player.send(count(3))
    assert brief(player.send(count(3))) == [("MISSION_REQUEST_INT", 0)]
    player.send(item(0, line_of(3)[0]))
    replies = player.send(count(3))
    assert brief(replies) == [("MISSION_ACK", 1)]
    assert texts(replies) == ["WPM: REJ. CMD: Busy"]


def test_the_last_item_again_is_acknowledged_again_by_px4_alone() -> None:
    for stack, code in ((PX4, 0), (PLANE, 1)):
        player = player_of(stack)
        upload(player, line_of(3))
        assert brief(player.send(item(2, line_of(3)[2]))) == [("MISSION_ACK", code)]
        assert brief(player.send(item(0, line_of(3)[0]))) == [("MISSION_ACK", 1)]


@each_stack
def test_a_refused_item_leaves_the_old_mission_or_a_mixture(stack: Stack) -> None:
    player = player_of(stack)
    upload(player, line_of(5))
    assert brief(upload(player, (*line_of(4, 3)[:2], UNKNOWN))) == [("MISSION_ACK", 3)]
    held = [one.y for one in read(player)]
    old, new = [one.y for one in line_of(5)], [one.y for one in line_of(4, 3)]
    if stack.atomic_upload:
        assert held == old
    else:
        assert held[1:] == [new[1], old[2]]


@each_stack
def test_too_many_items_find_no_space(stack: Stack) -> None:
    player = player_of(stack)
    replies = player.send(count(20_000))
    assert brief(replies) == [("MISSION_ACK", 4)]
    if stack.name == "ardupilot":
        assert texts(replies) == [f"Only {stack.max_items} items are supported"]


# What is kept -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stack", "sent", "kept"),
    [
        (PLANE, replace(WAYPOINT, frame=6, z=50.129), {"frame": 3, "z": 50.12}),
        (PLANE, replace(WAYPOINT, param1=5.5, param2=20.7), {"param1": 0.0, "param2": 20.0}),
        (COPTER, replace(WAYPOINT, param1=5.5, param2=20.7), {"param1": 5.0, "param2": 0.0}),
        (PLANE, loiter_unlimited(36.31, -84.19, 400.0, -99.9), {"param3": -99.0}),
        (PLANE, loiter_unlimited(36.31, -84.19, 400.0, 70_000.0), {"param3": 4464.0}),
        (PLANE, replace(WAYPOINT, command=18, param1=2.9, param3=-299.0), {"param3": -290.0}),
        (PLANE, replace(WAYPOINT, command=19, param1=9.5, param3=-60.0), {"param3": -1.0}),
        (PLANE, MissionItem(183, 2, 5, 5, 5.0, 9.0, 1500.0), {"frame": 0, "x": 0, "z": 0.0}),
        (PX4, WAYPOINT, {"frame": 5}),
        (PX4, replace(WAYPOINT, frame=3, z=50.129, param3=7.0), {"frame": 6, "param3": 0.0}),
        (PX4, loiter_unlimited(36.31, -84.19, 400.0, -99.5), {"param3": -99.5}),
        (PX4, MissionItem(211, 2, 0, 0, 0.0, 1.0), {"frame": 2, "param1": 1.0}),
    ],
)
def test_items_are_read_back_as_the_stack_keeps_them(
    stack: Stack, sent: MissionItem, kept: dict[str, float]
) -> None:
    player = player_of(stack)
    assert brief(upload(player, (WAYPOINT, sent))) == [("MISSION_ACK", 0)]
    back = read(player)[1]
    assert {name: getattr(back, name) for name in kept} == pytest.approx(kept, rel=1e-6)


@pytest.mark.parametrize(
    ("stack", "sent", "code"),
    [
        (PLANE, replace(WAYPOINT, frame=1), 2),
        (PLANE, replace(WAYPOINT, param1=float("nan")), 6),
        (PLANE, replace(WAYPOINT, param4=float("nan")), 0),
        (PLANE, replace(WAYPOINT, x=910_000_000), 10),
        (PLANE, replace(WAYPOINT, y=1_810_000_000), 11),
        (PLANE, replace(WAYPOINT, z=float("nan")), 12),
        (PX4, replace(WAYPOINT, frame=10), 2),
        (PX4, replace(WAYPOINT, x=910_000_000), 0),
        (PX4, replace(WAYPOINT, command=18), 3),
        (PX4, MissionItem(183, 2, 0, 0, 0.0, 9.0, 1500.0), 3),
        (PX4, MissionItem(211, 0, 0, 0, 0.0, 1.0), 3),
    ],
)
def test_items_are_refused_with_the_code_of_the_stack(
    stack: Stack, sent: MissionItem, code: int
) -> None:
    assert brief(upload(player_of(stack), (WAYPOINT, sent))) == [("MISSION_ACK", code)]


def test_item_0_of_ardupilot_is_its_home() -> None:
    player = player_of(PLANE)
    upload(player, line_of(3))
    assert (read(player)[0].x, read(player)[0].z) == (363000000, 300.0)
    assert current(player)["total"] == 2


# Downloads --------------------------------------------------------------------------------------


def test_a_request_beyond_the_end_is_refused() -> None:
    beyond = mavlink.MAVLink_mission_request_int_message(*TARGET, 50, 0)
    player = player_of(PLANE)
    upload(player, line_of(3))
    assert brief(player.send(beyond)) == [("MISSION_COUNT", 3), ("MISSION_ACK", 1)]
    player = player_of(PX4)
    upload(player, line_of(3))
    assert brief(player.send(beyond)) == []  # no download is open
    player.send(listing())
    assert brief(player.send(beyond)) == [("MISSION_ACK", 1)]


@each_stack
def test_old_clients_get_degrees_and_are_asked_in_their_words(stack: Stack) -> None:
    player = player_of(stack)
    upload(player, (WAYPOINT, WAYPOINT))
    player.send(listing())
    player.send(mavlink.MAVLink_mission_request_int_message(*TARGET, 0, 0))
    replies = player.send(mavlink.MAVLink_mission_request_message(*TARGET, 1, 0))
    (line,) = (line for line in replies if line.name == "MISSION_ITEM")
    assert line.fields["frame"] == 0
    assert line.fields["x"] == pytest.approx(36.31, abs=1e-5)
    player.send(ack(0))
    assert brief(player.send(count(2))) == [("MISSION_REQUEST", 0)]
    old = mavlink.MAVLink_mission_item_message(
        *TARGET, 0, 0, 16, 0, 1, 0, 0, 0, 0, 36.31, -84.19, 400
    )
    assert brief(player.send(old)) == [("MISSION_REQUEST", 1)]


# Clearing, lists that are not there, and their targets ------------------------------------------


def test_clearing_and_what_there_is_no_list_for() -> None:
    player = player_of(PLANE)
    upload(player, line_of(3))
    assert brief(player.send(clear(255))) == [("MISSION_ACK", 3)]
    assert brief(player.send(clear(7))) == [("MISSION_ACK", 3)]
    assert brief(player.send(clear())) == [("MISSION_ACK", 0)]
    assert (read(player), current(player)["total"]) == ([], 0)
    player = player_of(PX4)
    upload(player, line_of(3))
    assert brief(player.send(clear(255))) == [("MISSION_ACK", 0)]
    assert (read(player), current(player)["total"]) == ([], 65535)
    assert brief(player.send(listing(7))) == [("MISSION_COUNT", 0)]
    assert texts(player.send(clear())) == ["WPM: IGN CLEAR CMD: Busy"]


def test_ardupilot_in_auto_refuses_to_clear_but_takes_no_items_for_an_answer() -> None:
    player = player_of(PLANE)
    upload(player, line_of(4))
    player.send(command(400, 1.0))
    player.send(command(176, 1.0, 10.0))
    assert brief(player.send(clear())) == [("MISSION_ACK", 1)]
    assert brief(player.send(count(0))) == [("MISSION_ACK", 0)]
    reported = current(player)
    assert (reported["seq"], reported["total"]) == (1, 0)
    assert player.mock.flight.mode == "mission"


def test_px4_without_a_mission_loiters() -> None:
    player = player_of(PX4)
    upload(player, line_of(4))
    player.send(command(176, 1.0, 4.0, 4.0))
    player.send(command(400, 1.0))
    replies = player.send(clear())
    assert brief(replies) == [("MISSION_ACK", 0)]
    assert texts(replies) == ["No valid mission available, loitering"]
    assert player.mock.flight.mode == "hold"
