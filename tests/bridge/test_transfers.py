"""Uploads and downloads between client and mock, over good and lossy links."""

from collections import Counter
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Codec, Message, item_message
from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.missions.download import MissionDownload
from autopilot_bridge.missions.read_back import as_read_back
from autopilot_bridge.missions.transfer import Address, TransferResult, TransferTiming
from autopilot_bridge.missions.upload import MissionUpload
from autopilot_bridge.stacks.stacks import STACKS, Stack, stack_named
from autopilot_bridge.vehicle.client_events import MissionProgress
from tests.bridge.helpers import SECOND, Noting, Pair, line_of, mock_of

Items = tuple[MissionItem, ...]
PX4, ARDUPILOT = stack_named("px4", "plane"), stack_named("ardupilot", "plane")
each_stack = pytest.mark.parametrize("stack", STACKS, ids=lambda s: f"{s.name}-{s.kind}")
both = pytest.mark.parametrize("stack", [PX4, ARDUPILOT], ids=lambda s: s.name)


class Choosy(MemoryLink):
    """A link that loses the frames that ``drop`` selects by message name and count."""

    def __init__(self, drop: Any) -> None:
        super().__init__()
        self._drop = drop
        self._codec = Codec(1, 1)

    def send(self, datagram: bytes, now_us: int) -> None:
        names = [message.get_type() for message in self._codec.decode(datagram)]
        if not any(self._drop(name) for name in names):
            super().send(datagram, now_us)


def held(pair: Pair) -> tuple[MissionItem, ...]:
    """Return the items of the mock, without ArduPilot's home."""
    return tuple(pair.mock.missions.items[1 if pair.mock.stack.item_0_is_home else 0 :])


def kept(items: Items, stack: Stack) -> tuple[MissionItem, ...]:
    """Return the items that the mock should store for the sent items."""
    return tuple(as_read_back(item, stack) for item in items)


def upload(pair: Pair, items: Items, by_file: bool = False, **more: Any) -> int:
    """Upload item by item, unless requested otherwise."""
    return pair.client.upload(items, pair.now_us, by_file=by_file, **more)


def connected(stack: Stack, **more: Any) -> Pair:
    pair = Pair(mock_of(stack), **more)
    pair.run_for(1.0)
    return pair


@each_stack
def test_an_uploaded_mission_is_held_and_read_back_as_sent(stack: Stack) -> None:
    pair = connected(stack)
    sent = line_of(12)
    result = pair.result_of(upload(pair, sent))
    assert result.outcome == "accepted"
    assert held(pair) == kept(sent, stack)
    read = pair.result_of(pair.client.download(pair.now_us, by_file=False))
    assert read.items is not None
    assert read.items == kept(sent, stack)


@each_stack
def test_a_cleared_mission_is_empty(stack: Stack) -> None:
    pair = connected(stack)
    pair.result_of(upload(pair, line_of(5)))
    assert pair.result_of(pair.client.clear(pair.now_us)).outcome == "accepted"
    assert held(pair) == ()
    assert pair.result_of(pair.client.download(pair.now_us, by_file=False)).items == ()


@both
def test_a_refused_item_is_named_with_the_reason(stack: Stack) -> None:
    pair = connected(stack)
    bad = MissionItem(command=31000, frame=0, x=0, y=0, z=0.0)
    result = pair.result_of(upload(pair, (*line_of(3), bad)))
    assert result.outcome == "rejected"
    assert result.code == mavlink.MAV_MISSION_UNSUPPORTED
    assert result.seq == (4 if stack.item_0_is_home else 3)
    assert "not supported" in result.reason


def test_after_a_refused_upload_px4_holds_the_old_mission_and_ardupilot_a_mixture() -> None:
    bad = MissionItem(command=31000, frame=0, x=0, y=0, z=0.0)
    new = (*line_of(3, first=9)[:2], bad)
    for stack, keeps in ((PX4, True), (ARDUPILOT, False)):
        pair = connected(stack)
        pair.result_of(upload(pair, line_of(6)))
        pair.result_of(upload(pair, new))
        assert (held(pair) == kept(line_of(6), pair.mock.stack)) == keeps


