"""Commands in flight on each stack; a refusal is reported as text."""

import itertools
import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.missions.transfer import TransferTiming
from autopilot_bridge.mock.body import wider_m
from autopilot_bridge.stacks.stacks import STACKS, Stack, Step, stack_named
from autopilot_bridge.vehicle import orders
from autopilot_bridge.vehicle.client_events import CommandFinished, ModeChanged, Position, Rebooted
from autopilot_bridge.vehicle.command_sequence import CommandSequence
from autopilot_bridge.vehicle.sent_commands import SentCommands
from tests.bridge.helpers import HOME, Pair, flight_of, mock_of
from tests.bridge.mock_exchange import NOT_VTOLS

PX4, PLANE = stack_named("px4", "plane"), stack_named("ardupilot", "plane")
PX4_COPTER, COPTER = stack_named("px4", "copter"), stack_named("ardupilot", "copter")
each_stack = pytest.mark.parametrize("stack", STACKS, ids=lambda s: f"{s.name}-{s.kind}")
circling = pytest.mark.parametrize(
    "stack", [PX4, PX4_COPTER, PLANE], ids=lambda s: f"{s.name}-{s.vehicle}"
)
NORTH_M, EAST_M = 110_974.0, 89_830.0  # length of a degree at home
PLACE = (36.304, -84.196)


def outcome(pair: Pair, command_id: int, within_s: float = 30.0) -> CommandFinished:
    """Run until a command has ended."""
    for _ in range(round(within_s * 20)):
        for event in pair.of(CommandFinished):
            if event.command_id == command_id:
                assert isinstance(event, CommandFinished)
                return event
        pair.run_for(0.05)
    raise AssertionError(f"order {command_id} did not end within {within_s} s")


def accepted(pair: Pair, command_id: int) -> None:
    ended = outcome(pair, command_id)
    assert ended.accepted, ended.reason


def standing(stack: Stack, **link: float) -> Pair:
    up, down = (MemoryLink(**link, seed=seed) for seed in (3, 4))  # type: ignore[arg-type]
    speed = 18.0 if stack.vehicle == "plane" else 8.0
    pair = Pair(mock_of(stack, airspeed_m_s=speed), up, down)
    pair.run_for(5.0)
    return pair


def airborne(stack: Stack, **link: float) -> Pair:
    pair = standing(stack, **link)
    accepted(pair, pair.client.command("takeoff", pair.now_us, 60.0))
    pair.run_for(60.0)
    return pair


def distances_m(pair: Pair, place: tuple[float, float], last: int = 80) -> list[float]:
    return [
        math.hypot((at.lat_deg - place[0]) * NORTH_M, (at.lon_deg - place[1]) * EAST_M)
        for at in pair.of(Position)[-last:]
    ]


def turned_deg(pair: Pair, place: tuple[float, float]) -> float:
    """Return the change of bearing from a place in degrees, clockwise positive."""
    bearings = [
        math.degrees(
            math.atan2((at.lon_deg - place[1]) * EAST_M, (at.lat_deg - place[0]) * NORTH_M)
        )
        for at in pair.of(Position)[-40:]
    ]
    steps = itertools.pairwise(bearings)
    return sum((b - a + 180.0) % 360.0 - 180.0 for a, b in steps)


def mode(pair: Pair) -> str:
    pair.run_for(2.0)
    name: str = pair.of(ModeChanged)[-1].name
    return name


@each_stack
@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_takeoff_ends_at_the_height_asked_for(stack: Stack, loss: float) -> None:
    pair = airborne(stack, loss=loss)
    position = pair.of(Position)[-1]
    assert position.altitude_relative_m == pytest.approx(60.0, abs=2.0)
    assert pair.client.armed


@each_stack
@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_a_vehicle_flies_to_the_commanded_position_and_stays(stack: Stack, loss: float) -> None:
    pair = airborne(stack, loss=loss)
    accepted(pair, pair.client.command("reposition", pair.now_us, *PLACE, 390.0))
    pair.run_for(120.0)
    assert max(distances_m(pair, PLACE)) < (95.0 if stack.vehicle == "plane" else 2.0)
    assert pair.of(Position)[-1].altitude_amsl_m == pytest.approx(390.0, abs=1.0)


