"""Telemetry events: units, directions, order, and requests of message rates."""

import math
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.mock import telemetry_source
from autopilot_bridge.mock.kinematics import Wind as Breeze
from autopilot_bridge.stacks.stacks import STACKS, Stack, stack_named
from autopilot_bridge.vehicle.client_events import (
    Attitude,
    Battery,
    GpsFix,
    Health,
    Position,
    Rebooted,
    Speed,
    Wind,
)
from autopilot_bridge.vehicle.message_rates import ALL_RATES_HZ
from autopilot_bridge.vehicle.telemetry import (
    Telemetry,
    battery,
    battery_of_system,
    gps_fix,
    health,
    speed,
)
from tests.bridge.helpers import SECOND, Pair, mock_of

PX4, PLANE = stack_named("px4", "plane"), stack_named("ardupilot", "plane")
COPTER = stack_named("ardupilot", "copter")
FLIGHTS = Path("/work/shared/data/flights")
each_stack = pytest.mark.parametrize("stack", STACKS, ids=lambda s: f"{s.name}-{s.kind}")


def event_of(message: Any) -> Any:
    """Return the only event of a message."""
    (event,) = Telemetry().events(message, 7)
    return event


@pytest.mark.parametrize("from_deg", [0.0, 45.0, 120.0, 240.0, 359.0])
def test_both_stacks_report_the_same_wind(from_deg: float) -> None:
    arduplane = event_of(telemetry_source.wind(from_deg, 6.0))
    px4 = event_of(telemetry_source.wind_cov(1, from_deg, 6.0, 300.0))
    for event in (arduplane, px4):
        off_deg = (event.from_deg - from_deg + 180.0) % 360.0 - 180.0
        assert off_deg == pytest.approx(0.0, abs=1e-4)
        assert event.speed_m_s == pytest.approx(6.0)


def test_a_south_wind_blows_north() -> None:
    message = mavlink.MAVLink_wind_cov_message(1, 5.0, 0.0, 0.0, 0.1, 0.1, 300.0, 0.0, 0.0)
    assert event_of(message) == Wind(7, 180.0, 5.0)
    # As sent by ArduPlane in a simulated wind of 5 m/s from 240 degrees.
    assert event_of(mavlink.MAVLink_wind_message(-121.52, 5.35, 0.0)).from_deg == pytest.approx(
        238.48
    )


def test_no_estimate_of_the_wind_is_not_a_calm() -> None:
    # As sent by ArduCopter 4.6.2 during a whole flight in 6 m/s of wind.
    assert Telemetry().events(mavlink.MAVLink_wind_message(-180.0, 0.0, 0.0), 7) == []


@pytest.mark.parametrize("place", [(0, 0), (3155, 359)])  # degrees times 1e7
def test_a_place_without_a_fix_is_no_place(place: tuple[int, int]) -> None:
    # As sent by ArduPlane 4.6.2 in its first seconds; these values ended an earlier service.
    nowhere = mavlink.MAVLink_global_position_int_message(9, *place, -80, -85, 0, 0, 0, 681)
    assert Telemetry().events(nowhere, 7) == []


def test_attitude_is_in_degrees_and_yaw_from_0_to_360() -> None:
    event = event_of(mavlink.MAVLink_attitude_message(1000, 0.5, -0.25, -math.pi / 2, 0, 0, 0))
    assert (event.boot_us, event.yaw_deg) == (1_000_000, pytest.approx(270.0))
    assert (event.roll_deg, event.pitch_deg) == pytest.approx((28.6479, -14.3239), abs=1e-3)


def test_values_that_the_autopilot_lacks_are_none() -> None:
    unknown = mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 65535, -1, -1, 0, 0, 0, 0, 0, 0)
    assert battery_of_system(unknown, 7) == Battery(7, 0, None, None, None)
    cells = [65535] * 10
    status = mavlink.MAVLink_battery_status_message(1, 0, 0, 32767, cells, -1, -1, 0, -1)
    assert battery(status, 7) == Battery(7, 1, None, None, None)
    no_satellites = mavlink.MAVLink_gps_raw_int_message(1, 0, 0, 0, 0, 0, 0, 0, 0, 255)
    assert gps_fix(no_satellites, 7) == GpsFix(7, "no gps", None)
    hud = mavlink.MAVLink_vfr_hud_message(math.nan, 4.0, 0, 30, 300.0, 1.0)
    assert speed(hud, 7) == Speed(7, None, 4.0, 1.0, 30)