def test_a_mission_too_long_is_refused_in_words() -> None:
    pair = connected(ARDUPILOT)
    result = pair.result_of(upload(pair, line_of(700)))
    assert (result.outcome, result.code) == ("rejected", mavlink.MAV_MISSION_NO_SPACE)


@both
def test_a_lost_acknowledgement_is_resolved_by_reading_back(stack: Stack) -> None:
    pair = connected(stack, down=Choosy(lambda name: name == "MISSION_ACK"))
    result = pair.result_of(upload(pair, line_of(6)))
    assert result.outcome == "accepted"
    assert held(pair) == kept(line_of(6), pair.mock.stack)


@both
def test_a_silent_autopilot_is_a_failure_in_bounded_time(stack: Stack) -> None:
    pair = connected(stack, down=Choosy(lambda name: name.startswith("MISSION_REQUEST")))
    result = pair.result_of(upload(pair, line_of(6)), within_s=20.0)
    assert result.outcome in ("failed", "rejected")


@both
@pytest.mark.parametrize(
    "lost",
    [
        "MISSION_COUNT",
        "MISSION_REQUEST",
        "MISSION_ITEM_INT",
        "MISSION_ACK",
        "MISSION_CURRENT",
        "MISSION_SET_CURRENT",
    ],
)
def test_any_one_message_may_get_lost(stack: Stack, lost: str) -> None:
    seen: dict[str, int] = {}

    def second_of_its_kind(name: str) -> bool:
        kind = "MISSION_REQUEST" if name.startswith("MISSION_REQUEST") else name
        seen[kind] = seen.get(kind, 0) + 1
        return kind == lost and seen[kind] == (2 if lost in ("MISSION_ITEM_INT",) else 1)

    pair = connected(stack, up=Choosy(second_of_its_kind), down=Choosy(second_of_its_kind))
    result = pair.result_of(upload(pair, line_of(6)))
    assert result.outcome == "accepted"
    assert held(pair) == kept(line_of(6), pair.mock.stack)


links: st.SearchStrategy[dict[str, Any]] = st.builds(
    dict,
    loss=st.floats(0.0, 0.3),
    delay_us=st.integers(0, 200_000),
    jitter_us=st.integers(0, 150_000),
    duplication=st.floats(0.0, 0.3),
    seed=st.integers(0, 2**32),
)


class Watched(MemoryLink):
    """A link that records the names of lost messages."""

    def __init__(self, lost: set[str], **more: Any) -> None:
        super().__init__(**more)
        self._lost_names = lost
        self._codec = Codec(1, 1)

    def send(self, datagram: bytes, now_us: int) -> None:
        before = len(self._in_transit)
        super().send(datagram, now_us)
        if len(self._in_transit) == before:
            self._lost_names |= {message.get_type() for message in self._codec.decode(datagram)}


def agrees(result: TransferResult, old: Items, new: Items, now: Items, stack: Stack) -> bool:
    """Return whether a result agrees with the vehicle's mission."""
    match result.holds:
        case "the new one":
            return now == new
        case "the old one":
            return result.outcome != "accepted" and now == old
        case "one of both":
            return result.outcome != "accepted" and now in (old, new)
        case "a mixture":
            reported = result.outcome in ("failed", "rejected") and result.items == now
            return reported and set(now) <= {*old, *new}
        case _:
            return result.outcome in ("unknown", "failed", "rejected") and not stack.atomic_upload


LOST: set[str] = set()


@pytest.mark.parametrize(
    "hundred", [0, 1, 2, *(pytest.param(each, marks=pytest.mark.long) for each in range(3, 10))]
)
def test_over_a_bad_link_an_upload_ends_and_reports_what_the_vehicle_holds(hundred: int) -> None:
    outcomes = Counter[str]()
    for seed in range(100 * hundred, 100 * hundred + 100):
        rng = Random(seed)
        stack, count = rng.choice(STACKS), rng.randint(1, 15)
        old, new = line_of(7, first=3), line_of(count)
        pair = connected(stack)
        pair.result_of(upload(pair, old))
        pair.up, pair.down = (
            Watched(
                LOST,
                loss=rng.uniform(0.0, 0.3),
                delay_us=rng.randrange(200_000),
                jitter_us=rng.randrange(150_000),
                duplication=rng.uniform(0.0, 0.3),
                seed=rng.getrandbits(32),
            )
            for _ in range(2)
        )
        transfer_id = upload(pair, new, rng.random() < 0.5, check=rng.random() < 0.5)
        result = pair.result_of(transfer_id, within_s=200.0)
        pair.run_for(10.0)  # messages in transit must not change it either
        now = held(pair)
        assert agrees(result, kept(old, stack), kept(new, stack), now, stack), (
            seed,
            result,
            held(pair),
        )
        outcomes[result.outcome] += 1
    assert outcomes["accepted"] >= 80


