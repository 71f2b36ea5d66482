"""Faults of the mock on request, and several mocks on one link."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.mock.serving import MockGroup
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.client_events import Position, Rebooted, TransferFinished
from tests.bridge.helpers import Pair, line_of, mock_of
from tests.bridge.mock_exchange import (
    PLANE,
    PX4,
    brief,
    count,
    each_stack,
    item,
    player_of,
    read,
    upload,
)


@each_stack
def test_an_item_is_refused_to_order(stack: Stack) -> None:
    player = player_of(stack)
    player.mock.missions.faults.refuse[0, 1] = int(mavlink.MAV_MISSION_INVALID_PARAM3)
    assert brief(upload(player, line_of(4))) == [("MISSION_ACK", 8)]
    player.mock.missions.faults.refuse.clear()
    assert brief(upload(player, line_of(4))) == [("MISSION_ACK", 0)]


@each_stack
def test_silence_from_a_message_on_is_a_failure_that_the_client_reports(stack: Stack) -> None:
    pair = Pair(mock_of(stack))
    pair.run_for(1.0)
    pair.mock.missions.faults.silent_after = 3
    result = pair.result_of(pair.client.upload(line_of(30), pair.now_us, by_file=False))
    assert result.outcome in ("failed", "unknown")
    pair.mock.missions.faults.silent_after = None
    pair.run_for(10.0)
    assert (
        pair.result_of(pair.client.upload(line_of(30), pair.now_us, by_file=False)).outcome
        == "accepted"
    )


@pytest.mark.parametrize(("target", "mission_type"), [((254, 190), 0), ((255, 190), 1)])
def test_a_stray_acknowledgement_ends_no_upload(target: tuple[int, int], mission_type: int) -> None:
    pair = Pair(mock_of(PLANE))
    pair.run_for(1.0)
    transfer_id = pair.client.upload(line_of(40), pair.now_us, by_file=False)
    pair.run_for(0.2)
    pair.mock.send_message(mavlink.MAVLink_mission_ack_message(*target, 1, mission_type))
    pair.run_for(0.1)
    assert pair.of(TransferFinished) == []
    assert pair.result_of(transfer_id).outcome == "accepted"


@pytest.mark.parametrize("stack", [PX4, PLANE], ids=lambda s: s.name)
def test_a_reboot_ends_transfers_and_keeps_the_lists(stack: Stack) -> None:
    player = player_of(stack)
    upload(player, line_of(4))
    held = read(player)
    player.send(count(6))
    player.mock.reboot(player.now_us)
    assert brief(player.listen(2.0)) == []
    assert brief(player.send(item(0, line_of(4)[0]))) == [("MISSION_ACK", 1)]
    assert read(player) == held
    pair = Pair(mock_of(stack))
    pair.run_for(20.0)
    pair.mock.reboot(pair.now_us)
    pair.run_for(3.0)
    assert len(pair.of(Rebooted)) == 1


def test_without_gps_there_are_no_positions() -> None:
    pair = Pair(mock_of(PX4))
    pair.run_for(2.0)
    pair.mock.positions = False
    before = len(pair.of(Position))
    pair.run_for(2.0)
    assert before > 0
    assert len(pair.of(Position)) == before


def test_a_low_battery_is_reported() -> None:
    mock = mock_of(PX4)
    mock.battery_percent = 7
    mock.handle_timer(0)
    mock.handle_timer(1_000_000)
    received = [m for datagram in mock.data_to_send() for m in Codec(255, 190).decode(datagram)]
    percents = [m.battery_remaining for m in received if m.get_type() == "SYS_STATUS"]
    assert percents == [7]


def test_the_vehicles_of_a_fleet_share_a_link_and_keep_apart() -> None:
    fleet = MockGroup([mock_of(PX4, system_id=number) for number in (1, 2, 3)])
    clients = [NativeClient(target_system=number) for number in (1, 2, 3)]
    for now_us in range(0, 4_000_000, 10_000):
        if now_us == 1_500_000:
            clients[1].upload(line_of(3), now_us)
        fleet.handle_timer(now_us)
        datagrams = fleet.data_to_send()
        for client in clients:
            for datagram in datagrams:
                client.receive_data(datagram, now_us)
            client.handle_timer(now_us)
            for datagram in client.data_to_send():
                fleet.receive_data(datagram, now_us)
    assert [len(mock.missions.items) for mock in fleet.mocks] == [0, 3, 0]
