"""DropSender sends each release once, at its time or not at all, and reports its outcome."""

import math
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import loiter_unlimited, takeoff, waypoint
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.stacks.stacks import Stack, stack_named
from autopilot_bridge.vehicle import orders
from autopilot_bridge.vehicle.client_events import (
    CommandFinished,
    DropFinished,
    ModeChanged,
    Position,
)
from autopilot_bridge.vehicle.drop_sender import FIRST_COMPONENT
from autopilot_bridge.vehicle.orders import Dropper
from tests.bridge.helpers import HOME, SECOND, Pair, line_of, mock_of

PX4, ARDUPILOT = stack_named("px4", "copter"), stack_named("ardupilot", "copter")
SERVO = Dropper("servo", 9, 1900.0, 1100.0)
GRIPPER = Dropper("gripper", 1)
ACTUATOR = Dropper("actuator", 2, 1.0, -1.0)
each_means = pytest.mark.parametrize(
    ("stack", "dropper"),
    [(ARDUPILOT, SERVO), (ARDUPILOT, GRIPPER), (PX4, GRIPPER), (PX4, ACTUATOR)],
    ids=lambda value: value.name if isinstance(value, Stack) else value.by,
)
copters = pytest.mark.parametrize("stack", [PX4, ARDUPILOT], ids=lambda stack: stack.name)
# The outputs of the mock that a release switches.
RELEASED = {"servo": 1900.0, "gripper": 0.0, "actuator": 1.0}


class RecordingMock(MockAutopilot):
    """A mock that records the time of each frame."""

    received: list[tuple[int, Any]]

    def receive_data(self, data: bytes, now_us: int) -> None:
        self.received += [(now_us, message) for message in Codec(1, 1).decode(data)]
        super().receive_data(data, now_us)

    def releases(self, dropper: Dropper) -> list[int]:
        """Return the times of the frames that release a sphere."""
        number, params = _release_of(dropper)
        return [
            at_us
            for at_us, message in self.received
            if message.get_type() == "COMMAND_LONG"
            and message.command == number
            and message.param2 == pytest.approx(params[1], nan_ok=True)
        ]


def _release_of(dropper: Dropper) -> tuple[int, tuple[float, ...]]:
    stack = PX4 if dropper.by == "actuator" else ARDUPILOT
    release, _ = orders.drop(stack, dropper)
    return release.command, release.params


def listening(stack: Stack) -> RecordingMock:
    mock = mock_of(stack, airspeed_m_s=8.0)
    mock.__class__ = RecordingMock
    assert isinstance(mock, RecordingMock)
    mock.received = []
    return mock


def flying(stack: Stack, **link: Any) -> tuple[Pair, RecordingMock]:
    """Return a copter that flies its mission, on a link with a seed."""
    mock = listening(stack)
    seed = link.pop("seed", 3)
    pair = Pair(mock)
    pair.run_for(4.0)
    items = (takeoff(*HOME[:2], 330.0), *(replace(item, z=330.0) for item in line_of(12)))
    assert pair.result_of(pair.client.upload(items, pair.now_us)).outcome == "accepted"
    pair.client.command("start mission", pair.now_us)
    pair.run_for(25.0)
    assert mock.flight.mode == "mission"
    assert mock.flight.motion.altitude_m > 325.0
    pair.up, pair.down = (MemoryLink(**link, seed=seed + way) for way in (0, 1))
    return pair, mock


def drop(pair: Pair, dropper: Dropper) -> None:
    """Order a drop; the datagram is sent at once."""
    pair.client.drop(dropper, pair.now_us)
    pair.exchange()


def outcomes(pair: Pair) -> list[str]:
    return [event.outcome for event in pair.of(DropFinished)]


def let_go(mock: MockAutopilot, dropper: Dropper) -> int:
    """Return the number of spheres that fell: the changes of the output from rest to release."""
    fallen, before = 0, math.nan
    for _, what, number, value in mock.outputs:
        if (what, number) == (dropper.by, dropper.number):
            fallen += value == RELEASED[dropper.by] and value != before
            before = value
    return fallen