def test_over_those_bad_links_every_kind_of_message_was_lost() -> None:
    if not LOST:
        pytest.skip("the schedules ran with another backend")
    assert {
        "MISSION_COUNT",
        "MISSION_REQUEST",
        "MISSION_REQUEST_INT",
        "MISSION_ITEM_INT",
        "MISSION_ACK",
        "MISSION_CURRENT",
        "COMMAND_LONG",
        "COMMAND_ACK",
        "MISSION_REQUEST_LIST",
        "FILE_TRANSFER_PROTOCOL",
        "HEARTBEAT",
    } <= LOST


@settings(max_examples=60)
@given(st.sampled_from(STACKS), links, links)
def test_over_any_link_a_download_ends_and_success_means_the_mission_was_read(
    stack: Stack, up: dict[str, Any], down: dict[str, Any]
) -> None:
    pair = connected(stack)
    pair.result_of(upload(pair, line_of(8)))
    pair.up, pair.down = MemoryLink(**up), MemoryLink(**down)
    result = pair.result_of(pair.client.download(pair.now_us, by_file=False))
    assert result.outcome in ("accepted", "failed", "rejected")
    if result.outcome == "accepted":
        assert result.items is not None
        assert result.items == kept(line_of(8), stack)


@each_stack
@pytest.mark.parametrize("lost_s", [8, 14])
def test_a_download_that_the_autopilot_has_ended_begins_again(stack: Stack, lost_s: int) -> None:
    """PX4 ends a download after 5 s without a message, and ignores later requests for items."""
    pair = connected(stack)
    pair.result_of(upload(pair, line_of(8)))
    lost_until_us = 0

    def lost(name: str) -> bool:
        nonlocal lost_until_us
        if name == "MISSION_REQUEST_INT" and not lost_until_us:
            lost_until_us = pair.now_us + lost_s * SECOND
        return pair.now_us < lost_until_us

    pair.up = Choosy(lost)
    result = pair.result_of(pair.client.download(pair.now_us, by_file=False))
    assert result.outcome == "accepted"
    assert result.items == kept(line_of(8), stack)


def test_a_download_of_which_no_item_arrives_fails() -> None:
    pair = connected(PX4)
    pair.result_of(upload(pair, line_of(8)))
    pair.up = Choosy(lambda name: name == "MISSION_REQUEST_INT")
    began_us = pair.now_us
    result = pair.result_of(pair.client.download(pair.now_us, by_file=False))
    assert result.outcome == "failed"
    assert pair.now_us - began_us < 90 * SECOND


def test_a_last_item_that_never_arrived_is_not_taken_for_success() -> None:
    items = 0

    def last_item(name: str) -> bool:
        nonlocal items
        items += name == "MISSION_ITEM_INT"
        return name == "MISSION_ITEM_INT" and items >= 6

    pair = connected(PX4, up=Choosy(last_item))
    result = pair.result_of(upload(pair, line_of(6)))
    assert result.outcome == "failed"
    assert held(pair) == ()


def stray(codec: Codec, target: tuple[int, int], mission_type: int) -> bytes:
    refusal = mavlink.MAV_MISSION_ERROR
    return codec.encode(mavlink.MAVLink_mission_ack_message(*target, refusal, mission_type))