@circling
@pytest.mark.parametrize("radius_m", [120.0, -150.0])
def test_an_orbit_is_flown_at_its_radius_and_in_its_direction(
    stack: Stack, radius_m: float
) -> None:
    pair = airborne(stack, loss=0.1)
    accepted(pair, pair.client.command("orbit", pair.now_us, *PLACE, 390.0, radius_m, 12.0))
    pair.run_for(160.0)
    flown_m = abs(radius_m) + (wider_m(stack) if stack.vehicle == "plane" else 0.0)
    off_m = [abs(distance - flown_m) for distance in distances_m(pair, PLACE)]
    assert max(off_m) < 4.0
    assert math.copysign(1.0, turned_deg(pair, PLACE)) == math.copysign(1.0, radius_m)
    speeds = [math.hypot(p.velocity_north_m_s, p.velocity_east_m_s) for p in pair.of(Position)]
    assert speeds[-1] == pytest.approx(12.0, abs=0.3)


@circling
def test_an_orbit_moves_and_turns_round_when_ordered_again(stack: Stack) -> None:
    pair = airborne(stack)
    accepted(pair, pair.client.command("orbit", pair.now_us, *PLACE, 390.0, 120.0, 12.0))
    pair.run_for(100.0)
    there = (PLACE[0] + 0.002, PLACE[1])
    accepted(pair, pair.client.command("orbit", pair.now_us, *there, 390.0, -90.0, 12.0))
    pair.run_for(100.0)
    flown_m = 90.0 + (wider_m(stack) if stack.vehicle == "plane" else 0.0)
    assert max(abs(distance - flown_m) for distance in distances_m(pair, there)) < 4.0
    assert turned_deg(pair, there) < 0.0


def test_arducopter_reports_that_it_has_no_orbit() -> None:
    pair = standing(COPTER)
    with pytest.raises(BridgeError, match="no orbit command; use LOITER_TURNS"):
        pair.client.command("orbit", pair.now_us, *PLACE, 390.0, 100.0)


@pytest.mark.parametrize("stack", NOT_VTOLS)
def test_a_mission_is_paused_and_resumed_where_it_was_left(stack: Stack) -> None:
    pair = standing(stack, loss=0.1)
    pair.result_of(pair.client.upload(flight_of(), pair.now_us, by_file=False))
    accepted(pair, pair.client.command("start mission", pair.now_us))
    pair.run_for(60.0)
    before = pair.mock.flight.current
    assert before > 1
    accepted(pair, pair.client.command("hold", pair.now_us))
    assert mode(pair) == "hold"
    pair.run_for(20.0)
    assert pair.mock.flight.current == before
    accepted(pair, pair.client.command("resume", pair.now_us))
    assert mode(pair) == "mission"
    assert pair.mock.flight.current in (before, before + 1)


@each_stack
def test_a_hold_ends_a_reposition_where_the_vehicle_is(stack: Stack) -> None:
    pair = airborne(stack)
    accepted(pair, pair.client.command("reposition", pair.now_us, 36.33, -84.2, 390.0))
    pair.run_for(15.0)
    accepted(pair, pair.client.command("hold", pair.now_us))
    position = pair.of(Position)[-1]
    pair.run_for(60.0)
    assert max(distances_m(pair, (position.lat_deg, position.lon_deg))) < 170.0
    assert mode(pair) == "hold"


@each_stack
def test_a_vehicle_returns(stack: Stack) -> None:
    pair = airborne(stack)
    accepted(pair, pair.client.command("reposition", pair.now_us, *PLACE, 390.0))
    pair.run_for(60.0)
    accepted(pair, pair.client.command("return", pair.now_us))
    assert mode(pair) == "return"
    pair.run_for(90.0)
    assert max(distances_m(pair, HOME[:2], last=8)) < 95.0


@pytest.mark.parametrize("stack", [PX4, PX4_COPTER, COPTER], ids=lambda s: f"{s.name}-{s.kind}")
def test_a_vehicle_lands_where_it_is_and_disarms(stack: Stack) -> None:
    pair = airborne(stack)
    accepted(pair, pair.client.command("land", pair.now_us))
    pair.run_for(60.0)
    assert pair.of(Position)[-1].altitude_relative_m == pytest.approx(0.0, abs=0.6)
    assert not pair.client.armed


