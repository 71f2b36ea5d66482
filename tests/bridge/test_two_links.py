"""A vehicle over two links at once: duplicates, the link in use, transfers, loss of both links."""

from collections import Counter
from itertools import pairwise

import pytest

from autopilot_bridge.missions.read_back import as_read_back
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.stacks.stacks import Stack, stack_named
from autopilot_bridge.vehicle.client_events import (
    CommandFinished,
    Connected,
    LinkLost,
    LinkRestored,
    LinksChanged,
    ModeChanged,
    Position,
    Rebooted,
    SameSystemId,
    Text,
)
from tests.bridge.helpers import SECOND, line_of, mock_of
from tests.bridge.two_links import LTE, RADIO, TwoLinks, lines

PX4, PLANE = stack_named("px4", "plane"), stack_named("ardupilot", "plane")
both = pytest.mark.parametrize("stack", [PX4, PLANE], ids=lambda s: s.name)
routed = pytest.mark.parametrize("is_routed", [False, True], ids=["two channels", "a router"])


def held(mock: MockAutopilot) -> tuple[object, ...]:
    return tuple(mock.missions.items[1 if mock.stack.item_0_is_home else 0 :])


def connected(stack: Stack, loss: float = 0.0, is_routed: bool = False, **late: int) -> TwoLinks:
    pair = [lines(1, loss), lines(11, loss, **late)]
    air = TwoLinks(mock_of(stack), pair, is_routed)
    air.run_for(6.0)
    return air


@both
@routed
def test_what_arrives_over_both_links_is_used_once(stack: Stack, is_routed: bool) -> None:
    one = TwoLinks(mock_of(stack), [lines(1)])
    two = connected(stack, is_routed=is_routed, delay_us=300_000)
    one.run_for(6.0)
    for air in (one, two):
        air.result_of(air.client.upload(line_of(5), air.now_us))
        air.client.command("hold", air.now_us)
        air.mock.flight.texts.append((4, "Low battery"))
        air.run_for(20.0)
    numbers = [Counter(type(event).__name__ for event in air.events) for air in (one, two)]
    for name in ("Text", "CommandFinished", "TransferFinished", "ModeChanged", "Connected"):
        assert numbers[0][name] == numbers[1][name], name
    assert len(two.of(Text)) >= 1
    assert abs(numbers[0]["Position"] - numbers[1]["Position"]) <= 3
    for kind in (Rebooted, LinkLost, SameSystemId):
        assert not two.of(kind)
    assert two.states == ("up", "up")


@both
def test_both_links_carry_the_heartbeat_and_the_requests_of_rates(stack: Stack) -> None:
    air = connected(stack)
    air.run_for(10.0)
    for up, _ in air.lines:
        kinds = Counter(message.get_type() for message in up.sent)
        assert kinds["HEARTBEAT"] >= 15
        asked = {m.param1 for m in up.sent if m.get_type() == "COMMAND_LONG" and m.command == 511}
        assert len(asked) >= 9


@both
@routed
@pytest.mark.parametrize("after_s", [0.1, 0.5, 1.0, 1.5])
def test_an_upload_continues_over_the_other_link(
    stack: Stack, is_routed: bool, after_s: float
) -> None:
    air = connected(stack, is_routed=is_routed)
    sent = line_of(100)
    transfer_id = air.client.upload(sent, air.now_us, by_file=False)
    air.run_for(after_s)
    air.cut(RADIO)
    began_us = air.now_us
    result = air.result_of(transfer_id, 40.0)
    assert result.outcome == "accepted", result.reason
    assert (air.now_us - began_us) / SECOND < 20.0
    assert held(air.mock) == tuple(as_read_back(item, stack) for item in sent)
    assert not air.of(LinkLost)


@both
@pytest.mark.parametrize("after_s", [0.02, 0.3])
def test_a_download_continues_over_the_other_link(stack: Stack, after_s: float) -> None:
    air = connected(stack)
    sent = line_of(100)
    air.result_of(air.client.upload(sent, air.now_us))
    transfer_id = air.client.download(air.now_us, by_file=False)
    air.run_for(after_s)
    air.cut(RADIO)
    result = air.result_of(transfer_id, 40.0)
    assert result.items == tuple(as_read_back(item, stack) for item in sent)


def test_a_mission_file_continues_over_the_other_link() -> None:
    air = connected(PLANE)
    sent = line_of(300)
    transfer_id = air.client.upload(sent, air.now_us)
    air.run_for(0.3)
    air.cut(RADIO)
    assert air.result_of(transfer_id, 40.0).outcome == "accepted"
    assert held(air.mock) == tuple(as_read_back(item, PLANE) for item in sent)