@pytest.mark.parametrize(
    ("source", "target", "mission_type"),
    [
        ((1, 1), (255, 190), 1),
        ((1, 1), (254, 190), 0),
        ((1, 5), (255, 190), 0),
        ((9, 1), (255, 190), 0),
    ],
    ids=["another type", "another station", "another component", "another vehicle"],
)
def test_a_stray_acknowledgement_ends_nothing(
    source: tuple[int, int], target: tuple[int, int], mission_type: int
) -> None:
    pair = connected(PX4, down=Choosy(lambda name: name.startswith("MISSION_REQUEST")))
    upload(pair, line_of(4))
    pair.run_for(0.5)
    pair.client.receive_data(stray(Codec(*source), target, mission_type), pair.now_us)
    pair.run_for(0.5)
    assert all("Transfer" not in type(event).__name__ for event in pair.events)


def test_a_late_item_of_the_upload_before_does_not_end_an_upload_to_px4() -> None:
    """PX4 answers each such item with an error, which may arrive after MISSION_COUNT."""
    pair = connected(PX4)
    old, new = line_of(6), line_of(6, first=5)
    pair.result_of(upload(pair, old))
    late = Codec(255, 190).encode(item_message((1, 1), 2, old[2], 0, 0))
    pair.down = MemoryLink(delay_us=200_000)
    pair.up = MemoryLink()
    pair.up.send(late, pair.now_us)
    transfer_id = upload(pair, new)
    result = pair.result_of(transfer_id, within_s=10.0)
    assert result.outcome == "accepted"
    assert held(pair) == kept(new, PX4)


def test_an_upload_to_px4_succeeds_although_an_error_of_the_upload_before_arrives() -> None:
    """The first MISSION_COUNT is lost, and a late error of the previous upload arrives."""
    counts = 0

    def first_count(name: str) -> bool:
        nonlocal counts
        counts += name == "MISSION_COUNT"
        return name == "MISSION_COUNT" and counts == 1

    pair = connected(PX4, up=Choosy(first_count))
    transfer_id = upload(pair, line_of(6))
    pair.run_for(0.2)
    pair.client.receive_data(stray(Codec(1, 1), (255, 190), 0), pair.now_us)
    assert pair.result_of(transfer_id).outcome == "accepted"
    assert held(pair) == kept(line_of(6), PX4)


def test_an_upload_that_px4_refuses_with_an_error_is_rejected_after_the_retries() -> None:
    pair = connected(PX4, up=Choosy(lambda name: name == "MISSION_COUNT"))
    transfer_id = upload(pair, line_of(6))
    pair.run_for(0.2)
    pair.client.receive_data(stray(Codec(1, 1), (255, 190), 0), pair.now_us)
    result = pair.result_of(transfer_id)
    assert (result.outcome, result.code) == ("rejected", mavlink.MAV_MISSION_ERROR)


@each_stack
@pytest.mark.parametrize("after_items", [0, 1, 4])
def test_a_cancelled_upload_has_really_ended(stack: Stack, after_items: int) -> None:
    items = 0

    def cut(name: str) -> bool:
        nonlocal items
        items += name == "MISSION_ITEM_INT"
        return name == "MISSION_ITEM_INT" and items > after_items

    pair = connected(stack)
    old, new = line_of(6, first=5), line_of(6)
    pair.result_of(upload(pair, old))
    pair.up = Choosy(cut)
    transfer_id = upload(pair, new)
    pair.run_for(0.2)
    pair.up = MemoryLink()
    pair.client.cancel(transfer_id, pair.now_us)
    result = pair.result_of(transfer_id, within_s=20.0)
    assert result.outcome == "cancelled"
    before = held(pair)
    pair.run_for(15.0)
    assert held(pair) == before
    assert (result.holds == "the old one") == stack.atomic_upload
    assert before == (result.items or old)
    # The next transfer is not disturbed.
    assert pair.result_of(upload(pair, new), within_s=5.0).holds == "the new one"


@pytest.mark.parametrize("replies", [True, False])
def test_a_cancelled_upload_to_ardupilot_without_a_request_may_have_cut_the_mission(
    replies: bool,
) -> None:
    pair = connected(ARDUPILOT)
    pair.result_of(upload(pair, line_of(8)))
    up, down = pair.up, pair.down = Noting(), Noting()
    down.cut = True
    transfer_id = upload(pair, line_of(2, first=9))
    pair.run_for(1.0)
    up.cut, down.cut = not replies, not replies
    if replies:  # ArduPilot has ended the transfer, and repeats no request
        pair.mock.missions.forget_transfers()
        code = int(mavlink.MAV_MISSION_OPERATION_CANCELLED)
        pair.client.cancel(transfer_id, pair.now_us)
        pair.mock.send_message(mavlink.MAVLink_mission_ack_message(255, 190, code, 0))
    else:
        pair.client.cancel(transfer_id, pair.now_us)
    result = pair.result_of(transfer_id)
    assert (result.outcome, len(held(pair))) == ("cancelled", 2)
    assert result.holds == ("a mixture" if replies else "not known")


