"""Uploads in flight: the reported mission is the mission that the vehicle holds and flies."""

from random import Random
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem, takeoff, waypoint
from autopilot_bridge.links.codec import Codec, Message
from autopilot_bridge.missions.read_back import as_read_back
from autopilot_bridge.missions.transfer import Address, TransferTiming
from autopilot_bridge.stacks.stacks import Stack, stack_named
from autopilot_bridge.vehicle.mission_activation import MissionActivation, Onboard
from tests.bridge.helpers import HOME, SECOND, Noting, Pair, line_of, mock_of

Items = tuple[MissionItem, ...]
PX4, ARDUPLANE = stack_named("px4", "plane"), stack_named("ardupilot", "plane")
both = pytest.mark.parametrize("stack", [PX4, ARDUPLANE], ids=lambda s: s.name)
ADDRESS = Address((255, 190), (1, 1), 0)
CODEC = Codec(1, 1)


def flying(stack: Stack, **more: Any) -> Pair:
    """Return a vehicle that has flown some items of its mission."""
    pair = Pair(mock_of(stack), **more)
    pair.run_for(1.0)
    pair.result_of(pair.client.upload((takeoff(*HOME[:2], 340.0), *line_of(6)), pair.now_us))
    pair.client.command("start mission", pair.now_us)
    pair.run_for(45.0)
    assert pair.mock.flight.mode == "mission"
    assert pair.mock.flight.airborne
    return pair


def held(pair: Pair) -> Items:
    return tuple(pair.mock.missions.items[1 if pair.mock.stack.item_0_is_home else 0 :])


def kept(items: Items, stack: Stack) -> Items:
    return tuple(as_read_back(item, stack) for item in items)


def near(pair: Pair, count: int) -> Items:
    """Return waypoints ahead that are so near that the first are passed soon."""
    position = pair.client.position
    assert position is not None
    place = (position.lat_deg, position.lon_deg)
    return tuple(
        waypoint(place[0] + 0.0006 * at, place[1] + 0.0008 * at, 400.0) for at in range(1, count)
    )


@pytest.mark.parametrize(
    "ten", [0, *(pytest.param(ten, marks=pytest.mark.long) for ten in range(1, 5))]
)
@pytest.mark.parametrize("loiters", [False, True], ids=["in mission", "in loiter"])
@both
def test_over_a_lossy_link_report_and_vehicle_agree_in_flight(
    stack: Stack, loiters: bool, ten: int
) -> None:
    """The link loses 20 % of the frames in each direction; with the long tests, 200 uploads."""
    for seed in range(10 * ten, 10 * ten + 10):
        rng = Random(seed)
        pair = flying(stack)
        if loiters:
            pair.client.command("hold", pair.now_us)
            pair.run_for(3.0)
        new = near(pair, rng.randint(3, 12))
        if rng.random() < 0.5:
            new = (takeoff(*HOME[:2], 340.0), *new)
        pair.up, pair.down = (
            Noting(loss=0.2, delay_us=30_000, jitter_us=30_000, seed=2 * seed + way)
            for way in range(2)
        )
        by_file = rng.random() < 0.5
        transfer_id = pair.client.upload(new, pair.now_us, holds_first=True, by_file=by_file)
        result = pair.result_of(transfer_id, within_s=200.0)
        assert held(pair) == kept(new, stack), (seed, result)
        assert result.outcome == "accepted", (seed, result)
        assert result.holds == "the new one"
        assert (pair.mock.flight.mode == "mission") != loiters, seed
        reached = pair.mock.flight.current
        for _ in range(20):  # no message in transit resets the current item
            pair.run_for(0.5)
            assert pair.mock.flight.current >= reached, seed
            reached = pair.mock.flight.current


def test_px4_that_passes_over_the_takeoff_is_flying_the_new_mission() -> None:
    """PX4 1.17 behaved as in this test.

    It reported only item 1, item 0 was commanded six times, and the upload was reported as failed.
    """
    pair = flying(PX4)
    pair.up = Noting()
    new = (takeoff(*HOME[:2], 340.0), *line_of(8, first=2))
    began_us = pair.now_us
    result = pair.result_of(pair.client.upload(new, pair.now_us))
    assert (result.outcome, result.holds) == ("accepted", "the new one")
    assert pair.now_us - began_us < 3 * SECOND
    assert pair.up.asked_to_begin() == []
    assert pair.mock.flight.current == 1


def test_px4_is_asked_to_begin_where_it_holds_the_very_same_mission() -> None:
    pair = flying(PX4)
    same = (takeoff(*HOME[:2], 340.0), *line_of(6))
    assert pair.mock.flight.current > 1
    pair.up = Noting()
    result = pair.result_of(pair.client.upload(same, pair.now_us))
    assert result.outcome == "accepted"
    assert len(pair.up.asked_to_begin()) == 1
    assert pair.mock.flight.current == 1  # the takeoff is skipped