def test_batteries_add_up_their_cells() -> None:
    cells = [4100, 4050, 4000] + [65535] * 7
    status = mavlink.MAVLink_battery_status_message(0, 0, 0, 32767, cells, 1250, 0, 0, 66)
    assert battery(status, 7) == Battery(7, 0, 66, 12.15, 12.5, 0)


def test_the_used_charge_and_the_autopilots_estimate_are_decoded() -> None:
    cells = [12_000] + [65535] * 9
    status = mavlink.MAVLink_battery_status_message(
        *(0, 0, 0, 32767, cells, 1250, 830, -1, 66), time_remaining=540
    )
    assert battery(status, 7) == Battery(7, 0, 66, 12.0, 12.5, 830, 540)


def test_an_unchanged_battery_is_reported_every_ten_seconds() -> None:
    telemetry = Telemetry()
    status = mavlink.MAVLink_battery_status_message(0, 0, 0, 32767, [65535] * 10, -1, -1, 0, 80)
    found = [each for second in range(31) for each in telemetry.events(status, second * 1_000_000)]
    assert [event.at_us for event in found] == [0, 10_000_000, 20_000_000, 30_000_000]


def test_unhealthy_sensors_are_reported_by_name() -> None:
    # As sent by ArduPlane on the ground before its EKF was ready, and by PX4 without a receiver.
    words = {(306282559, 51478591): ("terrain", "prearm check"), (65536, 0): ("rc receiver",)}
    for (enabled, healthy), expected in words.items():
        message = mavlink.MAVLink_sys_status_message(
            enabled, enabled, healthy, 0, 12600, 0, 99, 0, 0, 0, 0, 0, 0
        )
        assert health(message, 7) == Health(7, expected)


def test_late_and_doubled_messages_are_dropped_for_each_kind() -> None:
    telemetry = Telemetry()

    def attitude(boot_ms: int) -> int:
        return len(telemetry.events(telemetry_source.attitude(boot_ms, 0.0, 0.0, 0.0), 0))

    assert [attitude(ms) for ms in (0, 100, 100, 50, 200)] == [1, 1, 0, 0, 1]
    at_150 = mavlink.MAVLink_global_position_int_message(150, 360000000, 0, 0, 0, 0, 0, 0, 0)
    assert len(telemetry.events(at_150, 0)) == 1  # a message of another kind may be older


def test_states_are_reported_when_they_change() -> None:
    telemetry = Telemetry()
    kinds = [
        [type(event).__name__ for event in telemetry.events(message, at)]
        for at, message in enumerate(
            (
                telemetry_source.sys_status(80, 15.0),
                telemetry_source.sys_status(80, 15.0),
                telemetry_source.sys_status(79, 15.0),
                telemetry_source.sys_status(79, 15.0, mavlink.MAV_SYS_STATUS_SENSOR_GPS),
                telemetry_source.battery_status(78, 14.9),
                telemetry_source.sys_status(77, 14.8, mavlink.MAV_SYS_STATUS_SENSOR_GPS),
            )
        )
    ]
    # After the first BATTERY_STATUS, SYS_STATUS is not used for the battery.
    assert kinds == [["Health", "Battery"], [], ["Battery"], ["Health"], ["Battery"], []]