def test_arduplane_starts_from_the_mode_of_its_return_which_does_not_arm() -> None:
    pair = standing(PLANE)
    pair.result_of(pair.client.upload(flight_of(), pair.now_us))
    accepted(pair, pair.client.command("return", pair.now_us))
    refused = outcome(pair, pair.client.command("arm", pair.now_us))
    assert refused.reason == "COMPONENT_ARM_DISARM failed: Arm: RTL mode not armable"
    accepted(pair, pair.client.command("start mission", pair.now_us))
    pair.run_for(20.0)
    assert mode(pair) == "mission"
    assert pair.mock.flight.airborne


def test_arduplane_refuses_a_go_around_outside_a_landing() -> None:
    pair = airborne(PLANE)
    ended = outcome(pair, pair.client.command("go around", pair.now_us, *PLACE, 450.0))
    assert not ended.accepted
    assert "DO_GO_AROUND failed" in ended.reason


@pytest.mark.parametrize("stack", [PX4, PX4_COPTER, COPTER], ids=lambda s: f"{s.name}-{s.kind}")
def test_other_vehicles_go_around_to_a_place_and_height(stack: Stack) -> None:
    pair = airborne(stack)
    before_m = distances_m(pair, PLACE)[-1]
    accepted(pair, pair.client.command("go around", pair.now_us, *PLACE, 450.0))
    pair.run_for(120.0)
    assert distances_m(pair, PLACE)[-1] < min(before_m, 100.0)
    assert pair.of(Position)[-1].altitude_amsl_m == pytest.approx(450.0, abs=3.0)


def test_arduplane_lands_only_by_its_mission() -> None:
    pair = airborne(PLANE)
    ended = outcome(pair, pair.client.command("land", pair.now_us))
    assert (ended.accepted, ended.reason) == (
        False,
        "DO_LAND_START failed: Unable to start landing sequence",
    )


@each_stack
def test_speed_is_changed_in_flight(stack: Stack) -> None:
    pair = airborne(stack)
    accepted(pair, pair.client.command("reposition", pair.now_us, 36.33, -84.2, 390.0))
    accepted(pair, pair.client.command("change speed", pair.now_us, 11.0))
    pair.run_for(30.0)
    position = pair.of(Position)[-1]
    ground_m_s = math.hypot(position.velocity_north_m_s, position.velocity_east_m_s)
    assert ground_m_s == pytest.approx(11.0, abs=0.1)


@circling
def test_speed_is_changed_on_an_orbit(stack: Stack) -> None:
    pair = airborne(stack)
    accepted(pair, pair.client.command("orbit", pair.now_us, *PLACE, 390.0, 90.0, 15.0))
    pair.run_for(80.0)
    accepted(pair, pair.client.command("change speed", pair.now_us, 11.0))
    pair.run_for(15.0)
    position = pair.of(Position)[-1]
    ground_m_s = math.hypot(position.velocity_north_m_s, position.velocity_east_m_s)
    assert ground_m_s == pytest.approx(11.0, abs=0.3)
    flown_m = 90.0 + (wider_m(stack) if stack.vehicle == "plane" else 0.0)
    assert max(abs(distance - flown_m) for distance in distances_m(pair, PLACE, last=40)) < 4.0


def test_a_refusal_is_reported_with_its_command_and_result() -> None:
    pair = airborne(PLANE)
    accepted(pair, pair.client.command("hold", pair.now_us))
    ended = outcome(pair, pair.client.command("change speed", pair.now_us, 20.0))
    assert (ended.accepted, ended.reason) == (False, "DO_CHANGE_SPEED failed")


def test_a_return_takes_the_place_of_orders_that_have_not_ended() -> None:
    pair = airborne(PX4)
    pair.up = MemoryLink(loss=1.0)
    first = pair.client.command("reposition", pair.now_us, *PLACE, 390.0)
    second = pair.client.command("change speed", pair.now_us, 15.0)
    pair.run_for(1.0)
    pair.up = MemoryLink()
    accepted(pair, pair.client.command("return", pair.now_us))
    for command_id in (first, second):
        ended = outcome(pair, command_id)
        assert (ended.accepted, ended.replaced, ended.reason) == (False, True, "return replaced it")
    assert mode(pair) == "return"


