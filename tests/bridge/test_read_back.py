"""Read-back of items, rule by rule, and as recorded in SITL if the transcripts exist."""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from autopilot_bridge.items import Items, MissionItem
from autopilot_bridge.missions.check import check
from autopilot_bridge.missions.read_back import FENCE, MISSION, RALLY, as_read_back, same_as_sent
from autopilot_bridge.stacks.stacks import STACKS, Stack, stack_named

PX4, PX4_COPTER = stack_named("px4", "plane"), stack_named("px4", "copter")
PLANE, COPTER = stack_named("ardupilot", "plane"), stack_named("ardupilot", "copter")
X, Y = 363000000, -842000000
NAN = math.nan
PARAMS = ("param1", "param2", "param3", "param4")


def item(command: int, frame: int, z: float, *params: Any) -> MissionItem:
    return MissionItem(command, frame, X, Y, z, *params)


# As in the transcripts frame_rounding and frame_terrain, and in the notes on both stacks.
READ: list[tuple[Stack, MissionItem, MissionItem]] = [
    (PLANE, item(16, 3, 50.126, 7.6, 30.4, 40.5, 91.5), item(16, 3, 50.12, 0, 30, 40, 0)),
    (COPTER, item(16, 3, 50.126, 7.6, 30.4, 40.5, 91.5), item(16, 3, 50.12, 7, 0, 0, 0)),
    (PX4, item(16, 3, 50.126, 7.6, 30.4, 40.5, 91.5), item(16, 6, 50.126, 7.6, 30.4, 0, 91.5)),
    (PLANE, item(16, 5, 350.25), item(16, 0, 350.25)),
    (PLANE, item(16, 6, 50.994), item(16, 3, 50.99)),
    (PLANE, item(16, 0, -0.996), item(16, 0, -0.99)),
    (PLANE, item(16, 11, 50.5), item(16, 10, 50.5)),
    (PLANE, item(16, 2, 50.5), item(16, 0, 50.5)),
    (PX4, item(16, 0, 350.25), item(16, 5, 350.25)),
    (PX4, item(16, 6, 50.0, 0, 0, 0, -90.0), item(16, 6, 50.0, 0, 0, 0, 270.0)),
    (PX4, item(22, 6, 40.0, 12.0, 0, 0, NAN), item(22, 6, 40.0, 0, 0, 0, NAN)),
    (PLANE, item(22, 6, 50.0, 12.0, 0, 0, NAN), item(22, 3, 50.0, 12.0, 0, 0, 0)),
    (PLANE, item(17, 3, 60.0, 0, 0, 123.7), item(17, 3, 60.0, 0, 0, 123.0)),
    (PLANE, item(17, 3, 60.0, 0, 0, -120.6), item(17, 3, 60.0, 0, 0, -120.0)),
    (PLANE, item(17, 3, 60.0, 0, 0, 70000.0), item(17, 3, 60.0, 0, 0, 4464.0)),
    (PX4, item(17, 6, 60.0, 0, 0, 70000.5), item(17, 6, 60.0, 0, 0, 70000.5)),
    (PLANE, item(18, 3, 60.0, 2.5, 0, -150.4, 1), item(18, 3, 60.0, 2.0, 0, -150.0, 1)),
    (PLANE, item(18, 3, 60.0, 3.0, 0, 333.3, 0), item(18, 3, 60.0, 3.0, 0, 330.0, 0)),
    (PLANE, item(18, 3, 60.0, 300.0, 0, 9e3, 0), item(18, 3, 60.0, 255.0, 0, 2550.0, 0)),
    (PLANE, item(18, 3, 60.0, 0.3, 0, 80.0, 5), item(18, 3, 60.0, 76 / 256, 0, 80.0, 1)),
    (PLANE, item(19, 3, 60.0, 30.6, 0, -90.7, 1), item(19, 3, 60.0, 30.0, 0, -1.0, 1)),
    (PLANE, item(19, 3, 60.0, 30.6, 0, 90.7, 0), item(19, 3, 60.0, 30.0, 0, 1.0, 0)),
    (PX4, item(19, 3, 60.0, 30.6, 0, -90.7, 1), item(19, 6, 60.0, 30.6, 0, -90.7, 1)),
    (PLANE, item(21, 3, 0.0, 7.5, 0, 0, 30.0), item(21, 3, 0.0, 7.0, 0, 0, 1.0)),
    (PLANE, item(31, 3, 60.0, 1, -80.4, 0, 1), item(31, 3, 60.0, 0, -80.0, 0, 1)),
    (PX4, item(31, 3, 60.0, 1, -80.4, 0, 1), item(31, 6, 60.0, 1, -80.4, 0, 1)),
    (PX4, item(80, 0, 60.0, 3.0), item(201, 5, 60.0, 0.0)),
    (PLANE, MissionItem(183, 2, 7, 8, 9.0, 9, 1900), MissionItem(183, 0, 0, 0, 0.0, 9, 1900)),
    (PLANE, MissionItem(203, 3, 1, 2, 9.0, 1), MissionItem(203, 0, 1, 2, 0.0, 1)),
    (PLANE, MissionItem(205, 2, 0, 0, 0.0, 9.5), MissionItem(205, 0, 0, 0, 2.0, 9.5)),
    (PX4, MissionItem(211, 2, 0, 0, 0.0, 1), MissionItem(211, 2, 0, 0, 0.0, 1)),
    (PX4, MissionItem(187, 2, 7, 8, 9.0, 0.5), MissionItem(187, 2, 7, 8, 9.0, 0.5)),
    (PLANE, item(16, 3, 60.0, 0, 0, 0, 0, 0), item(16, 3, 60.0, 0, 0, 0, 0, 1)),
    (PX4, item(16, 3, 60.0, 0, 0, 0, 0, 0), item(16, 6, 60.0, 0, 0, 0, 0, 0)),
]
OTHERS: list[tuple[Stack, int, MissionItem, MissionItem]] = [
    (PX4, FENCE, item(5001, 0, 9.0, 4), item(5001, 5, 9.0, 4, 0, 0, 0, 0)),
    (PX4, FENCE, item(5000, 3, 9.0, 4), item(5000, 5, 9.0, 0, 0, 0, 0, 0)),
    (PLANE, FENCE, item(5001, 0, 9.0, 4), item(5001, 0, 0.0, 4, 0, 0, 0, 0)),
    (PLANE, FENCE, item(5004, 3, 9.0, 40.5), item(5004, 0, 0.0, 40.5, 0, 0, 0, 0)),
    (PX4, RALLY, item(5100, 3, 60.5), item(5100, 6, 60.5)),
    (PLANE, RALLY, item(5100, 6, 60.5), item(5100, 3, 60.0, 0, 0, 0, 0, 0)),
    (COPTER, RALLY, item(5100, 0, -60.5), item(5100, 0, -60.0, 0, 0, 0, 0, 0)),
]