@both
def test_a_command_continues_over_the_other_link(stack: Stack) -> None:
    air = connected(stack)
    air.cut(RADIO)
    air.client.command("hold", air.now_us)
    air.run_for(10.0)
    assert [event.accepted for event in air.of(CommandFinished)] == [True]
    assert air.in_use == "lte"


def test_the_link_is_lost_only_when_both_are_silent_and_restored_by_either() -> None:
    air = connected(PX4)
    air.cut(RADIO)
    air.run_for(20.0)
    assert not air.of(LinkLost)
    assert (air.in_use, air.states) == ("lte", ("silent", "up"))
    positions = len(air.of(Position))
    air.run_for(10.0)
    assert len(air.of(Position)) - positions >= 38
    air.cut(LTE)
    air.run_for(10.0)
    assert len(air.of(LinkLost)) == 1
    assert air.states == ("silent", "silent")
    air.cut(RADIO, is_cut=False)
    air.run_for(5.0)
    assert len(air.of(LinkRestored)) == 1
    assert (air.in_use, air.states) == ("radio", ("up", "silent"))
    air.cut(LTE, is_cut=False)
    air.run_for(10.0)
    assert air.states == ("up", "up")
    assert len(air.of(Connected)) == 1


def test_positions_continue_while_the_link_in_use_becomes_silent() -> None:
    air = connected(PX4)
    air.run_for(5.0)
    air.cut(RADIO)
    air.run_for(6.0)
    times = [position.at_us for position in air.of(Position)][-30:]
    gaps_s = [(late - early) / SECOND for early, late in pairwise(times)]
    assert max(gaps_s) < 1.0


def test_the_preferred_link_is_used_again_when_it_has_recovered_but_not_during_a_transfer() -> None:
    air = connected(PLANE, is_routed=False)
    air.cut(RADIO)
    air.run_for(6.0)
    assert air.in_use == "lte"
    air.cut(RADIO, is_cut=False)
    air.run_for(7.0)
    assert air.in_use == "lte"
    transfer_id = air.client.upload(line_of(650), air.now_us, by_file=False)
    air.run_for(8.0)
    assert air.in_use == "lte"
    assert air.result_of(transfer_id).outcome == "accepted"
    air.run_for(5.0)
    assert air.in_use == "radio"
    causes = [event.cause for event in air.of(LinksChanged) if event.cause]
    assert causes == ["silent", "recovered"]


def test_a_link_that_loses_many_frames_is_left_and_its_loss_is_reported() -> None:
    air = TwoLinks(mock_of(PX4), [lines(1, loss=0.5), lines(11, loss=0.05)])
    air.run_for(30.0)
    assert air.in_use == "lte"
    radio, lte = air.of(LinksChanged)[-1].links
    assert radio.state == "degraded"
    assert 0.3 < radio.loss_share < 0.7
    assert lte.loss_share < 0.2
    assert [event.cause for event in air.of(LinksChanged) if event.cause] == ["loss"]


def test_a_late_heartbeat_of_the_other_link_is_no_change_of_mode() -> None:
    air = connected(PX4, delay_us=2_500_000)
    modes = ["hold", "return", "hold", "return"]
    for mode in modes:
        air.client.command(mode, air.now_us)
        air.run_for(5.0)
    assert [event.name for event in air.of(ModeChanged)][-4:] == modes
    assert len(air.of(ModeChanged)) <= 5
    assert not air.of(Rebooted)


def test_a_forged_remote_on_one_link_does_not_take_over() -> None:
    air = connected(PX4)
    forger = mock_of(PX4)
    forger.handle_timer(air.now_us)
    for _ in range(100):
        air.run_for(0.1)
        forger.handle_timer(air.now_us)
        for datagram in forger.data_to_send():
            air.link.receive_frames("forger", [datagram], air.now_us, LTE)
    assert len(air.of(SameSystemId)) == 1
    assert air.in_use == "radio"
    assert not air.of(Rebooted) + air.of(LinkLost)
    air.cut(RADIO)
    air.run_for(5.0)
    assert air.in_use == "lte"
    commands = [m for m in air.lines[LTE][0].sent if m.get_type() == "COMMAND_LONG"]
    (recipient,) = air.link._recipients(commands[0])
    assert recipient == (LTE, "air")
