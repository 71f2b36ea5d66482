"""Reports of the mock about a mission in flight."""

from autopilot_bridge.items import MissionItem, takeoff
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.stacks.stacks import Stack
from tests.bridge.helpers import HOME, line_of
from tests.bridge.mock_exchange import (
    COPTER,
    PLANE,
    PX4,
    command,
    count,
    item,
    player_of,
    texts,
    upload,
)
from tests.bridge.transcript_diff import Line
from tests.bridge.transcripts import Player

DROP = MissionItem(211, 2, 0, 0, 0.0, 1.0, 0.0)


def flown(stack: Stack, seconds: float) -> tuple[Player, list[Line]]:
    """Fly a takeoff, a waypoint, a release, two waypoints, a loiter; return the sent messages."""
    player = player_of(stack)
    first, second, *rest = line_of(4)
    home = (first,) if stack.item_0_is_home else ()
    upload(player, (*home, takeoff(*HOME[:2], 330.0), first, DROP, second, *rest))
    mock: MockAutopilot = player.mock
    player.send(command(400, 1.0))
    if stack.name == "px4":
        player.send(command(176, 1.0, 4.0, 4.0))
    else:
        player.send(command(176, 1.0, float(mock.stack.mission_mode)))
    begun = player.received
    return player, begun + player.listen(seconds)


def reached(lines: list[Line]) -> list[int]:
    return [line.fields["seq"] for line in lines if line.name == "MISSION_ITEM_REACHED"]


def test_px4_reports_a_release_in_place_of_the_waypoint_before_it_and_reports_all_again() -> None:
    items = reached(flown(PX4, 180.0)[1])
    assert list(dict.fromkeys(items)) == [0, 2, 3, 4]
    assert items.count(0) <= 11
    assert items[-11:] == [4] * 11


def test_ardupilot_reports_waypoints_once_and_names_what_it_begins() -> None:
    lines = flown(PLANE, 180.0)[1]
    assert reached(lines) == [1, 2, 4, 5]
    assert texts(lines) == [
        "Mission: 1 Takeoff",
        "Mission: 2 WP",
        "Mission: 3 Gripper",
        "Gripper Released",
        "Mission: 4 WP",
        "Mission: 5 WP",
        "Mission: 6 LoitUnlim",
    ]


def test_arducopter_begins_its_item_again_at_every_change() -> None:
    player, _ = flown(COPTER, 0.5)
    lines = player.send(count(4))  # truncated from 7
    assert texts(lines) == ["Mission: 1 Takeoff", "Auto mission changed, restarted command"]
    for seq in (0, 1):
        lines = player.send(item(seq, line_of(4, 9)[seq]))
        assert "Auto mission changed, restarted command" in texts(lines)
    assert player.mock.flight.target is not None
    assert player.mock.flight.target.item.z == 409.0  # the new item, of half a mission
    player, _ = flown(PLANE, 0.5)
    assert texts(player.send(count(4))) == []