@each_stack
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_a_vehicle_reports_all_at_the_requested_rates(stack: Stack, loss: float) -> None:
    mock = mock_of(stack, wind=Breeze(240.0, 5.0))
    pair = Pair(mock, up=MemoryLink(loss=loss, seed=5), down=MemoryLink(loss=loss / 3, seed=6))
    pair.run_for(5.0)
    pair.client.command("takeoff", pair.now_us, 30.0)
    pair.run_for(60.0)
    since_us = pair.now_us
    pair.down = MemoryLink()
    pair.run_for(20.0)

    def hz(kind: type) -> float:
        return len([event for event in pair.of(kind) if event.at_us > since_us]) / 20.0

    assert [hz(kind) for kind in (Position, Attitude, Speed, Wind)] == pytest.approx(
        [4.0, 4.0, 2.0, 1.0], abs=0.11
    )
    assert pair.of(Wind)[-1].from_deg == pytest.approx(240.0, abs=1e-3)
    assert pair.of(Health)[-1].unhealthy == ()
    assert pair.of(GpsFix)[-1].fix == "3d"
    assert pair.of(Battery)[-1].percent == 100
    mock.telemetry.unhealthy = mavlink.MAV_SYS_STATUS_SENSOR_GPS
    mock.positions = False
    pair.run_for(2.0)
    assert pair.of(Health)[-1].unhealthy == ("gps",)
    assert pair.of(GpsFix)[-1].fix == "no fix"


def test_arducopter_is_asked_again_after_a_restart() -> None:
    pair = Pair(mock_of(COPTER))
    pair.run_for(10.0)
    pair.mock.reboot(pair.now_us)
    pair.mock.intervals.set(mavlink.MAVLINK_MSG_ID_ATTITUDE, SECOND)  # the message is already sent
    pair.run_for(4.5)
    assert len(pair.of(Rebooted)) == 1
    before = len(pair.of(Position))
    pair.run_for(5.0)
    assert len(pair.of(Position)) - before == pytest.approx(20, abs=1)


def test_a_restart_too_short_to_be_missed_is_noticed_by_what_stops() -> None:
    """ArduCopter then sends only heartbeats, which contain no time since boot."""
    pair = Pair(mock_of(COPTER))
    pair.run_for(20.0)
    pair.mock.reboot(pair.now_us)
    pair.run_for(30.0)
    before = len(pair.of(Position))
    pair.run_for(5.0)
    assert len(pair.of(Position)) - before == pytest.approx(20, abs=1)
    assert len(pair.of(Rebooted)) == 1


def test_requests_for_rates_end_without_an_answer() -> None:
    pair = Pair(mock_of(PX4))
    asked: list[Any] = []

    class Deaf(MemoryLink):
        def send(self, datagram: bytes, now_us: int) -> None:
            asked.extend(m for m in Codec(1, 1).decode(datagram) if m.get_type() == "COMMAND_LONG")

    pair.up = Deaf()
    pair.run_for(120.0)
    before = len(asked)
    assert len(ALL_RATES_HZ) < before < 120
    pair.run_for(60.0)
    assert len(asked) == before


@pytest.mark.skipif(not FLIGHTS.exists(), reason="no recordings on this machine")
@pytest.mark.parametrize(
    ("name", "wind"),
    [("arduplane_perimeter", (240.0, 5.0)), ("px4_fixedwing_perimeter", (None, 0.0))],
)
def test_recorded_flights_report_their_wind_battery_and_fix(
    name: str, wind: tuple[float | None, float]
) -> None:
    codec, telemetry = Codec(255, 190), Telemetry()
    data = (FLIGHTS / f"{name}.tlog").read_bytes()
    events, at = [], 0
    while at < len(data):
        length = 8 + 10 + data[at + 9] + 2
        for message in codec.decode(data[at + 8 : at + length]):
            events += telemetry.events(message, at)
        at += length
    winds = [event for event in events if isinstance(event, Wind)][-60:]
    assert sum(event.speed_m_s for event in winds) / 60 == pytest.approx(wind[1], abs=0.6)
    if wind[0] is not None:
        assert winds[-1].from_deg == pytest.approx(wind[0], abs=10.0)
    percents = [event.percent or 0 for event in events if isinstance(event, Battery)]
    assert percents[0] > percents[-1]
    assert [event for event in events if isinstance(event, GpsFix)][-1].satellites == 10
    assert len([event for event in events if isinstance(event, Attitude)]) > 1000