def test_no_order_outlives_a_restart_of_the_autopilot() -> None:
    """The new mode ends the command before the times since boot show the restart."""
    pair = airborne(COPTER)
    pair.up = MemoryLink(loss=1.0)
    command_id = pair.client.command("start mission", pair.now_us)
    pair.mock.reboot(pair.now_us)
    pair.run_for(0.1)
    pair.up = MemoryLink()
    pair.mock.intervals.set(mavlink.MAVLINK_MSG_ID_ATTITUDE, 250_000)
    ended = outcome(pair, command_id)
    assert ended.reason == "the autopilot changed to stabilised in the meantime"
    assert pair.of(Rebooted) == []
    pair.run_for(15.0)
    assert len(pair.of(Rebooted)) == 1
    assert not pair.mock.flight.armed


def test_an_order_that_leaves_the_mode_ends_when_the_restart_is_recognised() -> None:
    pair = airborne(COPTER)
    pair.up = MemoryLink(loss=1.0)
    command_id = pair.client.command("change speed", pair.now_us, 6.0)
    pair.mock.reboot(pair.now_us)
    pair.mock.intervals.set(mavlink.MAVLINK_MSG_ID_ATTITUDE, 250_000)
    ended = outcome(pair, command_id)
    assert ended.reason == "the autopilot was restarted"
    assert [event.at_us for event in pair.of(Rebooted)] == [ended.at_us]


def test_orders_need_a_vehicle_and_takeoff_a_position() -> None:
    pair = Pair(mock_of(COPTER))
    with pytest.raises(BridgeError, match="no autopilot is connected"):
        pair.client.command("arm", 0)
    pair.mock.positions = False
    pair.run_for(3.0)
    with pytest.raises(BridgeError, match="not reported a position"):
        pair.client.command("takeoff", pair.now_us, 20.0)


@pytest.mark.parametrize(
    ("order", "words"),
    [
        (lambda: orders.takeoff(PX4, 0.0, 300.0), "takeoff to 0.0 m"),
        (lambda: orders.reposition(PX4, 91.0, 0.0, 300.0), "is not a valid position"),
        (lambda: orders.reposition(PLANE, math.nan, 0.0, 300.0), "is not a valid position"),
        (lambda: orders.reposition(PLANE, 0.0, 0.0, 300.0), "as their current position"),
        (lambda: orders.reposition(PLANE, 36.0, -84.0, math.nan), "altitude nan"),
        (lambda: orders.orbit(PX4, *PLACE, 300.0, 0.0), "orbit of radius 0.0"),
        (lambda: orders.orbit(PX4_COPTER, *PLACE, 300.0, 1001.0), "1 to 1000 m"),
        (lambda: orders.orbit(PX4_COPTER, *PLACE, 300.0, 50.0, -3.0), "speed of -3.0"),
        (lambda: orders.change_speed(PX4, math.inf), "speed of inf"),
        (lambda: orders.set_mode(COPTER, "orbit"), "has no mode 'orbit'; it has stabilised, acro"),
    ],
)
def test_what_makes_no_sense_is_not_sent(order: object, words: str) -> None:
    assert callable(order)
    with pytest.raises(BridgeError, match=words):
        order()


def test_modes_have_names_and_numbers() -> None:
    for stack in STACKS:
        for name, number in (
            ("mission", stack.mission_mode),
            ("hold", stack.hold_mode),
            ("return", stack.rtl_mode),
        ):
            assert stack.mode_number(name) == number
            assert stack.mode_name(number) == name
        numbers = {stack.mode_name(number) for _, number in stack.modes}
        assert numbers <= {name for name, _ in stack.modes}
    assert PX4.mode_name(50593792) == "hold"  # as its heartbeat reports on the ground
    assert PLANE.mode_name(99) == "mode 99"


# The sequence itself ----------------------------------------------------------------------------

OWN = (255, 190)
STEP = Step(mavlink.MAV_CMD_NAV_TAKEOFF, (0.0,))
TIMING = TransferTiming(timeout_us=1_000_000, retries=2)