@each_means
def test_each_drop_lets_go_once_and_is_set_back(stack: Stack, dropper: Dropper) -> None:
    pair, mock = flying(stack)
    for _ in range(3):
        drop(pair, dropper)
        pair.run_for(0.5)
    assert outcomes(pair) == ["done"] * 3
    assert len(mock.releases(dropper)) == let_go(mock, dropper) == 3
    values = [value for _, what, _, value in mock.outputs if what == dropper.by]
    assert len(values) == 6  # each release was followed by one reset, which was acknowledged
    assert values[0] == RELEASED[dropper.by] != values[-1]
    released, back = (at_us for at_us, *_ in mock.outputs[:2])
    # One time step of the mock.
    assert (back - released) / 1e6 == pytest.approx(dropper.hold_s, abs=0.13)
    assert mock.flight.mode == "mission"


@each_means
@pytest.mark.parametrize("seed", range(4))
def test_120_a_minute_keep_their_time_on_a_slow_link_with_losses(
    stack: Stack, dropper: Dropper, seed: int
) -> None:
    pair, mock = flying(stack, loss=0.1, delay_us=100_000, seed=100 * seed)
    ordered_us = []
    for _ in range(60):
        ordered_us.append(pair.now_us)
        drop(pair, dropper)
        pair.run_for(0.5)
    pair.run_for(3.0)
    came_us = [at_us - 100_000 for at_us in mock.releases(dropper)]
    # To the microsecond: no release is late, and none is unplanned.
    assert set(came_us) <= set(ordered_us)
    assert len(came_us) == len(set(came_us)) > 40
    ids_of: dict[str, set[int]] = {"done": set(), "refused": set(), "unknown": set()}
    for event in pair.of(DropFinished):
        ids_of[event.outcome].add(event.drop_id)
        # Three consecutive heartbeats may be lost.
        assert event.outcome != "refused" or event.reason == "the link is lost"
    assert sum(map(len, ids_of.values())) == len(pair.of(DropFinished)) == 60
    came = {ordered_us.index(at_us) + 1 for at_us in came_us}
    assert ids_of["done"] <= came  # no release is reported as done that did not arrive
    # No release is reported as refused that arrived.
    assert came <= ids_of["done"] | ids_of["unknown"]
    assert len(ids_of["done"]) > 36
    assert let_go(mock, dropper) == len(came_us)  # the output was always reset between two releases


@each_means
def test_a_doubled_datagram_sets_the_same_again_and_lets_go_of_one(
    stack: Stack, dropper: Dropper
) -> None:
    pair, mock = flying(stack, duplication=1.0, delay_us=20_000, jitter_us=15_000)
    for _ in range(10):
        drop(pair, dropper)
        pair.run_for(0.5)
    assert len(mock.releases(dropper)) == 20
    assert let_go(mock, dropper) == 10
    assert outcomes(pair) == ["done"] * 10


@copters
def test_a_drop_goes_past_orders_and_transfers_that_wait(stack: Stack) -> None:
    pair, mock = flying(stack)
    pair.down = MemoryLink(loss=1.0)  # from now on nothing is acknowledged
    pair.client.upload(line_of(30, 7), pair.now_us)
    for speed in (6.0, 7.0, 8.0):
        pair.client.command("change speed", pair.now_us, speed)
    pair.run_for(1.0)
    ordered_us = pair.now_us
    drop(pair, GRIPPER)
    pair.run_for(2.0)
    assert mock.releases(GRIPPER) == [ordered_us]


@each_means
def test_what_is_not_answered_is_unknown_and_never_sent_again(
    stack: Stack, dropper: Dropper
) -> None:
    pair, mock = flying(stack)
    pair.up = MemoryLink(loss=1.0)
    drop(pair, dropper)
    pair.run_for(1.6)
    (finished,) = pair.of(DropFinished)
    assert finished.outcome == "unknown"
    assert "was not acknowledged; the object may have been released" in finished.reason
    pair.up = MemoryLink()
    pair.run_for(20.0)
    assert mock.releases(dropper) == []
    assert let_go(mock, dropper) == 0
    assert len(pair.of(DropFinished)) == 1