def test_a_transfer_that_waits_is_cancelled_at_once() -> None:
    pair = connected(PX4)
    upload(pair, line_of(5))
    waiting = pair.client.download(pair.now_us, by_file=False)
    pair.client.cancel(waiting, pair.now_us)
    assert pair.result_of(waiting, within_s=2.0).outcome == "cancelled"


@each_stack
@pytest.mark.parametrize(("begin", "expected"), [("restart", 0), ("keep", 3), (2, 2), (99, 5)])
def test_a_new_mission_begins_at_its_start_item(stack: Stack, begin: Any, expected: int) -> None:
    pair = connected(stack)
    pair.result_of(upload(pair, line_of(6), begin=3))
    pair.result_of(upload(pair, line_of(6, first=2), begin=begin))
    pair.run_for(2.0)
    assert pair.of(MissionProgress)[-1].current_seq == expected


def test_a_newer_mission_takes_the_place_of_one_that_waits() -> None:
    pair = connected(PX4)
    ids = [upload(pair, line_of(5, first)) for first in range(3)]
    outcomes = [pair.result_of(transfer_id).outcome for transfer_id in ids]
    assert outcomes == ["accepted", "superseded", "accepted"]
    assert held(pair) == kept(line_of(5, 2), pair.mock.stack)


def test_an_ardupilot_upload_left_alone_is_cancelled_after_eight_seconds() -> None:
    pair = connected(ARDUPILOT, up=Choosy(lambda name: name == "MISSION_ITEM_INT"))
    result = pair.result_of(upload(pair, line_of(4)), within_s=30.0)
    assert result.code == mavlink.MAV_MISSION_OPERATION_CANCELLED
    assert 7.5 < pair.now_us / SECOND < 12.0


LANDING = (
    MissionItem(189, 2, 0, 0, 0.0),
    MissionItem(31, 3, 363_000_000, -841_900_000, 50.0, 1.0, 90.0, 0.0, 1.0),
    MissionItem(21, 3, 363_000_000, -842_000_000, 0.0),
)


@pytest.mark.parametrize("lands", [True, False])
def test_a_mission_that_px4_acknowledges_and_will_not_fly_is_a_failure(lands: bool) -> None:
    mock = mock_of(stack_named("px4", "plane"), landing_required=2)
    pair = Pair(mock)
    pair.run_for(1.0)
    result = pair.result_of(upload(pair, (*line_of(5), *LANDING) if lands else line_of(5)))
    assert result.holds == "the new one"
    assert result.outcome == ("accepted" if lands else "rejected")
    assert ("does not accept it for flight" in result.reason) != lands


def test_items_go_ahead_of_the_requests_until_one_is_asked_for_again() -> None:
    address = Address((255, 190), (1, 1), 0)
    job = MissionUpload(address, line_of(12), 0, TransferTiming(), ahead=3)
    codec = Codec(1, 1)

    def asked(seq: int) -> list[int]:
        request = mavlink.MAVLink_mission_request_int_message(255, 190, seq, 0)
        (message,) = codec.decode(codec.encode(request))
        return [item.seq for item in job.receive(message, 0)]

    job.start(0)
    assert [asked(seq) for seq in (0, 1, 2)] == [[0, 1, 2, 3], [4], [5]]
    assert asked(2) == [2]  # it was lost, with the messages behind it
    assert [asked(seq) for seq in (3, 4, 11)] == [[3], [4], [11]]