def ack(result: int, target: tuple[int, int] = (255, 190), command: int = STEP.command) -> object:
    message = mavlink.MAVLink_command_ack_message(command, result, 0, 0, *target)
    message._header = mavlink.MAVLink_header(77, srcSystem=1, srcComponent=1)
    return message


def begun() -> CommandSequence:
    sequence = CommandSequence("takeoff", (1, 1), (STEP,), TIMING, SentCommands(OWN), PLANE)
    sequence.start(0)
    return sequence


@pytest.mark.parametrize("target", [(254, 190), (255, 191)])
def test_the_answer_to_another_station_is_not_ours(target: tuple[int, int]) -> None:
    sequence = begun()
    sequence.receive(ack(0, target), 1)
    assert sequence.outcome is None


@pytest.mark.parametrize("target", [(255, 190), (0, 0)])
def test_a_reply_to_us_or_without_a_target_ends_it(target: tuple[int, int]) -> None:
    sequence = begun()
    sequence.receive(ack(0, target), 1)
    assert sequence.outcome == (True, "accepted")


def test_a_command_in_progress_is_not_repeated() -> None:
    sequence = begun()
    sequence.receive(ack(mavlink.MAV_RESULT_IN_PROGRESS), 500_000)
    assert sequence.handle_timer(50_000_000) == []
    sequence.receive(ack(0), 51_000_000)
    assert sequence.outcome == (True, "accepted")
    late = begun()
    late.receive(ack(mavlink.MAV_RESULT_IN_PROGRESS), 500_000)
    late.handle_timer(61_000_000)
    assert late.outcome == (False, "NAV_TAKEOFF began but did not end within 60 s")


def test_the_reason_of_a_refusal_may_come_after_it() -> None:
    sequence = begun()
    sequence.receive(ack(mavlink.MAV_RESULT_FAILED), 10)
    sequence.handle_timer(200_000)
    assert sequence.outcome is None
    text = mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_CRITICAL, b"Arm: no position")
    text._header = mavlink.MAVLink_header(253, srcSystem=1, srcComponent=1)
    sequence.receive(text, 210_000)
    assert sequence.outcome == (False, "NAV_TAKEOFF failed: Arm: no position")


def test_repeats_are_counted_and_a_refusal_after_one_is_reported_with_that() -> None:
    sequence = begun()
    (again,) = sequence.handle_timer(1_000_000)
    assert again.confirmation == 1
    sequence.receive(ack(mavlink.MAV_RESULT_FAILED), 1_100_000)
    sequence.handle_timer(1_400_000)
    assert sequence.outcome == (
        False,
        "NAV_TAKEOFF failed when it was repeated; it may have been accepted before",
    )
    silent = begun()
    for second in (1, 2, 3):
        silent.handle_timer(second * 1_000_000)
    assert silent.outcome == (False, "NAV_TAKEOFF was not acknowledged")


def mode_change_received_by_px4() -> CommandSequence:
    step = PX4.set_mode(4 << 16)
    sequence = CommandSequence("resume", (1, 1), (step,), TIMING, SentCommands(OWN), PX4)
    sequence.start(0)
    sequence.receive(ack(0, command=step.command), 10_000)
    assert sequence.outcome is None
    return sequence


def test_px4_refuses_a_mode_after_it_has_acknowledged_the_receipt() -> None:
    refused, accepted, lost = (mode_change_received_by_px4() for _ in range(3))
    command = mavlink.MAV_CMD_DO_SET_MODE
    refused.receive(ack(mavlink.MAV_RESULT_TEMPORARILY_REJECTED, command=command), 20_000)
    refused.handle_timer(320_000)
    assert refused.outcome == (False, "DO_SET_MODE temporarily rejected")
    accepted.receive(ack(0, command=command), 20_000)
    assert accepted.outcome == (True, "accepted")
    assert lost.next_timer() == 510_000
    (again,) = lost.handle_timer(510_000)
    assert (again.command, again.confirmation) == (command, 1)
    lost.receive(ack(0, command=command), 520_000)
    refusal = ack(mavlink.MAV_RESULT_TEMPORARILY_REJECTED, command=command)
    lost.receive(refusal, 530_000)
    lost.handle_timer(830_000)
    assert lost.outcome == (
        False,
        "DO_SET_MODE temporarily rejected when it was repeated; it may have been accepted before",
    )


