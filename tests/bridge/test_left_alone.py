"""Transfers and commands in progress do not override a mode that a failsafe has selected."""

from collections.abc import Callable
from random import Random

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import takeoff
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.stacks.stacks import Stack, stack_named
from autopilot_bridge.vehicle.client_events import CommandFinished, Rebooted, TransferFinished
from autopilot_bridge.vehicle.commanded_modes import CommandedModes
from autopilot_bridge.vehicle.transfer_states import Phase
from tests.bridge.helpers import HOME, SECOND, Noting, Pair, line_of, mock_of

PX4, ARDUPLANE = stack_named("px4", "plane"), stack_named("ardupilot", "plane")
COPTER = stack_named("ardupilot", "copter")
each = pytest.mark.parametrize("stack", [PX4, ARDUPLANE, COPTER], ids=lambda s: s.name + s.vehicle)
LONG_S = 25.0


class Deaf(MemoryLink):
    """A link that loses acknowledgements of commands, so that commands are repeated."""

    def __init__(self, but: int = 0) -> None:
        super().__init__()
        self._but = but

    def send(self, datagram: bytes, now_us: int) -> None:
        messages = Codec(1, 1).decode(datagram)
        acks = [each for each in messages if each.get_type() == "COMMAND_ACK"]
        if all(each.command == self._but for each in acks):
            super().send(datagram, now_us)


def flying(stack: Stack, mode: str = "mission") -> Pair:
    pair = Pair(mock_of(stack))
    pair.run_for(1.0)
    pair.result_of(pair.client.upload((takeoff(*HOME[:2], 340.0), *line_of(30)), pair.now_us))
    pair.client.command("start mission", pair.now_us)
    pair.run_for(40.0)
    if mode == "hold":
        pair.client.command("hold", pair.now_us)
        pair.run_for(15.0)
    assert pair.mock.flight.mode == mode
    pair.events.clear()
    return pair


def failsafe(pair: Pair) -> None:
    """Simulate a low battery: the vehicle returns home by itself."""
    pair.mock.battery_percent = 14.0


def run_with_failsafe(pair: Pair, after_s: float) -> None:
    """Run for a time, trigger the failsafe, then run for a minute."""
    pair.run_for(after_s)
    failsafe(pair)
    pair.run_for(LONG_S)


# The moments of an upload, every quarter of a second from before its first message to after its
# end.
MOMENTS = [at / 4.0 for at in range(20)]


@pytest.mark.parametrize("by_file", [False, True], ids=["items", "file"])
@each
def test_a_failsafe_at_any_moment_of_an_upload_is_left_alone(stack: Stack, by_file: bool) -> None:
    if by_file and not stack.mission_files:
        pytest.skip("no mission files")
    for after_s in MOMENTS:
        pair = flying(stack)
        new = line_of(12, first=2)
        pair.client.upload(new, pair.now_us, holds_first=True, by_file=by_file)
        run_with_failsafe(pair, after_s)
        assert pair.mock.flight.mode == "rtl", after_s
        (ended,) = pair.of(TransferFinished)
        by_autopilot = "in the meantime" in ended.result.reason
        detected_us = pair.now_us - (LONG_S - 1.3) * SECOND  # the change is reported by a heartbeat
        assert by_autopilot or ended.at_us < detected_us, (after_s, ended.result)


def test_an_upload_to_px4_ends_when_the_autopilot_returns() -> None:
    # PX4 1.17 returns by its mission: it would fly a mission that arrives during its return.
    pair = flying(PX4)
    old = pair.mock.missions.items[:]
    pair.up = MemoryLink(delay_us=20_000)
    pair.client.upload(line_of(400, first=2), pair.now_us, holds_first=True)
    run_with_failsafe(pair, 0.5)
    (ended,) = pair.of(TransferFinished)
    assert (ended.result.outcome, ended.result.holds) == ("cancelled", "the old one")
    assert "in the meantime" in ended.result.reason
    assert pair.mock.missions.items == old


