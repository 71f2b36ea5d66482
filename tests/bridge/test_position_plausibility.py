"""Implausible times since boot and positions, and remotes that are not the vehicle's."""

import math
import random
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.clients.shared_link import SharedLink
from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.field_limits import (
    BOUNDS,
    UNKNOWN,
    list_out_of_bounds,
    out_of_bounds,
)
from autopilot_bridge.vehicle.client_events import (
    AlarmEnded,
    ClockChanged,
    Implausible,
    ModeChanged,
    Position,
    Rebooted,
    RemoteChanged,
    SameSystemId,
)
from autopilot_bridge.vehicle.monitor import VehicleMonitor
from autopilot_bridge.vehicle.position_plausibility import BootClock
from autopilot_bridge.vehicle.remote_binding import RemoteBinding
from tests.bridge.helpers import SECOND

LAT, LON = 36.3, -84.2
DAY_US = 24 * 3600 * SECOND


def heartbeat(armed: bool = True, autopilot: int = mavlink.MAV_AUTOPILOT_PX4) -> Any:
    base_mode = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
    return mavlink.MAVLink_heartbeat_message(1, autopilot, base_mode, 4 << 16, 4, 3)


def position(boot_us: int, north_m: float = 0.0, up_m: float = 0.0) -> Any:
    where = (round((LAT + north_m / 111_320) * 1e7), round(LON * 1e7))
    heights = (round((400 + up_m) * 1e3), round((100 + up_m) * 1e3))
    return mavlink.MAVLink_global_position_int_message(
        boot_us // 1000 % 2**32, *where, *heights, 0, 0, 0, 0
    )


# Times --------------------------------------------------------------------------------------------


def stream(
    clock: BootClock, rate: float, seconds: float, every_s: float = 0.25, at_us: int = 0
) -> int:
    """Process times of an autopilot that booted at 0 of the link's clock; all must be accepted."""
    end_us = at_us + round(seconds * SECOND)
    while at_us < end_us:
        assert clock.judge(round(rate * at_us), at_us) == "kept"
        at_us += round(every_s * SECOND)
    return at_us


@pytest.mark.parametrize("rate", [0.2, 1.0, 3.0, 20.0, 100.0])
def test_one_time_far_ahead_is_not_used(rate: float) -> None:
    clock = BootClock()
    now_us = stream(clock, rate, 30.0)
    for days in (30, 1, 49):
        assert clock.judge(days * DAY_US, now_us) == "ahead"
        assert clock.judge(round(rate * now_us), now_us) == "kept"
    stream(clock, rate, 30.0, at_us=now_us)


def test_times_five_seconds_ahead_each_are_never_taken_up() -> None:
    clock = BootClock()
    now_us = stream(clock, 1.0, 20.0)
    forged_us = now_us
    for number in range(400):
        forged_us += 5 * SECOND
        assert clock.judge(forged_us, now_us) == "ahead"
        if number % 10 == 0:
            assert clock.judge(now_us, now_us) == "kept"
            now_us += SECOND // 4
            forged_us = max(forged_us, now_us)


def test_times_a_little_ahead_do_not_add_up() -> None:
    clock = BootClock()
    now_us = stream(clock, 1.0, 20.0)
    ahead_us, forged_us = 0, now_us
    for _ in range(2000):
        for _ in range(3):
            if clock.judge(forged_us + 2 * SECOND, now_us) == "kept":
                forged_us += 2 * SECOND
                ahead_us = max(ahead_us, forged_us - now_us)
        clock.judge(now_us, now_us)
        now_us += SECOND // 4
        forged_us = max(forged_us, now_us)
    assert ahead_us <= 4 * SECOND


def test_a_jump_counts_from_the_expected_time_and_not_from_the_latest_one() -> None:
    clock = BootClock()
    now_us = stream(clock, 1.0, 20.0)
    assert clock.judge(now_us + 2 * SECOND, now_us) == "kept"
    jumped_us = now_us + 4 * SECOND
    assert clock.ahead_us(jumped_us, now_us) == 4 * SECOND
    assert clock.judge(jumped_us, now_us) == "ahead"


