"""The mock flies missions, and the client receives its reports."""

import copy
import copyreg
import math
import struct

import pytest

from autopilot_bridge.items import Items, change_speed
from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.missions.read_back import as_read_back
from autopilot_bridge.mock.body import wider_m
from autopilot_bridge.mock.kinematics import Limits, Motion, course_around, step_plane
from autopilot_bridge.stacks.stacks import Stack, stack_named
from autopilot_bridge.vehicle.client_events import (
    CommandFinished,
    Connected,
    ItemReached,
    LinkLost,
    LinkRestored,
    ModeChanged,
    Position,
    Rebooted,
)
from tests.bridge.helpers import HOME, Pair, flight_of, line_of, mock_of
from tests.bridge.mock_exchange import each_stack

# Copies of a flight contain messages of pymavlink, which contain their struct.
copyreg.pickle(struct.Struct, lambda packed: (struct.Struct, (packed.format,)))


def flying(stack: Stack) -> Pair:
    pair = Pair(mock_of(stack))
    pair.run_for(2.0)
    pair.result_of(pair.client.upload(flight_of(), pair.now_us))
    pair.client.command("start mission", pair.now_us)
    pair.run_for(2.0)
    return pair


@each_stack
def test_a_mission_is_flown_in_order_and_ends_in_its_loiter(stack: Stack) -> None:
    pair = flying(stack)
    assert pair.of(Connected)[0].stack == stack
    assert [event.accepted for event in pair.of(CommandFinished)] == [True]
    pair.run_for(240.0)
    assert [event.seq for event in pair.of(ItemReached)] == [0, 1, 2, 3]
    before = len(pair.of(Position))
    pair.run_for(60.0)
    last = pair.of(Position)[before:]
    assert len(last) == 240
    off_m = [
        math.hypot(
            (position.lat_deg - 36.31) * 111_000.0,
            (position.lon_deg + 84.19) * 111_320.0 * math.cos(math.radians(36.31)),
        )
        for position in last[80:]
    ]
    if stack.vehicle == "copter":
        assert max(off_m) < 2.0
    else:
        flown_m = 90.0 + wider_m(stack)
        assert max(abs(distance - flown_m) for distance in off_m) < 4.0
        turned = (last[-1].heading_deg - last[-5].heading_deg + 180.0) % 360.0 - 180.0
        assert turned < 0.0  # a negative radius is flown anticlockwise
    assert all(abs(position.altitude_amsl_m - 420.0) < 1.0 for position in last)


@each_stack
def test_a_mission_changed_in_flight_is_flown_from_its_first_item(stack: Stack) -> None:
    pair = flying(stack)
    pair.run_for(60.0)
    new = line_of(4, first=20)
    assert pair.result_of(pair.client.upload(new, pair.now_us)).outcome == "accepted"
    target = pair.mock.flight.target
    assert target is not None
    assert (target.item.x, target.item.y) == (new[0].x, new[0].y)


def test_ardupilot_flies_its_old_target_until_the_index_is_set() -> None:
    pair = flying(stack_named("ardupilot", "plane"))
    pair.run_for(60.0)
    old = pair.mock.flight.target
    pair.client.upload(line_of(6, first=20), pair.now_us)
    while pair.mock.missions.items[1:] != list(line_of(6, first=20)):
        pair.run(pair.now_us + 1000)
        assert pair.mock.flight.target is old
    pair.run_for(2.0)
    assert pair.mock.flight.target is not old


def test_hold_stops_a_mission_where_it_is() -> None:
    pair = flying(stack_named("px4", "plane"))
    pair.run_for(60.0)
    pair.client.command("hold", pair.now_us)
    pair.run_for(5.0)
    assert pair.mock.flight.mode == "hold"


def test_a_lost_link_is_reported_within_the_timeout_and_so_is_its_return() -> None:
    pair = flying(stack_named("px4", "plane"))
    pair.mock_alive = False
    pair.run_for(4.0)
    assert [event.silent_us for event in pair.of(LinkLost)] == [pytest.approx(3e6, abs=1e6)]
    pair.mock_alive = True
    pair.run_for(3.0)
    assert len(pair.of(LinkRestored)) == 1


def test_a_restart_of_the_autopilot_is_noticed() -> None:
    pair = flying(stack_named("ardupilot", "copter"))
    pair.run_for(20.0)
    pair.mock = mock_of(stack_named("ardupilot", "copter"))
    pair.run_for(5.0)
    assert len(pair.of(Rebooted)) == 1


def test_positions_are_true_to_the_ground() -> None:
    pair = flying(stack_named("px4", "plane"))
    pair.run_for(30.0)
    frame, motion = pair.mock.flight.frame, pair.mock.flight.motion
    position = pair.of(Position)[-1]
    assert position.lat_deg == pytest.approx(frame.global_position(motion)[0], abs=5e-5)
    # One degree of latitude at 36.3 N is 110,974 m, one of longitude 89,830 m (WGS84).
    assert frame.north_m_per_deg == pytest.approx(110_974, abs=15)
    assert frame.east_m_per_deg == pytest.approx(89_830, abs=15)
    assert position.altitude_relative_m == pytest.approx(
        position.altitude_amsl_m - HOME[2], abs=0.01
    )


