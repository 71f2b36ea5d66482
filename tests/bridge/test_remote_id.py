"""The Remote ID module of a vehicle: its arm status, its heartbeat, and its loss."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.clients.shared_link import SharedLink
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.mock.fault_injection import REMOTE_ID_ERROR, FaultyMock
from autopilot_bridge.mock.fault_kinds import parse_faults
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle.client_events import Connected, LinkLost, RemoteIdStatus
from autopilot_bridge.vehicle.remote_id import (
    BY_HEARTBEAT,
    COMPONENTS,
    SILENT_US,
    RemoteIdMonitor,
)
from tests.bridge.helpers import SECOND, Pair, mock_of

GOOD, BAD = mavlink.MAV_ODID_ARM_STATUS_GOOD_TO_ARM, 1
AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1


def arm_status(status: int = GOOD, error: bytes = b"") -> Any:
    return mavlink.MAVLink_open_drone_id_arm_status_message(status, error)


def heartbeat(state: int = mavlink.MAV_STATE_ACTIVE) -> Any:
    kind, other = mavlink.MAV_TYPE_ODID, mavlink.MAV_AUTOPILOT_INVALID
    return mavlink.MAVLink_heartbeat_message(kind, other, 0, 0, state, 3)


def of_autopilot() -> Any:
    kind, px4 = mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_PX4
    return mavlink.MAVLink_heartbeat_message(kind, px4, 0x81, 0, 4, 3)


def test_the_state_is_reported_on_change_with_the_modules_text() -> None:
    module, found = RemoteIdMonitor(), []
    for number, message in enumerate(
        (arm_status(BAD, b"no GPS lock"), arm_status(BAD, b"no GPS lock"), arm_status(BAD))
    ):
        found += module.receive(message, number)
    found += module.receive(arm_status(), 3)
    assert found == [
        RemoteIdStatus(0, "fails", "no GPS lock"),
        RemoteIdStatus(2, "fails", "no reason reported"),
        RemoteIdStatus(3, "ready", ""),
    ]


def test_a_silent_module_is_lost_once_and_can_return() -> None:
    module = RemoteIdMonitor()
    assert module.next_timer() is None
    module.receive(arm_status(), 10)
    assert module.next_timer() == 10 + SILENT_US
    assert module.handle_timer(9 + SILENT_US) == []
    assert module.handle_timer(10 + SILENT_US) == [
        RemoteIdStatus(10 + SILENT_US, "lost", "silent for 5 s")
    ]
    assert module.next_timer() is None
    assert module.handle_timer(99 + SILENT_US) == []
    (back,) = module.receive(arm_status(), 100 + SILENT_US)
    assert back.state == "ready"


def test_a_heartbeat_counts_only_without_an_arm_status() -> None:
    module = RemoteIdMonitor()
    assert module.receive(heartbeat(), 1) == [RemoteIdStatus(1, "ready", BY_HEARTBEAT)]
    critical = module.receive(heartbeat(mavlink.MAV_STATE_CRITICAL), 2)
    assert critical == [RemoteIdStatus(2, "fails", "MAV_STATE 5")]
    module.receive(arm_status(BAD, b"x"), 3)
    assert module.receive(heartbeat(), 4) == []
    assert module.receive(heartbeat(), 3 + SILENT_US)[0].state == "ready"


@pytest.mark.parametrize("component", [*COMPONENTS, AUTOPILOT])
def test_the_module_or_the_autopilot_sends_it_with_the_vehicles_system_id(component: int) -> None:
    client = NativeClient(target_system=1)
    client.receive_data(Codec(1, AUTOPILOT).encode(of_autopilot()), 1)
    for system in (2, 1):
        client.receive_data(Codec(system, component).encode(arm_status(BAD, b"wiring")), 2)
    found = []
    while (event := client.next_event()) is not None:
        found += [event] if isinstance(event, RemoteIdStatus) else []
    assert found == [RemoteIdStatus(2, "fails", "wiring")]
    assert client.next_timer() <= 2 + SILENT_US


@pytest.mark.parametrize("component", COMPONENTS)
def test_its_heartbeat_is_not_that_of_the_vehicle(component: int) -> None:
    link = SharedLink("field")
    link.receive_data(Codec(1, component).encode(heartbeat()), 1)
    assert link.next_event() is None, "no vehicle is detected"
    link.receive_data(Codec(1, AUTOPILOT).encode(of_autopilot()), 2)
    for at_us in range(SECOND, 6 * SECOND, SECOND):
        link.receive_data(Codec(1, component).encode(heartbeat()), at_us)
        link.handle_timer(at_us)
    found = []
    while (event := link.next_event()) is not None:
        found.append(event.event)
    assert RemoteIdStatus(SECOND, "ready", BY_HEARTBEAT) in found
    assert [type(each) for each in found if isinstance(each, Connected | LinkLost)] == [
        Connected,
        LinkLost,
    ]


@pytest.mark.parametrize("stack", ["px4", "ardupilot"])
def test_a_mock_reports_an_error_and_the_loss_of_its_module(stack: str) -> None:
    mock = mock_of(stack_named(stack, "plane"))
    faults = parse_faults(["remote-id-error@10..20", "remote-id-loss@30..40"])
    pair = Pair(FaultyMock(mock, faults))  # type: ignore[arg-type]
    pair.run(50 * SECOND)
    reported = pair.of(RemoteIdStatus)
    assert [(each.state, each.text) for each in reported] == [
        ("ready", ""),
        ("fails", REMOTE_ID_ERROR),
        ("ready", ""),
        ("lost", "silent for 5 s"),
        ("ready", ""),
    ]
    for each, at_s in zip(reported[1:], (10, 20, 35, 40), strict=True):
        assert at_s - 1.5 <= each.at_us / SECOND <= at_s + 1.5
