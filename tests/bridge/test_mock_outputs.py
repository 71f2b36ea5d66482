"""The mock flies or switches every item of a mission, in the order of the stack."""

import math
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem, takeoff, waypoint
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.mock.body import wider_m
from autopilot_bridge.stacks.stacks import Stack
from tests.bridge.helpers import HOME
from tests.bridge.mock_exchange import (
    COPTER,
    PLANE,
    PX4,
    WAYPOINT,
    brief,
    each_stack,
    player_of,
    upload,
)
from tests.bridge.test_mock_physics import PX4_COPTER, Flown, M, flown

UP = takeoff(*HOME[:2], 340.0)
HOVER = MissionItem(17, 0, 363050000, -842000000, 340.0)
NAN = math.nan
copters = pytest.mark.parametrize("stack", [PX4_COPTER, COPTER], ids=lambda s: s.name)


def north(metres: float, **more: float) -> MissionItem:
    return replace(waypoint(36.3 + metres * M, -84.2, 340.0), **more)  # type: ignore[arg-type]


def do(command: int, *params: float) -> MissionItem:
    """Return a DO item with params 1 to 4."""
    p1, p2, p3, p4 = (*params, *(0.0,) * (4 - len(params)))
    return MissionItem(command, 2, 0, 0, 0.0, p1, p2, p3, p4)


def switched(flight: Flown) -> list[tuple[str, int, float]]:
    return [(what, number, value) for _, what, number, value in flight.mock.outputs]


def test_ardupilot_switches_all_it_has() -> None:
    dos = (
        do(183, 9, 1900),
        do(181, 2, 1),
        do(211, 7, 0),
        do(42600, 1, 1, 12.5, 1.0),
        do(42600, 1, 2, 12.5, 1.5),
        do(216, 1),
        do(183, 1, 1900),  # the output of the aileron
    )
    flight = flown(COPTER, (UP, north(60), *dos, HOVER))
    flight.steps(60.0)
    assert switched(flight) == [
        ("servo", 9, 1900.0),
        ("relay", 2, 1.0),
        ("gripper", 1, 0.0),
        ("winch", 1, 12.5),
        ("winch", 1, 1.5),
        ("sprayer", 1, 1.0),
    ]
    assert (6, "ServoRelayEvent: Channel 1 is already in use") in flight.mock.flight.texts
    times = [at_us for at_us, *_ in flight.mock.outputs]
    assert times == sorted(times)
    assert times[0] > 5_000_000


def test_px4_switches_gripper_winch_and_actuators() -> None:
    actuators = MissionItem(187, 2, 0, 0, 0.0, 0.5, NAN, -2.0, NAN)
    flight = flown(PX4_COPTER, (UP, north(60), do(211, 1, 0), actuators, do(42600, 1, 1, 3), HOVER))
    flight.steps(60.0)
    assert switched(flight) == [
        ("gripper", 1, 0.0),
        ("actuator", 1, 0.5),
        ("actuator", 3, -1.0),
        ("actuator", 5, 0.0),  # params 5 and 6 are the item's x and y
        ("actuator", 6, 0.0),
        ("winch", 1, 3.0),
    ]


def test_servo_outputs_are_sent_over_the_link() -> None:
    flight = flown(COPTER, (UP, north(60), do(183, 10, 1234), HOVER))
    flight.steps(60.0)
    mock = flight.mock
    mock.intervals.set(mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, 1e6)
    mock.handle_timer(0)
    for minute in range(80):  # later than 2**32 microseconds
        mock.handle_timer(60_000_000 * minute)
    received = [m for datagram in mock.data_to_send() for m in Codec(255, 190).decode(datagram)]
    servos = [m for m in received if m.get_type() == "SERVO_OUTPUT_RAW"]
    assert (servos[-1].servo9_raw, servos[-1].servo10_raw) == (0, 1234)


