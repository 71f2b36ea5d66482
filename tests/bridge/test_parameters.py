"""Parameters: read one, read all, set one, in each stack's encoding, over lossy links."""

import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.stacks.stacks import STACKS, Stack, stack_named
from autopilot_bridge.vehicle.client_events import ParametersFinished
from autopilot_bridge.vehicle.parameters import (
    Parameter,
    ParametersResult,
    decoded_value,
    encoded_value,
)
from tests.bridge.helpers import Pair, mock_of

PX4, PLANE = stack_named("px4", "plane"), stack_named("ardupilot", "plane")
COPTER = stack_named("ardupilot", "copter")
INT32, INT8 = mavlink.MAV_PARAM_TYPE_INT32, mavlink.MAV_PARAM_TYPE_INT8
REAL32 = mavlink.MAV_PARAM_TYPE_REAL32
each_stack = pytest.mark.parametrize("stack", STACKS, ids=lambda s: f"{s.name}-{s.kind}")
WHOLE = {"px4": "MIS_TKO_LAND_REQ", "ardupilot": "SYSID_THISMAV"}


def pair_of(stack: Stack, loss: float = 0.0, seed: int = 1) -> Pair:
    pair = Pair(mock_of(stack), MemoryLink(loss=loss, seed=seed), MemoryLink(loss=loss, seed=-seed))
    pair.run_for(3.0)
    return pair


def result_of(pair: Pair, request_id: int, within_s: float = 60.0) -> ParametersResult:
    for _ in range(round(within_s * 10)):
        for event in pair.of(ParametersFinished):
            if event.request_id == request_id:
                assert isinstance(event, ParametersFinished)
                return event.result
        pair.run_for(0.1)
    raise AssertionError(f"request {request_id} did not end")


def test_px4_carries_the_bytes_of_whole_numbers_and_ardupilot_the_number() -> None:
    assert struct.pack("<f", encoded_value(-7, INT32, True)) == struct.pack("<i", -7)
    assert encoded_value(-7, INT32, False) == -7.0
    for value in (0, 1, -1, 4, 2**31 - 1, -(2**31), 0x00800000):
        assert decoded_value(encoded_value(value, INT32, True), INT32, True) == value
    assert encoded_value(1.5, REAL32, True) == 1.5


@pytest.mark.parametrize(
    ("value", "kind"), [(1.5, INT32), (200.0, INT8), (2.0**31, INT32), (-1.0, 5)]
)
@pytest.mark.parametrize("bytewise", [True, False])
def test_what_a_type_cannot_hold_is_not_sent(value: float, kind: int, bytewise: bool) -> None:
    with pytest.raises(BridgeError, match="integer of"):
        encoded_value(value, kind, bytewise)


@each_stack
# With some seeds, such as 1, 4 and 5, all repetitions of one request are lost.
@pytest.mark.parametrize("seed", [2, 3, 6])
def test_all_parameters_are_read_over_a_bad_link(stack: Stack, seed: int) -> None:
    pair = pair_of(stack, loss=0.3, seed=seed)
    result = result_of(pair, pair.client.read_parameters(pair.now_us))
    assert result.outcome == "accepted"
    names = [parameter.name for parameter in result.parameters]
    assert names == sorted(set(names))
    assert WHOLE[stack.name] in names
    assert "_HASH_CHECK" not in names


@each_stack
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_a_parameter_is_set_and_read_back(stack: Stack, loss: float) -> None:
    pair = pair_of(stack, loss)
    name = WHOLE[stack.name]
    for value in (3.0, 1.0):
        result = result_of(pair, pair.client.set_parameter(name, value, pair.now_us))
        assert (result.outcome, result.parameters[0].value) == ("accepted", value)
        assert pair.mock.parameters.value(name) == value
    result = result_of(pair, pair.client.read_parameter(name, pair.now_us))
    kind = INT32 if stack.name == "px4" else mavlink.MAV_PARAM_TYPE_INT16
    assert result.parameters == (Parameter(name, 1.0, kind),)


def test_fractions_are_kept_in_single_precision() -> None:
    pair = pair_of(PLANE)
    assert result_of(pair, pair.client.set_parameter("TKOFF_ALT", 61.7, pair.now_us)).outcome == (
        "accepted"
    )
    assert pair.mock.parameters.value("TKOFF_ALT") == pytest.approx(61.7, rel=1e-6)


def test_a_parameter_that_keeps_its_value_is_reported() -> None:
    pair = pair_of(PLANE)
    held = pair.mock.parameters._held["TKOFF_ALT"]

    class Stubborn(type(held)):  # type: ignore[misc]
        def __setattr__(self, name: str, value: float) -> None:
            object.__setattr__(self, name, min(value, 50.0) if name == "value" else value)

    pair.mock.parameters._held["TKOFF_ALT"] = Stubborn(held.value, held.kind)
    result = result_of(pair, pair.client.set_parameter("TKOFF_ALT", 80.0, pair.now_us))
    assert (result.outcome, result.reason) == ("rejected", "the autopilot keeps TKOFF_ALT at 50")
    takeoff = pair.client.command("takeoff", pair.now_us, 80.0)
    pair.run_for(15.0)
    assert takeoff
    assert not pair.mock.flight.armed  # the order ends at its first step


@each_stack
def test_a_parameter_that_there_is_not_ends_in_bounded_time(stack: Stack) -> None:
    pair = pair_of(stack)
    result = result_of(pair, pair.client.read_parameter("NO_SUCH", pair.now_us), within_s=12.0)
    assert (result.outcome, result.reason) == (
        "failed",
        "no reply for parameter NO_SUCH; the autopilot may not have it",
    )
    result = result_of(pair, pair.client.set_parameter("NO_SUCH", 1.0, pair.now_us), within_s=12.0)
    assert result.outcome == "failed"


def test_a_fraction_for_a_whole_number_is_refused_before_it_is_sent() -> None:
    pair = pair_of(PX4)
    result = result_of(pair, pair.client.set_parameter("MIS_TKO_LAND_REQ", 0.5, pair.now_us))
    assert (result.outcome, result.reason) == (
        "rejected",
        "parameter MIS_TKO_LAND_REQ: 0.5 is not a signed integer of 32 bits",
    )
    assert pair.mock.parameters.value("MIS_TKO_LAND_REQ") == 0.0


def test_a_silent_autopilot_ends_the_reading() -> None:
    pair = pair_of(COPTER)
    pair.up = MemoryLink(loss=1.0)
    result = result_of(pair, pair.client.read_parameters(pair.now_us))
    assert (result.outcome, result.reason) == ("failed", "the autopilot reports no parameters")


@pytest.mark.parametrize("name", ["", "A" * 17, "WÄRME"])
def test_names_that_no_parameter_can_have_are_refused(name: str) -> None:
    pair = pair_of(PX4)
    with pytest.raises(BridgeError, match="is not a valid parameter name"):
        pair.client.read_parameter(name, pair.now_us)


def test_requests_are_answered_in_order() -> None:
    pair = pair_of(PLANE)
    first = pair.client.set_parameter("TKOFF_ALT", 33.0, pair.now_us)
    second = pair.client.read_parameter("TKOFF_ALT", pair.now_us)
    assert result_of(pair, second).parameters[0].value == 33.0
    assert [event.request_id for event in pair.of(ParametersFinished)] == [first, second]