def test_a_refusal_is_reported_as_text_and_only_for_the_release() -> None:
    pair, mock = flying(ARDUPILOT)
    drop(pair, SERVO._replace(number=9))
    pair.run_for(0.1)
    assert outcomes(pair) == ["done"]
    mock.flight.payload.servos_us = mock.flight.payload.servos_us[:4]  # the output no longer exists
    pair.run_for(0.5)  # so the reset is refused
    assert outcomes(pair) == ["done"]
    pair.run_for(3.0)
    drop(pair, SERVO)
    pair.run_for(0.5)
    last = pair.of(DropFinished)[-1]
    assert (last.outcome, last.reason) == ("refused", "DO_SET_SERVO failed")


def test_a_refusal_addressed_to_another_is_none_of_a_drops() -> None:
    pair, mock = flying(ARDUPILOT, delay_us=50_000)
    drop(pair, SERVO)
    denied = mavlink.MAV_RESULT_DENIED
    others = ((255, 190), (255, FIRST_COMPONENT + 3), (254, FIRST_COMPONENT + 2))
    for other in others:
        mock.send_message(mavlink.MAVLink_command_ack_message(183, denied, 0, 0, *other))
    pair.run_for(0.5)
    assert outcomes(pair) == ["done"]


def test_a_drop_is_refused_at_once_while_the_dropper_is_not_set_back() -> None:
    pair, mock = flying(ARDUPILOT)
    drop(pair, SERVO)
    pair.run_for(0.1)
    drop(pair, SERVO)
    pair.run_for(1.0)
    finished = pair.of(DropFinished)
    assert [event.outcome for event in finished] == ["done", "refused"]
    assert (
        finished[1].reason
        == "late: the dropper was triggered 0.10 s ago and has not been reset yet"
    )
    assert len(mock.releases(SERVO)) == 1


def test_a_drop_over_a_lost_link_is_refused_at_once() -> None:
    pair, mock = flying(ARDUPILOT)
    pair.down = MemoryLink(loss=1.0)
    pair.run_for(4.5)
    drop(pair, SERVO)
    pair.run_for(0.1)
    (finished,) = pair.of(DropFinished)
    assert (finished.outcome, finished.reason) == ("refused", "the link is lost")
    assert mock.releases(SERVO) == []


@pytest.mark.parametrize("order", ["climb and hold", "hold", "return", "land"])
def test_an_urgent_order_takes_back_drops_that_are_not_sent_yet(order: str) -> None:
    pair, mock = flying(ARDUPILOT)
    pair.client.drop(SERVO, pair.now_us)
    place = (36.305, -84.198, 380.0) if order == "climb and hold" else ()
    pair.client.command(order, pair.now_us, *place)
    pair.run_for(3.0)
    (finished,) = pair.of(DropFinished)
    assert finished.outcome == "refused"
    assert finished.reason.endswith("replaced it")
    assert mock.releases(SERVO) == []
    assert pair.of(CommandFinished)[-1].accepted


@pytest.mark.parametrize(
    ("stack", "dropper", "words"),
    [
        (PX4, SERVO, "PX4 has no DO_SET_SERVO; configure the dropper as a gripper"),
        (ARDUPILOT, ACTUATOR, "ArduPilot has no DO_SET_ACTUATOR"),
        (ARDUPILOT, SERVO._replace(number=3), "number 3 must be 5 to 16"),
        (ARDUPILOT, SERVO._replace(release=19.0), "release 19 must be 500 to 2500"),
        (ARDUPILOT, SERVO._replace(rest=1900.0), "both 1900; they must differ"),
        (PX4, ACTUATOR._replace(number=7), "number 7 must be 1 to 6"),
        (PX4, ACTUATOR._replace(release=1900.0), "must be -1 to 1"),
        (PX4, GRIPPER._replace(hold_s=0.0), "hold of 0.0 s"),
    ],
)
def test_a_dropper_that_a_stack_has_not_is_an_error_at_once(
    stack: Stack, dropper: Dropper, words: str
) -> None:
    pair, mock = flying(stack)
    with pytest.raises(BridgeError, match=words):
        pair.client.drop(dropper, pair.now_us)
    pair.run_for(1.0)
    assert mock.outputs == []


def test_an_actuator_leaves_the_others_as_they_are() -> None:
    pair, mock = flying(PX4)
    drop(pair, ACTUATOR)
    pair.run_for(1.0)
    assert {number for _, _, number, _ in mock.outputs} == {2}