@pytest.mark.parametrize("stack", [PLANE, COPTER], ids=lambda s: s.vehicle)
def test_behind_the_last_nav_item_ardupilot_runs_one_do_item_and_px4_all(stack: Stack) -> None:
    dos = (do(211, 1, 0), do(211, 1, 1))
    flight = flown(stack, (UP, north(200), *dos))
    flight.steps(120.0)
    assert switched(flight) == [("gripper", 1, 0.0)]
    assert flight.mock.flight.mode == ("rtl" if stack.vehicle == "plane" else "mission")
    flight = flown(PX4, (UP, north(200), *dos))
    flight.steps(120.0)
    assert switched(flight) == [("gripper", 1, 0.0), ("gripper", 1, 1.0)]
    assert flight.mock.flight.mode == "mission"


def test_a_delay_holds_do_items_back_and_the_next_waypoint_drops_them() -> None:
    late = (do(112, 10), do(211, 1, 0))
    flight = flown(PLANE, (UP, north(200), *late, north(900), HOVER))
    flight.steps(120.0)
    assert switched(flight) == [("gripper", 1, 0.0)]
    never = (do(112, 300), do(211, 1, 0))
    flight = flown(PLANE, (UP, north(200), *never, north(900), HOVER))
    flight.steps(400.0)
    assert switched(flight) == []
    near = (do(114, 100), do(211, 1, 0))
    flight = flown(PLANE, (UP, north(200), *near, north(900), HOVER))
    while not flight.mock.outputs and flight.now_s < 120.0:
        flight.steps(0.125)
    assert flight.mock.flight.motion.north_m == pytest.approx(800.0, abs=5.0)


@each_stack
@pytest.mark.parametrize("times", [0, 2])
def test_jumps_repeat_what_lies_before_them(stack: Stack, times: int) -> None:
    first = 1 if stack.item_0_is_home else 0
    jump = do(177, first + 1, times)
    flight = flown(stack, (UP, north(150), north(400), do(211, 1, 0), jump, HOVER))
    flight.steps(250.0)
    assert switched(flight) == [("gripper", 1, 0.0)] * (times + 1)
    assert flight.mock.flight.current == first + 5
    flight.mock.flight.make_current(first, flight.now_s)
    flight.steps(250.0)
    assert len(flight.mock.outputs) == 2 * (times + 1)


def test_jumps_without_a_nav_item_between_them_end() -> None:
    flight = flown(PLANE, (do(177, 1, -1), UP))
    flight.steps(1.0)
    assert flight.mock.flight.target is None


# Items that are flown ---------------------------------------------------------------------------


@copters
def test_a_copter_stays_for_the_hold_time_of_the_waypoint(stack: Stack) -> None:
    flight = flown(stack, (UP, north(100, param1=8.0), do(211, 1, 0), HOVER))
    there = [m for m in flight.steps(60.0) if abs(m.north_m - 100.0) < 5.0]
    assert 8.0 <= len(there) * 0.125 < 14.0
    assert min(m.speed_m_s for m in there) < 0.5


@each_stack
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_loiter_time_ends_after_its_time_and_turns_by_its_sign(stack: Stack, sign: float) -> None:
    place = replace(HOVER, command=19, param1=60.0, param3=sign * 100.0)
    flight = flown(stack, (UP, place, do(211, 1, 0), north(100)))
    motions = []
    while not flight.mock.outputs and flight.now_s < 300.0:
        motions += flight.steps(0.125)
    took_s = flight.now_s
    assert 60.0 + 25.0 < took_s < 60.0 + 60.0
    if stack.vehicle == "plane":
        turned = motions[-1].heading_rad - motions[-40].heading_rad
        turned = (turned + math.pi) % math.tau - math.pi
        assert math.copysign(1.0, turned) == sign
        centre = flight.mock.flight.frame.local(place)
        off = math.hypot(motions[-1].north_m - centre[0], motions[-1].east_m - centre[1])
        # ArduPilot stores only the sign of this radius.
        asked_m = 80.0 if stack.name == "ardupilot" else 100.0
        assert off == pytest.approx(asked_m + wider_m(stack), abs=3.0)