def close(one: MissionItem, other: MissionItem) -> bool:
    """Return whether two items are equal in single precision."""
    pairs = [(getattr(one, name), getattr(other, name)) for name in ("z", *PARAMS)]
    exact = [replace(each, z=0.0, param1=0, param2=0, param3=0, param4=0) for each in (one, other)]
    return exact[0] == exact[1] and all(
        (math.isnan(a) and math.isnan(b)) or a == pytest.approx(b, rel=2e-6, abs=1e-6)
        for a, b in pairs
    )


@pytest.mark.parametrize(
    ("stack", "mission_type", "sent", "read"),
    [*[(stack, MISSION, sent, read) for stack, sent, read in READ], *OTHERS],
)
def test_read_back_shows_what_the_stack_keeps(
    stack: Stack, mission_type: int, sent: MissionItem, read: MissionItem
) -> None:
    due = as_read_back(sent, stack, mission_type)
    assert close(due, read), due
    assert same_as_sent(sent, read, stack, mission_type)


SENT = item(17, 0, 400.0, 0, 0, -90.0)


@pytest.mark.parametrize(
    "change",
    [
        {"command": 16},
        {"frame": 3},
        {"x": X + 1},
        {"y": Y - 1},
        {"z": 400.02},
        {"param3": -91.0},
        {"param3": 90.0},
        {"param1": 1.0},
        {"param2": 1.0},
        {"param4": 1.0},
    ],
)
@pytest.mark.parametrize("stack", STACKS)
def test_another_item_is_not_taken_for_the_one_sent(stack: Stack, change: dict[str, Any]) -> None:
    read = as_read_back(SENT, stack)
    assert same_as_sent(SENT, read, stack)
    assert same_as_sent(SENT, replace(read, frame={5: 0, 0: 5}[read.frame]), stack)
    assert not same_as_sent(SENT, replace(read, **change), stack)