# Climb and hold -----------------------------------------------------------------------------------


@copters
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_it_leaves_its_mission_climbs_in_place_and_holds(stack: Stack, loss: float) -> None:
    pair, mock = flying(stack, loss=loss, delay_us=100_000)
    position = pair.of(Position)[-1]
    place = (position.lat_deg, position.lon_deg, 390.0)
    begun = mock.flight.motion
    at_m = (begun.north_m, begun.east_m)
    pair.client.command("climb and hold", pair.now_us, *place)
    pair.run_for(10.0)
    assert mock.flight.motion.altitude_m > 345.0
    pair.run_for(25.0)
    motion = mock.flight.motion
    assert motion.altitude_m == pytest.approx(390.0, abs=0.5)
    assert math.dist(at_m, (motion.north_m, motion.east_m)) < 15.0
    assert motion.speed_m_s < 0.1
    assert pair.of(ModeChanged)[-1].name in ("hold", "guided")
    ended = pair.of(CommandFinished)[-1]
    assert (ended.name, ended.accepted) == ("climb and hold", True)


@copters
def test_it_takes_the_place_of_orders_under_way_and_is_repeated_soon(stack: Stack) -> None:
    pair, mock = flying(stack)
    pair.up = MemoryLink(loss=1.0)
    pair.client.command("change speed", pair.now_us, 4.0)
    pair.run_for(0.5)
    asked_us = pair.now_us
    pair.client.command("climb and hold", pair.now_us, 36.305, -84.198, 390.0)
    pair.run_for(1.0)
    pair.up = MemoryLink()
    pair.run_for(0.5)
    ended = {event.name: event for event in pair.of(CommandFinished)}
    assert not ended["change speed"].accepted
    assert ended["climb and hold"].accepted
    assert ended["climb and hold"].at_us - asked_us < 1_500_000
    assert mock.flight.mode in ("hold", "guided")


def test_an_upload_under_way_does_not_fly_on_after_it() -> None:
    # ArduCopter's upload by items: it holds, receives the items, and flies on, unless it is ordered
    # to climb in the meantime.
    for after_s in (0.0, 0.03, 0.06, 0.1, 0.2, 0.4):
        pair, mock = flying(ARDUPILOT, delay_us=20_000)
        pair.client.upload(
            tuple(replace(item, z=330.0) for item in line_of(20, 3)),
            pair.now_us,
            holds_first=True,
            by_file=False,
        )
        pair.run_for(after_s)
        pair.client.command("climb and hold", pair.now_us, 36.305, -84.198, 390.0)
        pair.run_for(25.0)
        assert mock.flight.mode == "guided", after_s
        assert mock.flight.motion.altitude_m > 380.0


@copters
def test_without_satellites_a_mock_lands_blind_as_the_real_ones_do(stack: Stack) -> None:
    # Without a position ArduCopter 4.6 lands after 8 s, PX4 1.17 after 5 s; until then they climb.
    pair, mock = flying(stack)
    mock.positions = False
    pair.run_for(3.0)
    pair.client.command("climb and hold", pair.now_us, 36.305, -84.198, 390.0)
    pair.run_for(1.5)
    assert pair.of(CommandFinished)[-1].accepted
    assert mock.flight.motion.altitude_m > 332.0
    pair.run_for(5.0)
    assert mock.flight.mode == "land"
    pair.client.command("climb and hold", pair.now_us, 36.305, -84.198, 390.0)
    pair.run_for(3.0)
    ended = pair.of(CommandFinished)[-1]
    assert not ended.accepted
    assert "requires position" in ended.reason or "not available" in ended.reason
    pair.run_for(60.0)
    assert not mock.flight.airborne
    assert not mock.flight.armed


@copters
def test_a_return_leads_home_as_high_as_was_set(stack: Stack) -> None:
    # By default ArduCopter 4.6 returns from a drop line at the height of the line (observed).
    heights = []
    for height_m in (None, 75.0):
        pair, _ = flying(stack, loss=0.1)
        if height_m is not None:
            pair.client.command("return height", pair.now_us, height_m)
            pair.run_for(10.0)
            assert pair.of(CommandFinished)[-1].accepted
        pair.client.command("return", pair.now_us)
        positions_before = len(pair.of(Position))
        pair.run_for(25.0)
        heights.append(max(at.altitude_relative_m for at in pair.of(Position)[positions_before:]))
    assert heights == pytest.approx([30.0 if stack is ARDUPILOT else 60.0, 75.0], abs=1.5)