@pytest.mark.parametrize("stack", [PLANE, COPTER], ids=lambda s: s.vehicle)
def test_ardupilot_flies_its_turns(stack: Stack) -> None:
    place = replace(HOVER, command=18, param1=2.0, param3=-60.0)
    flight = flown(stack, (UP, place, do(211, 1, 0), north(100)))
    motions = []
    while not flight.mock.outputs and flight.now_s < 400.0:
        motions += flight.steps(0.125)
    assert flight.mock.outputs
    centre = flight.mock.flight.frame.local(place)
    bearings = [math.atan2(m.east_m - centre[1], m.north_m - centre[0]) for m in motions]
    turned = sum(
        (after - before + math.pi) % math.tau - math.pi
        for before, after in zip(bearings[-300:], bearings[-299:], strict=False)
    )
    assert turned < -math.radians(450.0)
    last = [math.hypot(m.north_m - centre[0], m.east_m - centre[1]) for m in motions[-100:]]
    flown_m = 60.0 + (wider_m(stack) if stack.vehicle == "plane" else 0.0)
    assert max(abs(distance - flown_m) for distance in last) < 6.0


@each_stack
def test_loiter_to_alt_ends_at_its_altitude(stack: Stack) -> None:
    place = replace(HOVER, command=31, z=420.0, param2=70.0)
    flight = flown(stack, (UP, place, do(211, 1, 0), north(100)))
    while not flight.mock.outputs and flight.now_s < 300.0:
        flight.steps(0.125)
    assert flight.mock.flight.motion.altitude_m == pytest.approx(420.0, abs=2.5)


@each_stack
def test_speed_is_changed_within_limits(stack: Stack) -> None:
    dos = (do(178, 0, 14.0), do(178, 0, 99.0))
    flight = flown(stack, (UP, north(200), *dos, north(3000)))
    flight.steps(80.0)
    assert flight.mock.flight.motion.speed_m_s == 14.0
    assert flight.mock.flight.change_speed(0, -2.0)
    flight.steps(10.0)
    assert flight.mock.flight.motion.speed_m_s == 18.0


@each_stack
def test_landing_ends_on_the_ground_disarmed(stack: Stack) -> None:
    land = MissionItem(21, 3, 363000000 + round(1200 * M * 1e7), -842000000, 0.0)
    flight = flown(stack, (UP, north(400), do(189), land))
    motions = flight.steps(200.0)
    vehicle = flight.mock.flight
    assert not vehicle.armed
    assert not vehicle.crashed
    assert (vehicle.motion.altitude_m, vehicle.motion.speed_m_s) == (300.0, 0.0)
    # 4.5 s at 9 m/s, and 5 s times 5 m/s for slowing down, less 9 m
    beyond_m = 56.5 if (stack.name, stack.vehicle) == ("px4", "plane") else 0.0
    assert vehicle.motion.north_m == pytest.approx(1200.0 + beyond_m, abs=15.0)
    assert min(m.climb_m_s for m in motions) >= -4.0


@each_stack
def test_the_return_item_brings_it_home(stack: Stack) -> None:
    flight = flown(stack, (UP, north(600), do(20)))
    flight.steps(200.0)
    vehicle = flight.mock.flight
    home_m = math.hypot(vehicle.motion.north_m, vehicle.motion.east_m)
    if stack.vehicle == "copter":
        assert (vehicle.armed, vehicle.motion.altitude_m) == (False, 300.0)
        assert home_m < 1.5
        assert vehicle.mode == ("mission" if stack.name == "ardupilot" else "rtl")
    else:
        assert (vehicle.armed, vehicle.mode) == (True, "rtl")
        assert home_m == pytest.approx(80.0 + wider_m(stack), abs=3.0)


@each_stack
def test_what_the_checks_let_through_is_taken(stack: Stack) -> None:
    """Upload the items above to the mission server."""
    player = player_of(stack)
    ardupilot = stack.name == "ardupilot"
    dos = (183, 181, 216, 112, 114) if ardupilot else (187,)
    commands = (*dos, 211, 42600, 189, 177, 178, 93)
    items = [replace(do(number, 1.0, 1.0), frame=2) for number in commands]
    placed = [replace(WAYPOINT, command=number) for number in (19, 31, 21)]
    if ardupilot:
        placed.append(replace(WAYPOINT, command=18, param1=1.0))
    replies = upload(player, (WAYPOINT, *placed, *items, WAYPOINT))
    assert brief(replies)[-1] == ("MISSION_ACK", mavlink.MAV_MISSION_ACCEPTED)