def test_a_mission_with_items_ahead_survives_the_loss_of_any_item() -> None:
    for number in range(12):
        pair = connected(PX4)
        seen = Counter[str]()

        def nth(name: str, seen: Counter[str] = seen, number: int = number) -> bool:
            seen[name] += 1
            return name == "MISSION_ITEM_INT" and seen[name] == number + 1

        pair.up = Choosy(nth)
        sent = line_of(12)
        assert pair.result_of(upload(pair, sent)).outcome == "accepted"
        assert held(pair) == kept(sent, PX4)


def test_a_lost_acknowledgement_is_resolved_by_the_plans_id_without_reading_back() -> None:
    asked: list[str] = []

    def sent(name: str) -> bool:
        asked.append(name)
        return False

    pair = connected(PX4, up=Choosy(sent), down=Choosy(lambda name: name == "MISSION_ACK"))
    began_us = pair.now_us
    result = pair.result_of(upload(pair, line_of(6)))
    assert (result.outcome, result.holds) == ("accepted", "the new one")
    assert "MISSION_REQUEST_LIST" not in asked
    assert pair.now_us - began_us < 4 * SECOND
    assert held(pair) == kept(line_of(6), PX4)


@each_stack
@pytest.mark.parametrize("duplication", [0.0, 0.3, 1.0])
def test_an_upload_over_a_slow_link_is_read_back(stack: Stack, duplication: float) -> None:
    # With a round trip above 1 s, ArduPilot requests items twice, and answers the copy of the last
    # item with an error, which arrives while the mission is being read back.
    for seed in range(3):
        up, down = (
            MemoryLink(delay_us=600_000, duplication=duplication, seed=2 * seed + way)
            for way in range(2)
        )
        pair = connected(stack, up=up, down=down)
        pair.run_for(4.0)
        result = pair.result_of(upload(pair, line_of(5), check=True))
        assert (result.outcome, result.holds) == ("accepted", "the new one"), result.reason
        assert held(pair) == kept(line_of(5), stack)


def test_a_download_fails_if_the_error_returns_after_a_repeat() -> None:
    def error(code: int, mission_type: int = 0) -> Message:
        message = mavlink.MAVLink_mission_ack_message(255, 190, code, mission_type)
        (received,) = Codec(255, 190).decode(Codec(1, 1).encode(message))
        return received

    download = MissionDownload(Address((255, 190), (1, 1)), TransferTiming())
    (request,) = download.start(0)
    for code in (mavlink.MAV_MISSION_ERROR, mavlink.MAV_MISSION_INVALID_SEQUENCE):
        assert download.receive(error(code), 100_000) == []
    assert download.result is None
    assert download.handle_timer(1_500_000) == [request]
    assert download.receive(error(mavlink.MAV_MISSION_ERROR), 1_600_000) == []
    assert download.result is not None
    assert download.result.outcome == "rejected"
    denied = MissionDownload(Address((255, 190), (1, 1)), TransferTiming())
    denied.start(0)
    denied.receive(error(mavlink.MAV_MISSION_DENIED), 100_000)
    assert denied.result is not None  # no reply to an item


@pytest.mark.parametrize("stack", [PX4, stack_named("px4", "copter")])
def test_a_return_cancels_uploads_of_missions_to_px4(stack: Stack) -> None:
    # PX4 1.17 returns by its mission: it flew a mission that arrived during its return.
    pair = connected(stack)
    old = line_of(6, first=5)
    pair.result_of(upload(pair, old))
    active, waiting = upload(pair, line_of(400)), upload(pair, line_of(30))
    pair.run_for(0.05)
    pair.client.command("return", pair.now_us)
    assert pair.result_of(waiting).outcome == "cancelled"
    result = pair.result_of(active, within_s=10.0)
    assert (result.outcome, result.holds) == ("cancelled", "the old one")
    pair.run_for(5.0)
    assert held(pair) == kept(old, stack)
    assert pair.result_of(upload(pair, line_of(7)), within_s=5.0).holds == "the new one"


def test_a_return_leaves_uploads_to_ardupilot() -> None:
    # A cancelled upload would leave parts of two missions; ArduPilot returns without its mission.
    pair = connected(ARDUPILOT)
    pair.result_of(upload(pair, line_of(6, first=5)))
    active = upload(pair, line_of(200))
    pair.run_for(0.1)
    pair.client.command("return", pair.now_us)
    assert pair.result_of(active, within_s=10.0).holds == "the new one"
