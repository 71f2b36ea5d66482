"""Failure states as events: each is reported once."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.mock.fault_injection import FaultyMock
from autopilot_bridge.mock.fault_kinds import parse_faults
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle.client_events import (
    EstimatorStatus,
    FenceStatus,
    LandedState,
    ModeChanged,
    SystemState,
    Text,
)
from autopilot_bridge.vehicle.monitor import VehicleMonitor
from autopilot_bridge.vehicle.telemetry import Telemetry
from tests.bridge.helpers import SECOND, Pair, flight_of, mock_of

ALL_WELL = 0x033F  # attitude, velocities, positions and predicted positions
LOST = ALL_WELL & ~mavlink.ESTIMATOR_POS_HORIZ_ABS


def ekf(flags: int) -> Any:
    """Return an EKF_STATUS_REPORT of ArduPilot."""
    return mavlink.MAVLink_ekf_status_report_message(flags, 0.1, 0.1, 0.1, 0.1, 0.1)


def estimator(flags: int) -> Any:
    """Return an ESTIMATOR_STATUS of PX4."""
    return mavlink.MAVLink_estimator_status_message(1, flags, 0, 0, 0, 0, 0, 0, 1.0, 1.0)


def events_of(*messages: Any) -> list[Any]:
    telemetry = Telemetry()
    return [event for message in messages for event in telemetry.events(message, 7)]


def heartbeat(stack: str, state: int, mode: int = 10) -> Any:
    of = stack_named(stack, "plane")
    return mavlink.MAVLink_heartbeat_message(of.mav_type, of.autopilot, 0x81, mode, state, 3)


@pytest.mark.parametrize(
    ("number", "word"),
    [(0, "uninit"), (3, "standby"), (4, "active"), (5, "critical"), (8, "flight termination")],
)
def test_the_state_of_a_heartbeat_is_reported_after_the_vehicle_is_identified(
    number: int, word: str
) -> None:
    events = VehicleMonitor().receive(heartbeat("ardupilot", number), 5)
    assert [type(event).__name__ for event in events] == ["Connected", "ModeChanged", "SystemState"]
    assert events[-1] == SystemState(5, word)


def test_states_are_reported_when_they_change_and_again_after_a_restart() -> None:
    watch = VehicleMonitor()
    for state in (4, 4, 5, 5, 4):
        watch.receive(heartbeat("px4", state), 1)
    assert watch.receive(heartbeat("px4", 4), 2) == []
    position = mavlink.MAVLink_global_position_int_message
    place = (363000000, -842000000, 300000, 0, 0, 0, 0, 0)
    watch.receive(position(60_000, *place), 3)
    for quarter in range(5):  # the jump is a restart if all times continue from zero for a second
        watch.receive(position(1_000 + 250 * quarter, *place), 4 + 250_000 * quarter)
    fresh = watch.receive(heartbeat("px4", 4), 1_000_005)
    assert [type(event) for event in fresh] == [ModeChanged, SystemState]


def test_a_state_without_a_name_is_reported_by_its_number() -> None:
    watch = VehicleMonitor()
    watch.receive(heartbeat("px4", 4), 1)
    assert watch.receive(heartbeat("px4", 77), 2) == [SystemState(2, "state 77")]


def test_landing_is_reported_on_change() -> None:
    states = [mavlink.MAVLink_extended_sys_state_message(0, state) for state in (1, 1, 3, 2, 4, 1)]
    words = ["on ground", "takeoff", "in air", "landing", "on ground"]
    assert events_of(*states) == [LandedState(7, word) for word in words]


def test_a_breach_is_reported_with_the_fence_that_was_breached() -> None:
    fence = mavlink.MAVLink_fence_status_message
    messages = [fence(0, 0, 0, 0), fence(1, 1, 3, 900), fence(1, 1, 2, 900), fence(0, 1, 0, 900)]
    assert events_of(*messages) == [
        FenceStatus(7, False, ""),
        FenceStatus(7, True, "boundary"),
        FenceStatus(7, True, "highest altitude"),
        FenceStatus(7, False, ""),
    ]


@pytest.mark.parametrize("message", [ekf, estimator])
def test_a_lost_position_is_reported_at_once_and_its_return_when_it_lasts(message: Any) -> None:
    messages = [ALL_WELL, LOST, LOST, *[ALL_WELL] * 4, LOST, *[ALL_WELL] * 5]
    assert events_of(*map(message, messages)) == [
        EstimatorStatus(7, True, ()),
        EstimatorStatus(7, False, ("position lost",)),
        EstimatorStatus(7, True, ()),
    ]


@pytest.mark.parametrize(("message", "glitch"), [(ekf, 1 << 15), (estimator, 1 << 10)])
def test_one_sample_of_a_glitch_is_none(message: Any, glitch: int) -> None:
    flapping = [ALL_WELL, ALL_WELL | glitch] * 10
    assert events_of(*map(message, flapping)) == [EstimatorStatus(7, True, ())]
    lasting = [ALL_WELL, ALL_WELL | glitch, ALL_WELL | glitch, *flapping]
    found = events_of(*map(message, lasting))
    assert [event.problems for event in found] == [(), ("satellite position glitch",)]


def test_constant_position_counts_for_ardupilot_and_not_for_px4_when_standing() -> None:
    still = ALL_WELL | mavlink.EKF_CONST_POS_MODE
    assert events_of(ekf(still)) == [EstimatorStatus(7, False, ("constant position mode",))]
    assert events_of(estimator(still)) == [EstimatorStatus(7, True, ())]


def test_px4_without_satellites_reports_so_before_it_gives_up_its_position() -> None:
    dead_reckoning = ALL_WELL & ~mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS
    assert events_of(estimator(dead_reckoning)) == [
        EstimatorStatus(7, False, ("satellites not used",))
    ]


def test_before_it_has_begun_an_estimate_has_one_problem() -> None:
    assert events_of(ekf(mavlink.EKF_UNINITIALIZED)) == [
        EstimatorStatus(7, False, ("not initialised",))
    ]


def flown_with(stack: str, *faults: str, vehicle: str = "plane", until_s: float = 60.0) -> Pair:
    """Fly a mission and apply these changes to the mock; times are in seconds."""
    mock = mock_of(stack_named(stack, vehicle))
    pair = Pair(FaultyMock(mock, parse_faults(faults)))  # type: ignore[arg-type]
    pair.run_for(2.0)
    assert pair.result_of(pair.client.upload(flight_of(), pair.now_us)).outcome == "accepted"
    pair.client.command("start mission", pair.now_us)
    pair.run(round(until_s * SECOND))
    return pair


def states(pair: Pair, kind: type) -> list[Any]:
    return [event.without_time() for event in pair.of(kind)]


@pytest.mark.parametrize(
    ("stack", "texts"),
    [
        ("px4", [(2, "Low battery"), (2, "Failsafe activated"), (0, "Emergency battery level")]),
        ("ardupilot", [(4, "Battery 1 is low 10.79V used 4300 mAh")]),
    ],
)
def test_a_battery_failsafe_is_reported_within_two_seconds(
    stack: str, texts: list[tuple[int, str]]
) -> None:
    pair = flown_with(stack, "battery-low@40", "battery-emergency@50")
    assert [(text.severity, text.text) for text in pair.of(Text) if text.severity < 5] == texts
    assert [state.state for state in pair.of(SystemState)] == ["standby", "active", "critical"]
    assert 40.0 <= pair.of(SystemState)[-1].at_us / SECOND <= 42.0
    assert pair.of(ModeChanged)[-1].name == "return"


@pytest.mark.parametrize(("stack", "mode"), [("px4", "hold"), ("ardupilot", "return")])
def test_a_fence_breach_is_reported_within_two_seconds(stack: str, mode: str) -> None:
    pair = flown_with(stack, "fence-breach@40..50")
    (text,) = [text for text in pair.of(Text) if "ence" in text.text]
    assert 40.0 <= text.at_us / SECOND <= 42.0
    assert pair.of(ModeChanged)[-1].name == mode
    fence = [] if stack == "px4" else [(True, "boundary"), (False, "")]
    assert states(pair, FenceStatus) == fence
    if stack == "ardupilot":
        assert pair.of(FenceStatus)[0].at_us / SECOND <= 42.0
    # ArduPlane's heartbeat does not report such a state.
    critical = ["critical"] if stack == "px4" else []
    assert [state.state for state in pair.of(SystemState)][2:] == critical


def test_lost_satellites_are_reported_by_both_stacks() -> None:
    px4 = flown_with("px4", "gps-loss@40..60", until_s=80.0)
    assert [event.problems for event in px4.of(EstimatorStatus)] == [
        (),
        ("satellites not used",),
        ("position lost", "satellites not used"),
        (),
    ]
    assert px4.of(EstimatorStatus)[1].at_us / SECOND <= 42.0
    plane = flown_with("ardupilot", "gps-loss@40..60", until_s=80.0)
    assert [event.problems for event in plane.of(EstimatorStatus)] == [(), ("position lost",), ()]


@pytest.mark.parametrize("stack", ["px4", "ardupilot"])
def test_a_copter_that_loses_its_position_reports_that_it_lands(stack: str) -> None:
    pair = flown_with(stack, "gps-loss@40", vehicle="copter", until_s=180.0)
    landed = [state.state for state in pair.of(LandedState)]
    assert landed[0] == "on ground"
    assert landed[-2:] == ["landing", "on ground"]
    assert "critical" in [state.state for state in pair.of(SystemState)]


def test_px4_is_out_of_its_failsafe_when_a_person_orders_another_mode() -> None:
    pair = flown_with("px4", "battery-low@40")
    pair.client.command("hold", pair.now_us)
    pair.run_for(3.0)
    assert pair.of(SystemState)[-1].state == "active"