@pytest.mark.parametrize("clockwise", [True, False])
def test_a_plane_joins_and_holds_a_circle(clockwise: bool) -> None:
    motion, limits = Motion(500.0, -300.0, 100.0), Limits()
    turn = limits.airspeed_m_s / 120.0
    for _ in range(1600):
        near = abs(math.hypot(motion.north_m, motion.east_m) - 120.0) < 24.0
        feed = (turn if clockwise else -turn) if near else 0.0
        step_plane(motion, course_around(motion, (0.0, 0.0), 120.0, clockwise), 100.0, limits, feed)
    assert math.hypot(motion.north_m, motion.east_m) == pytest.approx(120.0, abs=2.0)


NEW = (*line_of(5, first=20)[:2], *line_of(6, first=30)[2:])


class CutAfter(MemoryLink):
    """A link that fails for ever after a number of frames, counted in both directions."""

    left = 0

    def send(self, datagram: bytes, now_us: int) -> None:
        if CutAfter.left > 0:
            CutAfter.left -= 1
            super().send(datagram, now_us)


SHORTER = (*line_of(3, first=20)[:1], *line_of(3, first=30)[2:])


def frames_of_a_reupload(stack: Stack, by_file: bool, new: Items) -> int:
    """Return the number of frames, in both directions, from the call to the end of an upload."""
    CutAfter.left = 10_000
    pair = flying(stack)
    pair.run_for(60.0)
    pair.up, pair.down = CutAfter(), CutAfter()
    result = pair.result_of(reupload(pair, by_file, new))
    assert (result.outcome, pair.mock.flight.mode) == ("accepted", "mission")
    return 10_000 - CutAfter.left


def reupload(pair: Pair, by_file: bool, new: Items) -> int:
    return pair.client.upload(new, pair.now_us, holds_first=True, by_file=by_file)


@each_stack
@pytest.mark.parametrize("by_file", [False, True], ids=["items", "file"])
@pytest.mark.parametrize("replacement", [NEW, SHORTER], ids=["longer", "shorter"])
@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.long)])
def test_a_reupload_cut_at_any_message_leaves_the_old_the_new_or_a_hold(
    stack: Stack, by_file: bool, replacement: Items, every: int
) -> None:
    """The upload is cut after every fifth frame; the long test cuts it after each frame."""
    old, new = (
        tuple(as_read_back(item, stack) for item in items) for items in (flight_of(), replacement)
    )
    # After a shorter file, old items remain behind its endless loiter until they are removed.
    whole_ones = (old, new, (*new, *old[len(new) :])) if by_file else (old, new)
    hidden = 1 if stack.item_0_is_home else 0
    on_its_way = flying(stack)
    on_its_way.run_for(60.0)
    for frames in range(0, frames_of_a_reupload(stack, by_file, replacement), every):
        pair = copy.deepcopy(on_its_way)
        CutAfter.left = frames
        pair.up, pair.down = CutAfter(), CutAfter()
        transfer_id = reupload(pair, by_file, replacement)
        for _ in range(600):
            pair.run_for(0.1)
            flight = pair.mock.flight
            if flight.mode == "mission":
                # All remaining items belong to one mission. After a file upload a plane flies to
                # its old target until an item is set.
                whole = tuple(flight.items[hidden:])
                assert whole in whole_ones, frames
                assert flight.target is not None
                assert flight.target.item in (whole if not by_file else (*old, *new)), frames
            else:
                assert flight.mode == "hold"
        result = pair.result_of(transfer_id, within_s=60.0)
        expected = {"the old one": (old,), "the new one": (new,), "one of both": (old, new)}
        held = tuple(pair.mock.flight.items[hidden:])
        assert result.holds not in expected or held in expected[result.holds], (frames, result)


@pytest.mark.parametrize("vehicle", ["plane", "copter"])
def test_a_shorter_mission_goes_to_an_ardupilot_without_a_hold(vehicle: str) -> None:
    stack = stack_named("ardupilot", vehicle)
    CutAfter.left = 10_000
    pair = flying(stack)
    pair.run_for(60.0)
    pair.events.clear()
    assert pair.result_of(reupload(pair, True, SHORTER)).outcome == "accepted"
    assert pair.of(ModeChanged) == []
    assert len(pair.mock.flight.items) == 1 + len(SHORTER)
    assert pair.mock.flight.current == 1


@pytest.mark.parametrize("vehicle", ["plane", "copter"])
@pytest.mark.parametrize("items", [NEW, SHORTER], ids=["longer", "shorter"])
def test_a_mission_with_a_speed_goes_to_an_ardupilot_without_a_hold(
    vehicle: str, items: Items
) -> None:
    """ArduPlane 4.6.2 stores the position of home in a file's items without position (observed)."""
    pair = flying(stack_named("ardupilot", vehicle))
    pair.run_for(60.0)
    pair.events.clear()
    with_speed = (change_speed(0, 15.0), *items)
    assert pair.result_of(reupload(pair, True, with_speed)).outcome == "accepted"
    assert pair.of(ModeChanged) == []
    (read,) = (pair.result_of(pair.client.download(pair.now_us)).items or ())[:1]
    assert (read.x, read.y, read.z) == (0, 0, 0.0)


def test_a_shorter_mission_that_goes_on_behind_its_end_is_not_laid_over_the_old_one() -> None:
    pair = flying(stack_named("ardupilot", "plane"))
    pair.run_for(60.0)
    pair.events.clear()
    assert pair.result_of(reupload(pair, True, line_of(4)[:3])).outcome == "accepted"
    assert pair.of(ModeChanged) != []  # it held during the upload