@pytest.mark.parametrize("by_order", [True, False], ids=["ordered", "failsafe"])
@pytest.mark.parametrize(
    "phase", [Phase.QUEUED, Phase.SENDING_ITEMS, Phase.READING_ITEMS, Phase.STARTING]
)
def test_px4_receives_nothing_of_a_mission_once_it_returns(phase: Phase, by_order: bool) -> None:
    # PX4 1.17 leaves its return for a mission that arrives, and for a change of the current item.
    for later in range(10):
        pair = flying(PX4)
        assert pair.mock.flight.current > 0  # so the mission on board must be started by a command
        pair.up, pair.down = Noting(delay_us=60_000), MemoryLink(delay_us=60_000)
        pair.client.download(pair.now_us)
        mission = (takeoff(*HOME[:2], 340.0), *line_of(30))
        number = pair.client.upload(mission, pair.now_us, check=True)
        while phase_of(pair, number) != phase:
            pair.run_for(0.01)
        if by_order:
            pair.run_for(0.01 * later)
            pair.client.command("return", pair.now_us)
        else:
            pair.run_for(0.1 * later)
            pair.mock.flight.set_mode("rtl", pair.now_us / 1e6)
            while pair.client.custom_mode != PX4.rtl_mode and pair.mock.flight.mode == "rtl":
                pair.run_for(0.01)
            if pair.mock.flight.mode != "rtl":
                continue  # the mission was started before the return was reported
        sent_before = len(pair.up.sent)
        pair.run_for(20.0)
        names = [message.get_type() for message in pair.up.sent[sent_before:]]
        assert not {"MISSION_SET_CURRENT", "MISSION_COUNT", "MISSION_ITEM_INT"} & {*names}, later
        assert pair.result_of(number, within_s=1.0).outcome in ("cancelled", "failed", "accepted")
        assert not by_order or pair.mock.flight.mode == "rtl", later


def phase_of(pair: Pair, transfer_id: int) -> Phase | None:
    queue = pair.client._jobs
    jobs = [*queue._queue, *([] if queue._job is None else [queue._job])]
    return next((job.phase for job in jobs if job.transfer_id == transfer_id), None)


@pytest.mark.parametrize("seed", range(8))
@each
def test_a_failsafe_over_a_lossy_link_is_left_alone(stack: Stack, seed: int) -> None:
    rng = Random(seed)
    pair = flying(stack)
    pair.up, pair.down = (
        MemoryLink(loss=0.2, delay_us=30_000, seed=2 * seed + way) for way in range(2)
    )
    pair.client.upload(line_of(12, first=2), pair.now_us, holds_first=True, by_file=False)
    pair.run_for(rng.uniform(0.0, 8.0))
    failsafe(pair)
    pair.run_for(4 * LONG_S)
    assert pair.mock.flight.mode == "rtl"


@pytest.mark.parametrize("after_s", [0.1, 0.5, 1.0, 1.5])
def test_a_disarmed_arduplane_that_leaves_auto_at_the_upload_accepts_it(after_s: float) -> None:
    """Seen after landings of ArduPlane 4.6.2: "Aircraft in auto without a running mission"."""
    pair = flying(ARDUPLANE)
    pair.mock.flight.touch(HOME[2])
    pair.mock.flight.armed = False
    pair.run_for(2.0)
    sent = pair.client.upload(line_of(30, first=2), pair.now_us, by_file=False)
    pair.run_for(after_s)
    pair.mock.flight.set_mode("rtl", pair.now_us / 1e6)
    assert pair.result_of(sent).outcome == "accepted"
    assert pair.mock.flight.mode == "rtl"
    assert not pair.mock.flight.armed


Order = Callable[[Pair], object]
ORDERS: dict[str, tuple[str, Order]] = {
    "start mission": ("hold", lambda pair: pair.client.command("start mission", pair.now_us)),
    "resume": ("hold", lambda pair: pair.client.command("resume", pair.now_us)),
    "hold": ("mission", lambda pair: pair.client.command("hold", pair.now_us)),
    "reposition": (
        "mission",
        lambda pair: pair.client.command("reposition", pair.now_us, 36.305, -84.195, 420.0),
    ),
    "orbit": (
        "mission",
        lambda pair: pair.client.command("orbit", pair.now_us, 36.305, -84.195, 420.0, 90.0),
    ),
}


@pytest.mark.parametrize("name", ORDERS)
@pytest.mark.parametrize("stack", [PX4, ARDUPLANE], ids=lambda s: s.name)
@pytest.mark.parametrize("every", [10, pytest.param(2, marks=pytest.mark.long)])
def test_an_order_is_not_repeated_against_a_failsafe(stack: Stack, name: str, every: int) -> None:
    """Acknowledgements are lost, so the command would be repeated again and again."""
    mode, order = ORDERS[name]
    for at in range(1, 33, every):
        pair = flying(stack, mode)
        pair.down = Deaf()
        order(pair)
        run_with_failsafe(pair, at / 4.0)
        if at < 28:  # the order is in progress when the failsafe begins
            (ended,) = pair.of(CommandFinished)
            assert not ended.accepted
            assert "changed to return in the meantime" in ended.reason
        assert pair.mock.flight.mode == "rtl", at / 4.0


def test_an_order_that_waits_does_not_go_out_against_a_failsafe() -> None:
    pair = flying(ARDUPLANE, "hold")
    pair.down = Deaf()
    pair.client.command("change speed", pair.now_us, 20.0)
    pair.client.command("start mission", pair.now_us)
    run_with_failsafe(pair, 1.0)
    assert pair.mock.flight.mode == "rtl"
    started, changed = sorted(pair.of(CommandFinished), key=lambda ended: ended.at_us)
    assert (started.name, changed.name) == ("start mission", "change speed")
    assert "changed to return in the meantime" in started.reason


