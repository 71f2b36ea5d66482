"""Short exchanges with a mock: messages to the mock, and its replies in short form."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem, waypoint
from autopilot_bridge.links.codec import item_message
from autopilot_bridge.stacks.stacks import STACKS, Stack, stack_named
from tests.bridge.helpers import mock_of
from tests.bridge.transcript_diff import EXCHANGE, Line
from tests.bridge.transcripts import Player

PX4, PLANE = stack_named("px4", "plane"), stack_named("ardupilot", "plane")
COPTER = stack_named("ardupilot", "copter")
TARGET = (1, 1)
OTHER = (254, 190)
UNKNOWN = MissionItem(31000, 2, 0, 0, 0.0)
WAYPOINT = waypoint(36.31, -84.19, 400.0)
# test_vtols.py tests VTOLs: a quadplane climbs by the altitude of a takeoff above its position.
NOT_VTOLS = [stack for stack in STACKS if not stack.vtol]
each_stack = pytest.mark.parametrize("stack", NOT_VTOLS, ids=lambda s: f"{s.name}-{s.vehicle}")


def player_of(stack: Stack) -> Player:
    player = Player(mock_of(stack))
    player.listen(1.0)
    return player


def count(number: int, mission_type: int = 0) -> Any:
    return mavlink.MAVLink_mission_count_message(*TARGET, number, mission_type)


def item(seq: int, one: MissionItem, mission_type: int = 0) -> Any:
    return item_message(TARGET, seq, one, 0, mission_type)


def ack(code: int, mission_type: int = 0) -> Any:
    return mavlink.MAVLink_mission_ack_message(*TARGET, code, mission_type)


def listing(mission_type: int = 0) -> Any:
    return mavlink.MAVLink_mission_request_list_message(*TARGET, mission_type)


def clear(mission_type: int = 0) -> Any:
    return mavlink.MAVLink_mission_clear_all_message(*TARGET, mission_type)


def command(number: int, *params: float) -> Any:
    filled = (*params, *([0.0] * (7 - len(params))))
    return mavlink.MAVLink_command_long_message(*TARGET, number, 0, *filled)


def brief(lines: list[Line]) -> list[tuple[str, int]]:
    """Return the exchange; each message is shortened to its decisive number."""
    keys = ("type", "result", "seq", "count")
    return [
        (line.name, next(line.fields[key] for key in keys if key in line.fields))
        for line in lines
        if line.name in EXCHANGE
    ]


def texts(lines: list[Line]) -> list[str]:
    return [line.fields["text"].strip() for line in lines if line.name == "STATUSTEXT"]


def upload(player: Player, items: tuple[MissionItem, ...], mission_type: int = 0) -> list[Line]:
    """Upload a mission as requested; return the replies to the last item."""
    replies = player.send(count(len(items), mission_type))
    for _ in range(len(items)):
        asked = [line for line in replies if line.name.startswith("MISSION_REQUEST")]
        if not asked:
            break
        seq = asked[-1].fields["seq"]
        replies = player.send(item(seq, items[seq], mission_type))
    return replies


def read(player: Player, mission_type: int = 0) -> list[MissionItem]:
    """Download a mission, and acknowledge it at the end."""
    (counted,) = (x for x in player.send(listing(mission_type)) if x.name == "MISSION_COUNT")
    found = []
    for seq in range(counted.fields["count"]):
        asks = mavlink.MAVLink_mission_request_int_message(*TARGET, seq, mission_type)
        (line,) = (x for x in player.send(asks) if x.name == "MISSION_ITEM_INT")
        names = MissionItem.__dataclass_fields__
        found.append(MissionItem(**{name: line.fields[name] for name in names}))
    player.send(ack(0, mission_type))
    return found


def current(player: Player) -> dict[str, Any]:
    reported = [line for line in player.listen(1.2) if line.name == "MISSION_CURRENT"]
    return reported[-1].fields


def set_current(seq: int) -> Any:
    return mavlink.MAVLink_mission_set_current_message(*TARGET, seq)
