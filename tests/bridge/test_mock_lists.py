"""Fences, rally points, progress and plan ids of the mock."""

from dataclasses import replace

import pytest

from autopilot_bridge.items import MissionItem, waypoint
from autopilot_bridge.stacks.stacks import Stack
from tests.bridge.helpers import line_of
from tests.bridge.mock_exchange import (
    PLANE,
    PX4,
    WAYPOINT,
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
    set_current,
    texts,
    upload,
)

# Fences -----------------------------------------------------------------------------------------


def fence(*corners: tuple[float, float], declared: int = 0) -> tuple[MissionItem, ...]:
    number = float(declared or len(corners))
    return tuple(
        MissionItem(5001, 0, round(lat * 1e7), round(lon * 1e7), 0.0, number)
        for lat, lon in corners
    )


ROUND_HOME = ((36.29, -84.21), (36.29, -84.18), (36.32, -84.18), (36.32, -84.21))
FAR_OFF = tuple((lat + 1.0, lon) for lat, lon in ROUND_HOME)
POINT = MissionItem(5004, 0, 363000000, -842000000, 0.0, 0.0)


@pytest.mark.parametrize(
    ("items", "words"),
    [
        (fence(*ROUND_HOME[:2]), "Invalid vertex count (2)"),
        (fence(*ROUND_HOME, declared=5), "Incorrect item count"),
        ((*fence(*ROUND_HOME), POINT), "Non-positive circle radius"),
    ],
)
def test_ardupilot_judges_a_fence_when_it_is_whole(
    items: tuple[MissionItem, ...], words: str
) -> None:
    player = player_of(PLANE)
    upload(player, fence(*ROUND_HOME), 1)
    replies = upload(player, items, 1)
    assert brief(replies) == [("MISSION_ACK", 1)]
    assert texts(replies) == [words, "Fence validation failed"]
    assert len(read(player, 1)) == 4


def test_px4_judges_a_fence_vertex_by_vertex_and_looks_at_it_later() -> None:
    player = player_of(PX4)
    player.send(count(2, 1))
    two = fence(*ROUND_HOME[:2])
    assert brief(player.send(item(0, two[0], 1))) == [("MISSION_ACK", 1)]
    assert brief(player.send(count(200, 1))) == [("MISSION_ACK", 4)]
    assert brief(upload(player, fence(*FAR_OFF), 1)) == [("MISSION_ACK", 0)]
    assert texts(player.listen(1.0)) == ["Geofence invalid, doesn't contain Home position"]


def test_px4_does_not_fly_a_mission_out_of_its_fence() -> None:
    player = player_of(PX4)
    upload(player, (WAYPOINT, waypoint(36.5, -84.2, 400.0)))
    assert current(player)["mission_state"] == 2
    upload(player, fence(*ROUND_HOME), 1)
    assert texts(player.listen(1.0)) == ["Geofence violation for waypoint 2"]
    assert current(player)["mission_state"] == 1
    # PX4 acknowledges the receipt of a mode change first, then the result.
    replies = player.send(command(176, 1.0, 4.0, 4.0))
    assert brief(replies) == [("COMMAND_ACK", 0), ("COMMAND_ACK", 1)]


@each_stack
def test_rally_points_and_fences_leave_the_mission_alone(stack: Stack) -> None:
    player = player_of(stack)
    upload(player, line_of(3))
    before = read(player)
    upload(player, fence(*ROUND_HOME), 1)
    upload(player, (MissionItem(5100, 3, 363000000, -842000000, 60.0),), 2)
    assert (len(read(player, 1)), len(read(player, 2))) == (4, 1)
    assert read(player) == before
    player.send(clear(2))
    assert (len(read(player, 1)), len(read(player, 2))) == (4, 0)


# Progress ---------------------------------------------------------------------------------------


def test_the_current_item_is_set_in_the_way_of_the_stack() -> None:
    player = player_of(PLANE)
    upload(player, line_of(4))
    assert current(player)["seq"] == 0
    player.send(set_current(2))
    assert current(player)["seq"] == 2
    assert brief(player.send(command(224, 0.0))) == [("COMMAND_ACK", 0)]
    assert current(player)["seq"] == 1
    assert brief(player.send(command(224, 9.0))) == [("COMMAND_ACK", 2)]
    assert texts(player.send(set_current(9))) == []
    player = player_of(PX4)
    upload(player, line_of(4))
    assert brief(player.send(command(224, 2.0))) == [("COMMAND_ACK", 3)]
    assert texts(player.send(set_current(9))) == ["WPM: WP CURR CMD: Not in list"]


def test_the_index_outlives_an_upload_on_ardupilot_and_the_same_plan_on_px4() -> None:
    for stack, after_other in ((PLANE, 2), (PX4, 0)):
        player = player_of(stack)
        upload(player, line_of(4))
        player.send(set_current(2))
        upload(player, line_of(4))
        assert current(player)["seq"] == 2
        upload(player, line_of(3, 5))
        assert current(player)["seq"] == after_other


def test_px4_sends_the_checksum_of_each_plan() -> None:
    player = player_of(PX4)
    first = upload(player, line_of(3))[0].fields["opaque_id"]
    other = upload(player, line_of(3, 7))[0].fields["opaque_id"]
    fence_id = upload(player, fence(*ROUND_HOME), 1)[0].fields["opaque_id"]
    assert len({0, first, other, fence_id}) == 4
    reported = current(player)
    assert (reported["mission_id"], reported["fence_id"], reported["rally_points_id"]) == (
        other,
        fence_id,
        0,
    )
    assert player.send(listing())[0].fields["opaque_id"] == other


def test_px4_accepts_a_mission_without_landing_and_then_does_not_fly_it() -> None:
    player = player_of(PX4)
    player.mock.parameters.change("MIS_TKO_LAND_REQ", 2)
    assert brief(upload(player, line_of(3))) == [("MISSION_ACK", 0)]
    assert current(player)["mission_state"] == 1
    replies = player.send(command(176, 1.0, 4.0, 4.0))
    assert brief(replies) == [("COMMAND_ACK", 0), ("COMMAND_ACK", 1)]
    assert texts(replies) == ["Landing waypoint/pattern required"]
    upload(player, (*line_of(3), replace(WAYPOINT, command=21)))
    assert brief(player.send(command(176, 1.0, 4.0, 4.0))) == 2 * [("COMMAND_ACK", 0)]