@pytest.mark.parametrize("loiters", [False, True], ids=["in mission", "in loiter"])
def test_what_px4_holds_and_would_not_fly_is_refused_with_the_reason(loiters: bool) -> None:
    """PX4 1.17 in LOITER acknowledged the mission as accepted and logged "Mission rejected"."""
    pair = flying(PX4)
    if loiters:
        pair.client.command("hold", pair.now_us)
        pair.run_for(3.0)
    pair.mock.parameters.change("MIS_TKO_LAND_REQ", 2)
    result = pair.result_of(pair.client.upload(line_of(6, first=2), pair.now_us))
    assert (result.outcome, result.holds) == ("rejected", "the new one")
    assert "does not accept it for flight" in result.reason
    assert "MIS_TKO_LAND_REQ" in result.reason
    pair.mock.parameters.change("MIS_TKO_LAND_REQ", 0)
    better = pair.result_of(pair.client.upload(line_of(6, first=3), pair.now_us))
    assert better.outcome == "accepted"


def current(seq: int, plan_id: int = 77, state: int = 3, total: int = 9) -> Message:
    message = mavlink.MAVLink_mission_current_message(seq, total, state, 1)
    (received,) = CODEC.decode(CODEC.encode(message))
    received.mission_id = plan_id
    return received


def begun(stack: Stack, seq: int = 0, before: Onboard | None = None) -> MissionActivation:
    plan_id = 77 if stack is PX4 else None
    before = before or Onboard(5, 66 if stack is PX4 else None, False)
    return MissionActivation(ADDRESS, seq, seq, 9, plan_id, before, TransferTiming())


def acknowledged(result: int) -> Message:
    (received,) = CODEC.decode(
        CODEC.encode(mavlink.MAVLink_command_ack_message(224, result, 0, 0, 255, 190))
    )
    return received


def test_the_first_word_of_a_list_may_be_older_than_its_judgement() -> None:
    job = begun(PX4)
    assert job.start(0) == []
    job.receive(current(1), 100_000)
    assert job.result is None
    job.receive(current(1, state=1), 1_100_000)
    job.receive(current(1, state=1), 2_100_000)
    assert job.result is not None
    assert job.result.outcome == "rejected"


def test_the_id_of_another_list_is_never_taken_for_success() -> None:
    job = begun(PX4)
    job.start(0)
    for second in range(1, 6):
        job.receive(current(0, plan_id=88), second * SECOND)
    assert job.other_list
    assert job.result is not None
    assert job.result.outcome == "failed"


def test_where_nothing_is_seen_nothing_is_asked_again() -> None:
    job = begun(ARDUPLANE, seq=1)
    assert len(job.start(0)) == 1
    asked = [message for second in range(1, 60) for message in job.handle_timer(second * SECOND)]
    assert asked == []
    assert job.result is not None
    assert job.result.outcome == "failed"


def test_an_arduplane_that_is_seen_on_its_old_way_is_asked_again() -> None:
    job = begun(ARDUPLANE, seq=1)
    job.start(0)
    job.receive(current(5), 1 * SECOND)
    assert len(job.handle_timer(1_500_000)) == 1
    # The vehicle has reached the old target and continues in the new list.
    job.receive(current(6), 2_400_000)
    assert len(job.handle_timer(3_000_000)) == 1
    job.receive(current(2), 3_500_000)  # the acknowledgement was lost
    assert job.result is not None
    assert job.result.outcome == "accepted"


def test_an_arduplane_that_may_have_advanced_in_the_old_list_is_commanded_again() -> None:
    job = begun(ARDUPLANE, seq=1, before=Onboard(1, None, False))
    job.start(0)
    job.receive(current(1), 1 * SECOND)  # the old or the new target; it cannot be determined
    job.receive(current(2), 1_400_000)  # advanced, in the old or in the new list
    assert job.result is None
    assert len(job.handle_timer(1_500_000)) == 1
    job.receive(acknowledged(0), 1_600_000)
    assert job.result is not None
    assert job.result.outcome == "accepted"


@pytest.mark.parametrize(("answer", "outcome"), [(0, "accepted"), (2, "failed"), (4, "failed")])
def test_the_acknowledgement_settles_it(answer: int, outcome: str) -> None:
    job = begun(ARDUPLANE, seq=1)
    job.start(0)
    job.receive(acknowledged(answer), 50_000)
    assert job.result is not None
    assert job.result.outcome == outcome