def test_a_nan_is_read_back_as_any_number_where_it_is_kept() -> None:
    sent = item(16, 3, 60.0, 0, 0, 0, NAN)
    assert same_as_sent(sent, item(16, 6, 60.0, 0, 0, 0, 12.0), PX4)
    assert not same_as_sent(sent, item(16, 3, 60.0, 0, 0, 0, 12.0), PLANE)


# Transcripts ----------------------------------------------------------------------------------

TRANSCRIPTS = Path("/work/shared/data/transcripts")
NAMES = {"arduplane": PLANE, "arducopter": COPTER, "px4_fixedwing": PX4}
NAMES["px4_multicopter"] = PX4_COPTER
# Transfers that end for other reasons than the items, such as an abort or an interruption.
ABOUT_ITEMS = (
    "fence_bad",
    "fence_ok",
    "frame_rounding",
    "frame_terrain",
    "rally_ok",
    "takeoff_loiter_drop",
    "too_many",
    "upload_feasibility_rejected",
    "upload_loiter_turns_rejected",
    "upload_ok",
    "upload_rejected_frame",
    "upload_rejected_item",
)


@dataclass
class Transfer:
    """One upload or download in a transcript."""

    mission_type: int
    count: int
    up: bool
    items: list[MissionItem]
    ack: int | None = None


def transfers(path: Path) -> Iterator[Transfer]:
    """Return the transfers of client A in a transcript, in order."""
    exchange: Transfer | None = None
    for line in path.read_text(encoding="utf-8").splitlines():
        entry = json.loads(line)
        if entry.get("link") != "A":
            continue
        fields = entry["fields"]
        match entry["msg"]:
            case "MISSION_COUNT":
                up = entry["dir"] == "tx"
                exchange = Transfer(fields["mission_type"], fields["count"], up, [])
            case "MISSION_ITEM_INT" if exchange:
                names = ("command", "frame", "x", "y", "z", *PARAMS, "autocontinue")
                values: dict[str, Any] = {
                    name: NAN if fields[name] is None else fields[name] for name in names
                }
                exchange.items.append(MissionItem(**values))
            case "MISSION_ACK" if exchange:
                exchange.ack = fields["type"]
                yield exchange
                exchange = None


def own(transfer: Transfer, stack: Stack) -> Items:
    """Return the user's items, without ArduPilot's home."""
    home = stack.item_0_is_home and transfer.mission_type == MISSION
    return tuple(transfer.items[int(home) :])


def recorded() -> list[Any]:
    found = [
        (name, case)
        for name in NAMES
        for case in ABOUT_ITEMS
        if (TRANSCRIPTS / name / f"{case}.jsonl").is_file()
    ]
    return found or [pytest.param("", "", marks=pytest.mark.skip(reason="no transcripts"))]


@pytest.mark.parametrize(("name", "case"), recorded())
def test_the_check_and_the_autopilot_report_the_same(name: str, case: str) -> None:
    stack = NAMES[name]
    uploads = [each for each in transfers(TRANSCRIPTS / name / f"{case}.jsonl") if each.up]
    assert uploads
    for upload in uploads:
        items = own(upload, stack)
        if case == "too_many":
            items = (item(16, 3, 60.0),) * upload.count
        kinds = {problem.kind for problem in check(items, stack, upload.mission_type)}
        assert ("refused" in kinds) == (upload.ack != 0), (upload, kinds)


@pytest.mark.parametrize(("name", "case"), recorded())
def test_read_back_is_as_recorded(name: str, case: str) -> None:
    stack = NAMES[name]
    held: dict[int, Transfer] = {}
    for transfer in transfers(TRANSCRIPTS / name / f"{case}.jsonl"):
        if transfer.up:
            held.pop(transfer.mission_type, None)
            if transfer.ack == 0:
                held[transfer.mission_type] = transfer
        elif transfer.mission_type in held and transfer.count:
            sent = own(held[transfer.mission_type], stack)
            read = own(transfer, stack)
            assert len(sent) == len(read)
            for ours, theirs in zip(sent, read, strict=True):
                due = as_read_back(ours, stack, transfer.mission_type)
                assert close(due, theirs), (ours, due, theirs)
                assert same_as_sent(ours, theirs, stack, transfer.mission_type)