def test_a_jump_back_in_the_first_second_of_a_fast_simulation_is_one() -> None:
    clock = BootClock()
    now_us = stream(clock, 20.0, 0.6, every_s=0.1)
    jumped_us = round(20.0 * now_us) - 8 * SECOND
    assert clock.ahead_us(jumped_us, now_us) < 0
    assert clock.judge(jumped_us, now_us) == "back"


@pytest.mark.parametrize("every_s", [0.1, 0.25, 1.0])
def test_a_restart_is_one_when_all_goes_on_from_zero(every_s: float) -> None:
    clock = BootClock()
    now_us = stream(clock, 1.0, 600.0, every_s)
    began_us = now_us
    verdicts = []
    while "rebooted" not in verdicts:
        now_us += round(every_s * SECOND)
        verdicts.append(clock.judge(now_us - began_us, now_us))
    assert set(verdicts[:-1]) == {"back"}
    assert SECOND <= now_us - began_us <= 5 * SECOND
    assert clock.judge(now_us - began_us + 1000, now_us + 1000) == "kept"


def test_an_old_time_that_goes_on_is_adopted_but_no_restart() -> None:
    clock = BootClock()
    now_us = stream(clock, 1.0, 600.0)
    verdicts = []
    for _ in range(20):
        now_us += SECOND // 4
        verdicts.append(clock.judge(now_us - 300 * SECOND, now_us))
    assert "rebooted" not in verdicts
    assert verdicts.index("changed") == 12  # three seconds