def test_px4_with_a_single_acknowledgement_accepts_a_mode_after_a_repeat() -> None:
    sequence, command = mode_change_received_by_px4(), mavlink.MAV_CMD_DO_SET_MODE
    assert len(sequence.handle_timer(510_000)) == 1
    sequence.receive(ack(0, command=command), 520_000)
    assert sequence.handle_timer(1_020_000) == []
    assert sequence.outcome == (True, "accepted")


def test_px4_is_not_armed_after_it_has_refused_the_mission_mode() -> None:
    sequence = CommandSequence("start mission", (1, 1), PX4.start, TIMING, SentCommands(OWN), PX4)
    (mode_change,) = sequence.start(0)
    assert sequence.receive(ack(0, command=mode_change.command), 10_000) == []
    refusal = ack(mavlink.MAV_RESULT_TEMPORARILY_REJECTED, command=mode_change.command)
    assert sequence.receive(refusal, 20_000) == []
    assert sequence.handle_timer(320_000) == []
    assert sequence.outcome == (False, "DO_SET_MODE temporarily rejected")


def test_a_refusal_that_arrives_after_the_timeout_is_not_followed_by_a_repeat() -> None:
    sent = SentCommands(OWN)
    sequence = CommandSequence("hold", (1, 1), (STEP,), TIMING, sent, PLANE, after_heartbeats=True)
    sequence.start(0)
    assert sequence.handle_timer(1_000_000) == []  # it would be repeated after a heartbeat
    sequence.receive(ack(mavlink.MAV_RESULT_FAILED), 1_100_000)
    heartbeat = mavlink.MAVLink_heartbeat_message(1, 3, 129, 12, 4, 3)
    heartbeat._header = mavlink.MAVLink_header(0, srcSystem=1, srcComponent=1)
    assert sequence.receive(heartbeat, 1_200_000) == []
    sequence.handle_timer(1_500_000)
    assert sequence.outcome == (
        False,
        "NAV_TAKEOFF failed when it was repeated; it may have been accepted before",
    )


class Plane:
    """A plane (default: ArduPlane) with the frames, answers and losses of a test."""

    autopilot = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA

    def __init__(self) -> None:
        self.client, self.now_us = NativeClient(rates_hz={}), 0
        self._codec, self._other_end = Codec(1, 1), Codec(9, 9)
        self.heartbeat(mode=10)
        self.sent()

    def receive(self, message: object) -> None:
        self.client.receive_data(self._codec.encode(message), self.now_us)

    def heartbeat(self, mode: int) -> None:
        self.receive(mavlink.MAVLink_heartbeat_message(1, self.autopilot, 129, mode, 4, 3))

    def acknowledge(self, command: int = mavlink.MAV_CMD_DO_SET_MODE) -> None:
        self.receive(mavlink.MAVLink_command_ack_message(command, 0, 0, 0, *OWN))

    def sent(self) -> list[float]:
        """Return the modes commanded since the last call."""
        messages = [
            each for data in self.client.data_to_send() for each in self._other_end.decode(data)
        ]
        return [each.param2 for each in messages if each.get_type() == "COMMAND_LONG"]

    def outcomes(self) -> list[tuple[str, bool]]:
        events = iter(self.client.next_event, None)
        return [(e.name, e.accepted) for e in events if isinstance(e, CommandFinished)]

    def wait(self, seconds: float, mode: int) -> None:
        """Let time pass, with a heartbeat each second."""
        for _ in range(round(seconds)):
            self.now_us += 1_000_000
            self.heartbeat(mode)
            self.client.handle_timer(self.now_us)


def test_the_late_acknowledgement_of_a_replaced_order_does_not_count_for_the_next_one() -> None:
    plane = Plane()
    plane.client.command("hold", plane.now_us)
    assert plane.sent() == [12.0]
    plane.now_us += 600_000
    plane.client.command("return", plane.now_us)
    assert plane.sent() == [11.0]  # lost on the link
    plane.now_us += 100_000
    plane.acknowledge()  # of the hold
    assert plane.outcomes() == [("hold", False)]
    plane.wait(5.0, mode=12)
    assert plane.sent() == [11.0]
    plane.acknowledge()
    assert plane.outcomes() == [("return", True)]