@pytest.mark.parametrize("height_m", [0.0, 4000.0, math.nan])
def test_a_return_height_that_cannot_be_is_an_error(height_m: float) -> None:
    with pytest.raises(BridgeError, match="must be 1 to 3000 m"):
        orders.return_height(PX4, height_m)


def test_planes_cannot() -> None:
    plane = stack_named("px4", "plane")
    with pytest.raises(BridgeError, match="only a multirotor can climb and hold"):
        orders.climb_and_hold(plane, 36.3, -84.2, 400.0)


@copters
def test_after_it_a_new_mission_is_flown_from_its_beginning(stack: Stack) -> None:
    pair, mock = flying(stack, delay_us=50_000)
    pair.client.command("climb and hold", pair.now_us, 36.303, -84.199, 360.0)
    pair.run_for(25.0)
    items = (waypoint(36.304, -84.199, 330.0), loiter_unlimited(36.304, -84.198, 360.0, 0.0))
    pair.result_of(pair.client.upload(items, pair.now_us, holds_first=True))
    pair.client.command("start mission", pair.now_us)
    pair.run_for(120.0)
    assert mock.flight.mode == "mission"
    assert mock.flight.motion.altitude_m == pytest.approx(360.0, abs=1.0)
    assert pair.now_us > 25 * SECOND


def test_px4s_gripper_reports_its_movements_like_the_real_one() -> None:
    # Recorded from PX4 1.17: the results and their target components, for a release and a reset 0.2
    # s later, and for a release that the link duplicates.
    pair, mock = flying(PX4)
    received: list[tuple[int, int]] = []
    codec, number = Codec(255, 190), mavlink.MAV_CMD_DO_GRIPPER

    def order(component: int, action: float) -> None:
        message = mavlink.MAVLink_command_long_message(1, 1, number, 0, 1, action, *[0.0] * 5)
        message.from_component = component
        mock.receive_data(codec.encode(message), pair.now_us)
        listen()

    def listen(seconds: float = 0.0) -> None:
        mock.handle_timer(pair.now_us + round(seconds * SECOND))
        pair.now_us += round(seconds * SECOND)
        received.extend(
            (message.result, message.target_component)
            for datagram in mock.data_to_send()
            for message in codec.decode(datagram)
            if message.get_type() == "COMMAND_ACK"
        )

    order(27, 0.0)
    listen(0.2)
    order(28, 1.0)
    assert received == [(5, 27), (6, 27), (5, 28)]
    listen(1.2)
    assert received[3:] == [(0, 28)]
    order(29, 0.0)
    order(29, 0.0)
    listen(1.2)
    assert received[4:] == [(5, 29), (1, 29), (0, 29)]
    order(30, 0.0)
    assert received[7:] == [(0, 30)]
    assert [value for _, what, _, value in mock.outputs if what == "gripper"] == [0.0, 1.0, 0.0]


@pytest.mark.parametrize("result", [mavlink.MAV_RESULT_TEMPORARILY_REJECTED, 6])
@pytest.mark.parametrize(("loss", "outcome"), [(0.0, "done"), (1.0, "unknown")])
def test_replies_of_a_gripper_to_doubled_and_ended_releases_are_no_refusals(
    result: int, loss: float, outcome: str
) -> None:
    pair, mock = flying(PX4, loss=loss)
    drop(pair, GRIPPER)
    reply = mavlink.MAVLink_command_ack_message(211, result, 0, 0, 255, FIRST_COMPONENT + 2)
    pair.client.receive_data(encoded_as_vehicle(reply), pair.now_us)
    pair.run_for(1.6)
    assert outcomes(pair) == [outcome]
    assert let_go(mock, GRIPPER) == (loss == 0.0)


def encoded_as_vehicle(message: Any) -> bytes:
    return Codec(1, 1).encode(message)