def test_one_true_message_keeps_another_time_out() -> None:
    clock = BootClock()
    now_us = stream(clock, 1.0, 600.0)
    for number in range(400):
        now_us += SECOND // 10
        assert clock.judge(number * SECOND // 10, now_us) == "back"
        if number % 9 == 8:
            assert clock.judge(now_us, now_us) == "kept"


@pytest.mark.parametrize("rate", [1.0, 20.0])
def test_times_ahead_that_are_used_make_no_true_one_old(rate: float) -> None:
    """The times ahead are within the tolerance for bursts and simulations."""
    clock = BootClock()
    now_us = stream(clock, rate, 60.0)
    used = 0
    for number in range(400):
        ahead_us = round(rate * SECOND * (number % 5))
        used += clock.judge(round(rate * now_us) + ahead_us, now_us) == "kept"
        assert clock.judge(round(rate * now_us), now_us) == "kept"
        now_us += SECOND // 4
    assert used > 200


def test_one_value_again_and_again_is_no_clock() -> None:
    clock = BootClock()
    now_us = stream(clock, 1.0, 60.0)
    for boot_us in (0, DAY_US):
        for _ in range(100):
            now_us += SECOND // 4
            assert clock.judge(boot_us, now_us) in ("ahead", "back")


def delays(chance: random.Random, longest_s: float) -> Iterator[float]:
    """Return delays in s of a link that sometimes stops and then delivers all data in a burst."""
    while True:
        for _ in range(chance.randrange(20, 200)):
            yield chance.uniform(0.0, 0.8)
        stopped_s = chance.uniform(1.0, longest_s)
        for number in range(round(stopped_s * 4)):
            yield stopped_s - number / 4


@pytest.mark.parametrize(("rate", "longest_s"), [(1.0, 40.0), (20.0, 8.0)])
@pytest.mark.parametrize("seed", range(5))
def test_delays_and_bursts_are_in_order(rate: float, longest_s: float, seed: int) -> None:
    clock, sent_us, arrivals = BootClock(), 0, []
    for _, delay_s in zip(range(20_000), delays(random.Random(seed), longest_s), strict=False):
        sent_us += SECOND // 4
        arrivals.append((sent_us + round(delay_s * SECOND), round(rate * sent_us)))
    latest_us = 0
    for at_us, boot_us in arrivals:  # a link does not change the order
        latest_us = max(latest_us, at_us)
        assert clock.judge(boot_us, latest_us) == "kept"


@pytest.mark.parametrize("seed", range(5))
def test_a_simulation_may_fall_behind_and_catch_up(seed: int) -> None:
    """The mock at 20 times real time falls behind if the machine is busy for seconds."""
    chance, clock = random.Random(seed), BootClock()
    now_us = boot_us = 0
    busy_until_us = 0
    for _ in range(20_000):
        now_us += SECOND // 50
        if now_us > busy_until_us and chance.random() < 0.002:
            busy_until_us = now_us + round(chance.uniform(0.5, 8.0) * SECOND)
        due_us = 20 * now_us
        step_us = 20 * SECOND // 50
        boot_us = min(due_us, boot_us + (step_us // 5 if now_us < busy_until_us else 8 * step_us))
        assert clock.judge(boot_us, now_us) == "kept"


# Places and alarms, folded with all else ----------------------------------------------------------


class Vehicle:
    """A client that receives the messages of one vehicle with 4 positions a second."""

    def __init__(self, max_speed_m_s: float | None = 60.0) -> None:
        self.client = NativeClient(max_speed_m_s=max_speed_m_s)
        self.now_us = 0
        self.boot_us = 0
        self.north_m = 0.0
        self.events: list[Any] = []
        self._codec = Codec(1, 1)

    def send(self, *messages: Any) -> None:
        for message in messages:
            self.client.receive_data(self._codec.encode(message), self.now_us)
        while (event := self.client.next_event()) is not None:
            self.events.append(event)

    def fly(self, seconds: float, between: Callable[[], Any] = lambda: None) -> None:
        for tick in range(round(seconds * 4)):
            self.now_us += SECOND // 4
            self.boot_us += SECOND // 4
            self.north_m += 5.0
            self.client.handle_timer(self.now_us)
            if tick % 4 == 0:
                self.send(heartbeat())
            self.send(position(self.boot_us, self.north_m))
            between()

    def of(self, kind: type) -> list[Any]:
        return [event for event in self.events if isinstance(event, kind)]

    def norths_m(self) -> list[float]:
        return [round((each.lat_deg - LAT) * 111_320) for each in self.of(Position)]


def test_a_place_that_cannot_be_reached_is_not_used() -> None:
    vehicle = Vehicle()
    vehicle.fly(20.0)
    vehicle.fly(
        10.0, lambda: vehicle.send(position(vehicle.boot_us + 1000, vehicle.north_m + 4000.0))
    )
    vehicle.fly(5.0)
    assert vehicle.norths_m() == [5 * n for n in range(1, 141)]
    (event,) = vehicle.of(Implausible)
    assert (event.kind, "4000 m" in str(event)) == ("jump", True)
    assert not vehicle.of(AlarmEnded)
    vehicle.fly(10.0)
    assert [ended.kind for ended in vehicle.of(AlarmEnded)] == ["jump"]


def test_a_height_that_cannot_be_reached_is_not_used() -> None:
    vehicle = Vehicle()
    vehicle.fly(5.0)
    vehicle.send(position(vehicle.boot_us + 1000, vehicle.north_m, 900.0))
    assert len(vehicle.of(Position)) == 20


def test_a_vehicle_that_stays_where_it_was_moved_to_is_there() -> None:
    vehicle = Vehicle()
    vehicle.fly(20.0)
    vehicle.north_m += 9000.0
    vehicle.fly(1.0)
    assert max(vehicle.norths_m()) == 400
    vehicle.fly(9.0)
    assert max(vehicle.norths_m()) == 9600
    assert [event.kind for event in vehicle.of(Implausible)] == ["jump", "jump"]
    assert "is now accepted" in str(vehicle.of(Implausible)[1])


def test_places_a_little_off_do_not_lead_away() -> None:
    vehicle = Vehicle()
    vehicle.fly(20.0)
    off_m = [0.0]

    def lead() -> None:
        for number in range(20):
            off_m[0] += 40.0
            vehicle.send(
                position(vehicle.boot_us + 1000 * (number + 1), vehicle.north_m + off_m[0])
            )

    vehicle.fly(10.0, lead)
    worst_m = max(north_m - 5.0 * n for n, north_m in enumerate(vehicle.norths_m(), start=1))
    assert worst_m < 1000.0
    off_m[0] = 0.0
    vehicle.fly(10.0)
    assert vehicle.norths_m()[-1] == vehicle.north_m


def test_after_a_restart_places_go_on() -> None:
    vehicle = Vehicle()
    vehicle.fly(600.0)
    vehicle.boot_us = 0
    vehicle.fly(10.0)
    assert len(vehicle.of(Rebooted)) == 1
    assert vehicle.norths_m()[-1] == vehicle.north_m
    assert not vehicle.of(Implausible)


def test_positions_before_the_first_healthy_estimate_are_no_reference() -> None:
    """ArduPlane 4.6.2 reports 0 m AMSL until its estimator has an origin."""
    vehicle = Vehicle()

    def ekf(flags: int) -> Any:
        return mavlink.MAVLink_ekf_status_report_message(flags, 0.1, 0.1, 0.1, 0.1, 0.1)

    def boot() -> None:
        for height_m, flags in ((0, mavlink.EKF_UNINITIALIZED), (394, 0x80), (394, 0x033F)):
            for _ in range(12):
                vehicle.now_us += SECOND // 4
                vehicle.boot_us += SECOND // 4
                at_home = position(vehicle.boot_us, up_m=height_m - 400.0)
                vehicle.send(heartbeat(armed=False), at_home, ekf(flags))

    boot()
    assert not vehicle.of(Implausible)
    assert len(vehicle.of(Position)) == 36
    vehicle.send(position(vehicle.boot_us + 1000, 4000.0, -6.0))
    assert len(vehicle.of(Implausible)) == 1
    vehicle.boot_us = 0
    boot()
    assert len(vehicle.of(Rebooted)) == 1
    assert len(vehicle.of(Implausible)) == 1


def test_a_clock_that_was_set_is_used_with_an_alarm() -> None:
    vehicle = Vehicle()
    vehicle.fly(60.0)
    vehicle.boot_us += 3600 * SECOND
    vehicle.fly(10.0)
    assert (len(vehicle.of(ClockChanged)), len(vehicle.of(Rebooted))) == (1, 0)
    assert [event.kind for event in vehicle.of(Implausible)] == ["clock", "clock"]
    assert vehicle.norths_m()[-1] == vehicle.north_m


def test_a_heartbeat_of_another_make_is_not_its() -> None:
    vehicle = Vehicle()
    vehicle.fly(5.0)
    vehicle.send(heartbeat(False, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA))
    assert [event.armed for event in vehicle.of(ModeChanged)] == [True]
    assert [event.kind for event in vehicle.of(Implausible)] == ["value"]


# Values -------------------------------------------------------------------------------------------

ABSURD = (math.nan, math.inf, -math.inf, 1e38, -1e38, 3.4e38)


def filled(kind: str, value: float) -> Iterator[tuple[str, Any]]:
    """Yield the message once for each float field, with this value in the field."""
    message_class = next(each for each in mavlink.mavlink_map.values() if each.msgname == kind)
    for field, type_name in zip(message_class.fieldnames, message_class.fieldtypes, strict=True):
        if type_name == "float":
            message = message_class(*[0 if n != "text" else b"" for n in message_class.fieldnames])
            setattr(message, field, value)
            yield field, message


@pytest.mark.parametrize("kind", ["WIND", "WIND_COV", "ATTITUDE", "VFR_HUD"])
@pytest.mark.parametrize("value", ABSURD)
def test_no_value_that_is_not_finite_becomes_an_event(kind: str, value: float) -> None:
    read = {bound.field for bound in BOUNDS[kind]}
    for field, message in filled(kind, value):
        watch = VehicleMonitor()
        events = watch.receive(message, 5)
        if field in read and not (math.isnan(value) and field in UNKNOWN.get(kind, ())):
            assert [type(event) for event in events] == [Implausible], field
            assert field in str(events[0])
        for event in events:
            numbers = [getattr(event, name) for name in event.__slots__]
            assert all(math.isfinite(n) for n in numbers if isinstance(n, float)), field


TEXTS = ("text", "file_url", "cam_definition_uri", "callsign")


@pytest.mark.parametrize("kind", sorted(set(BOUNDS) - {"MISSION_ITEM"}))
def test_bounds_hold_for_whole_numbers_too(kind: str) -> None:
    message_class = next(each for each in mavlink.mavlink_map.values() if each.msgname == kind)
    for bound in BOUNDS[kind]:
        for value in (bound.least - 1, bound.most + 1):
            lengths = zip(message_class.fieldnames, message_class.array_lengths, strict=True)
            message = message_class(
                *[b"" if n in TEXTS else [0] * length or 0 for n, length in lengths]
            )
            setattr(message, bound.field, value)
            assert out_of_bounds(message) == f"{kind}.{bound.field} is {value:g}"


def test_an_item_that_is_nowhere_is_not_read() -> None:
    def item(x: int, y: int, z: float, param1: float = 0.0, frame: int = 3) -> Any:
        return mavlink.MAVLink_mission_item_int_message(
            *(255, 190, 0, frame, 16, 0, 1, param1, 0.0, 0.0, math.nan, x, y, z)
        )

    assert out_of_bounds(item(363000000, -842000000, 100.0)) is None
    assert out_of_bounds(item(2**31 - 1, 2**31 - 1, 100.0)) is None
    assert out_of_bounds(item(910000000, 0, 100.0)) == "MISSION_ITEM_INT.x is 910000000"
    assert out_of_bounds(item(0, -1810000000, 100.0)) == "MISSION_ITEM_INT.y is -1810000000"
    assert out_of_bounds(item(0, 0, math.inf)) == "MISSION_ITEM_INT.z is inf"
    assert out_of_bounds(item(0, 0, 0.0, 1e38)) == "MISSION_ITEM_INT.param1 is 1e+38"
    good, bad = (MissionItem(16, 3, 0, 0, z) for z in (100.0, math.nan))
    assert list_out_of_bounds((good, bad)) is None  # an altitude that is undefined
    worse = MissionItem(16, 3, 0, 0, math.inf)
    assert list_out_of_bounds((good, worse)) == "item 1: MISSION_ITEM_INT.z is inf"


# Remotes ------------------------------------------------------------------------------------------


def kinds(source: RemoteBinding) -> list[type]:
    found = [type(alarm) for alarm in source.alarms]
    source.alarms.clear()
    return found


def test_the_remote_of_the_first_heartbeat_is_the_vehicles() -> None:
    source = RemoteBinding(3 * SECOND)
    assert not source.accepts("forger", False, 0)
    assert source.accepts("own", True, 1)
    assert not source.accepts("forger", True, SECOND)
    assert kinds(source) == []  # it may have moved
    assert source.accepts("own", False, SECOND + 1)
    assert kinds(source) == [SameSystemId]
    for number in range(100):
        assert not source.accepts("forger", True, 2 * SECOND + number)
        assert source.accepts("own", False, 2 * SECOND + number)
    assert kinds(source) == []
    source.handle_timer(11 * SECOND)
    assert kinds(source) == []
    source.handle_timer(12 * SECOND + 100)
    assert kinds(source) == [AlarmEnded]


@pytest.mark.parametrize("signed", [False, True])
def test_another_remote_takes_over_after_silence_by_a_heartbeat(signed: bool) -> None:
    source = RemoteBinding(3 * SECOND, signed=signed)
    source.accepts("own", True, 0)
    assert not source.accepts("other", True, 3 * SECOND - 1)
    assert not source.accepts("other", False, 3 * SECOND)
    assert source.accepts("other", True, 3 * SECOND)
    assert kinds(source) == ([] if signed else [RemoteChanged])
    assert source.accepts("own", True, 4 * SECOND)  # it was bound first
    assert not source.accepts("other", True, 4 * SECOND + 1)
    assert source.accepts("own", False, 4 * SECOND + 2)
    assert kinds(source) == [SameSystemId]
    source.handle_timer(80 * SECOND)
    assert kinds(source) == [AlarmEnded]


def test_on_a_link_that_calls_the_one_called_is_the_vehicle() -> None:
    source = RemoteBinding(3 * SECOND, called="10.0.0.1:14550")
    assert source.accepts("forger", True, 0)
    assert source.accepts("10.0.0.1:14550", True, 1)
    assert not source.accepts("forger", True, 2)
    assert kinds(source) == [SameSystemId]


def test_ever_new_remotes_are_not_remembered_for_ever() -> None:
    source = RemoteBinding(3 * SECOND)
    for number in range(1000):
        assert source.accepts(f"10.0.0.1:{number}", True, 4 * SECOND * number)
    assert len(source._ranked) <= 8
    assert source.accepts("10.0.0.1:0", True, 4 * SECOND * 1000)


def test_a_link_that_expects_its_vehicles_takes_notice_of_no_other() -> None:
    link = SharedLink("a", expects=True)
    hawk = link.expect(1)
    for system in (1, 2, 9):
        link.receive_frames("there", [Codec(system, 1).encode(heartbeat())], SECOND)
    assert list(link.clients) == [1]
    assert hawk.stack is not None
    assert link.next_event() is None
    assert hawk.next_event() is not None