def test_an_order_whose_acknowledgement_may_belong_to_an_earlier_one_is_repeated() -> None:
    plane = Plane()
    plane.client.command("hold", plane.now_us)  # lost on the link
    plane.now_us += 600_000
    plane.client.command("return", plane.now_us)
    plane.sent()
    plane.now_us += 100_000
    plane.acknowledge()  # of the return
    assert plane.outcomes() == [("hold", False)]
    plane.wait(5.0, mode=11)
    assert plane.sent() == [11.0]
    plane.acknowledge()
    assert plane.outcomes() == [("return", True)]


def test_two_acknowledgements_of_a_replaced_order_do_not_count_for_the_next_one() -> None:
    """PX4 1.17 acknowledges each change of the mode twice."""
    plane = Plane()
    plane.client.command("return", plane.now_us)
    plane.now_us += 300_000
    plane.client.command("hold", plane.now_us)
    assert plane.sent() == [11.0, 12.0]  # the second one is lost on the link
    plane.acknowledge()
    plane.acknowledge()
    plane.wait(4.0, mode=11)
    assert plane.outcomes() == [("return", False)]
    assert plane.sent() == [12.0]
    plane.acknowledge()
    assert plane.outcomes() == [("hold", True)]


class Px4Plane(Plane):
    autopilot = mavlink.MAV_AUTOPILOT_PX4


@pytest.mark.parametrize("orders", [["return", "hold"] * 2, ["return", "return", "hold"]])
def test_each_of_two_acknowledgements_belongs_to_the_same_frame(orders: list[str]) -> None:
    """Returns and holds in a burst to PX4; the frame of the return at the end is lost."""
    px4 = Px4Plane()
    for order in orders:
        px4.client.command(order, px4.now_us)
        px4.now_us += 100_000
    for _ in range(2):  # of the first return
        px4.acknowledge()
    px4.client.command("return", px4.now_us)
    px4.sent()
    px4.now_us += 300_000
    for _ in range(2):  # of the second return
        px4.acknowledge()
    assert ("return", True) not in px4.outcomes()
    px4.wait(4.0, mode=3 << 24 | 4 << 16)
    assert px4.sent() == [4.0]
    for _ in range(2):
        px4.acknowledge()
    assert px4.outcomes() == [("return", True)]


def test_the_effect_of_a_replaced_order_on_a_slow_link_does_not_end_the_next_order() -> None:
    """Each way takes 1.2 s; the first frame of the return is lost."""
    px4 = Px4Plane()
    px4.client.command("hold", px4.now_us)
    px4.now_us += 400_000
    px4.client.command("return", px4.now_us)
    px4.sent()
    px4.now_us += 2_700_000
    px4.heartbeat(mode=3 << 24 | 4 << 16)
    assert px4.outcomes() == [("hold", False)]
    px4.wait(2.0, mode=3 << 24 | 4 << 16)
    assert px4.sent() == [4.0]


def test_a_heartbeat_from_before_an_order_does_not_show_its_effect() -> None:
    """A return is replaced by a hold, and this by another return; the frame of the last is lost."""
    plane = Plane()
    for order in ("return", "hold", "return"):
        plane.client.command(order, plane.now_us)
        plane.now_us += 300_000
    assert plane.sent() == [11.0, 12.0, 11.0]
    plane.acknowledge()
    plane.heartbeat(mode=11)  # in effect until the hold arrives
    plane.now_us += 500_000
    plane.acknowledge()
    plane.heartbeat(mode=12)
    assert plane.outcomes() == [("return", False), ("hold", False)]
    plane.wait(3.0, mode=12)
    assert plane.sent() == [11.0]


def test_an_acknowledgement_that_did_not_arrive_in_three_seconds_is_not_waited_for() -> None:
    plane = Plane()
    plane.client.command("hold", plane.now_us)  # lost on the link
    plane.sent()
    plane.now_us += 3_100_000
    plane.client.command("return", plane.now_us)
    plane.acknowledge()
    assert plane.outcomes() == [("hold", False), ("return", True)]