def test_a_person_may_still_order_it_out_of_its_failsafe() -> None:
    pair = flying(ARDUPLANE)
    run_with_failsafe(pair, 1.0)
    pair.client.command("hold", pair.now_us)
    pair.run_for(3.0)
    assert pair.mock.flight.mode == "hold"
    assert pair.of(CommandFinished)[-1].accepted


def test_an_order_that_took_anothers_place_is_not_stopped_by_that_ones_mode() -> None:
    """A start takes effect late; the hold that replaced it continues until the vehicle holds."""
    pair = flying(PX4, "hold")
    slow = MemoryLink(delay_us=900_000)
    pair.up = slow
    pair.client.command("start mission", pair.now_us)
    pair.run_for(0.2)
    pair.up = MemoryLink(loss=1.0)
    pair.client.command("hold", pair.now_us)
    pair.run_for(1.0)
    for datagram in slow.receive(pair.now_us):
        pair.mock.receive_data(datagram, pair.now_us)
    pair.run_for(1.2)
    modes = [pair.mock.flight.mode]
    pair.up = MemoryLink()
    pair.run_for(4.0)
    assert [*modes, pair.mock.flight.mode] == ["mission", "hold"]


def test_a_vehicle_that_disarms_is_not_armed_by_a_start_under_way() -> None:
    pair = Pair(mock_of(ARDUPLANE))
    pair.run_for(1.0)
    pair.result_of(pair.client.upload((takeoff(*HOME[:2], 340.0), *line_of(5)), pair.now_us))
    pair.down = Deaf(but=mavlink.MAV_CMD_DO_SET_MODE)
    pair.client.command("start mission", pair.now_us)
    pair.run_for(1.1)
    assert pair.mock.flight.armed
    pair.mock.flight.armed = False
    pair.run_for(30.0)
    assert not pair.mock.flight.armed
    assert "disarmed in the meantime" in pair.of(CommandFinished)[-1].reason


def test_a_mode_that_was_asked_for_may_come_late_and_one_before_it_not_much_later() -> None:
    asked = CommandedModes()
    asked.expect((10,), 0)
    assert asked.has(10, 9 * SECOND)
    asked.expect((12,), 1 * SECOND)
    assert asked.has(12, 10 * SECOND)
    assert asked.has(10, 4 * SECOND)
    assert not asked.has(10, 4 * SECOND + 1)
    assert not asked.has(11, 2 * SECOND)


def test_a_failsafe_that_keeps_the_mode_is_not_thrown_out_of_its_landing() -> None:
    """In failsafe ArduPlane lands by its mission: only the state in its heartbeat changes."""
    pair = flying(ARDUPLANE)
    pair.up = Noting(delay_us=300_000)
    pair.client.upload(line_of(12, first=2), pair.now_us, by_file=False)
    pair.run_for(0.1)
    pair.mock.flight.failsafe = True
    reached = pair.mock.flight.current
    for _ in range(16):  # it continues its mission, and the landing is never interrupted
        pair.run_for(0.5)
        assert pair.mock.flight.current >= reached
        reached = pair.mock.flight.current
    (ended,) = pair.of(TransferFinished)
    assert ended.result.outcome == "failed"
    assert ended.result.holds == "the new one"
    assert "entered failsafe in the meantime" in ended.result.reason
    assert pair.up.asked_to_begin() == []


@pytest.mark.parametrize("stack", [PX4, ARDUPLANE], ids=["px4", "ardupilot"])
def test_no_command_is_repeated_or_continued_while_the_autopilot_may_have_restarted(
    stack: Stack,
) -> None:
    for after_s in (0.1 * step for step in range(1, 20)):
        pair = Pair(mock_of(stack))
        pair.run_for(8.0)
        pair.result_of(pair.client.upload((takeoff(*HOME[:2], 340.0), *line_of(5)), pair.now_us))
        pair.run_for(3.0)
        pair.down = Deaf()
        pair.client.command("start mission", pair.now_us)
        pair.run_for(after_s)
        pair.mock.reboot(pair.now_us)
        pair.up = Noted()
        pair.run_for(LONG_S)
        (rebooted,) = pair.of(Rebooted)
        assert not pair.of(CommandFinished)[-1].accepted
        undecided_us = range(rebooted.at_us - SECOND + 50_000, rebooted.at_us)
        assert not [at_us for at_us in pair.up.sent_at_us if at_us in undecided_us], after_s


class Noted(MemoryLink):
    """Records when a command is sent, except requests of message rates."""

    def __init__(self) -> None:
        super().__init__()
        self.sent_at_us: list[int] = []

    def send(self, datagram: bytes, now_us: int) -> None:
        for message in Codec(1, 1).decode(datagram):
            command = getattr(message, "command", mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)
            if command != mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                self.sent_at_us.append(now_us)
        super().send(datagram, now_us)
