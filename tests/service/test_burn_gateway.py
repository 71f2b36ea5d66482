"""Burns at the gateway: drops and climbs as client commands, battery and GPS fix as events."""

from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.errors import BridgeError
from autopilot_bridge.mock.fault_injection import FaultyMock
from autopilot_bridge.mock.fault_kinds import parse_faults
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle import client_events as bridge
from autopilot_bridge.vehicle.message_rates import RATES_HZ
from autopilot_bridge.vehicle.orders import Dropper
from mission_service.commands import ClimbAndHold, Drop
from mission_service.config.scenario import Scenario, load_scenario, parse_scenario
from mission_service.errors import ScenarioError
from mission_service.events import (
    BatteryUpdated,
    DropFinished,
    GpsFixChanged,
    ModeChanged,
    Telemetry,
    VehicleEvent,
)
from mission_service.runtime.gateway import Gateway, MissionClock, dropper_of, rates_hz
from tests.bridge.helpers import SECOND, mock_of

SERVO = Dropper("servo", 9, 1900.0, 1100.0)
POSITION = mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT


class Client:
    """A client that records commands and reports the given events."""

    stack = None

    def __init__(self, *events: Any) -> None:
        self.orders: list[Any] = []
        self.outgoing = list(events)

    def drop(self, dropper: Dropper, now_us: int) -> int:
        self.orders.append(("drop", dropper, now_us))
        if dropper.number == 16:
            raise BridgeError("no such output")
        return len(self.orders)

    def command(self, name: str, now_us: int, *arguments: float) -> None:
        self.orders.append((name, now_us, *arguments))

    def next_event(self) -> Any:
        return self.outgoing.pop(0) if self.outgoing else None


def gateway_of(client: Any, dropper: Dropper | None = SERVO) -> Gateway:
    return Gateway("drake", client, MissionClock(1000, wall=False), dropper)


def test_the_outcome_of_each_drop_is_reported_with_its_plan_and_number() -> None:
    client = Client()
    gateway = gateway_of(client)
    for number in (4, 5, 6):
        gateway.execute(Drop("drake", "abc", number, 36.0, -84.0), 7)
    assert client.orders == [("drop", SERVO, 7)] * 3
    outcomes = ((2, "unknown", "no answer"), (1, "done", "accepted"), (3, "refused", "denied"))
    client.outgoing = [bridge.DropFinished(9, *each) for each in outcomes]  # type: ignore[arg-type]
    client.outgoing.append(bridge.DropFinished(9, 44, "done", "of another client"))
    assert list(gateway.events(9)) == [
        DropFinished(1000, "drake", "abc", 5, False, False, "no answer"),
        DropFinished(1000, "drake", "abc", 4, True, False, "accepted"),
        DropFinished(1000, "drake", "abc", 6, False, True, "denied"),
    ]


@pytest.mark.parametrize(
    ("dropper", "words"),
    [(None, "no dropper is configured"), (SERVO._replace(number=16), "no such output")],
)
def test_a_drop_that_cannot_be_ordered_is_refused_in_words(
    dropper: Dropper | None, words: str
) -> None:
    gateway = gateway_of(Client(), dropper)
    gateway.execute(Drop("drake", "abc", 0, 36.0, -84.0), 7)
    assert list(gateway.events(9)) == [
        DropFinished(1000, "drake", "abc", 0, False, True, words),
    ]
    assert list(gateway.events(10)) == []


def test_climb_and_hold_is_the_clients_own_order() -> None:
    client = Client()
    gateway_of(client).execute(ClimbAndHold("drake", 36.0, -84.0, 380.0), 5)
    assert client.orders == [("climb and hold", 5, 36.0, -84.0, 380.0)]


def test_the_return_altitude_is_set_when_a_vehicle_of_a_burn_is_discovered() -> None:
    client = Client(bridge.Connected(3, stack_named("px4", "copter")))
    gateway = Gateway("drake", client, MissionClock(0, wall=False), SERVO, return_height_m=95.0)  # type: ignore[arg-type]
    assert len(list(gateway.events(4))) == 1
    assert client.orders == [("return height", 4, 95.0)]


def battery(at_us: int, number: int, percent: int | None, volts: float) -> bridge.Battery:
    return bridge.Battery(at_us, number, percent, volts, None)


def test_the_emptiest_battery_is_reported_when_it_changes() -> None:
    client = Client(
        battery(1, 0, None, 12.0),
        battery(2, 0, 80, 12.0),
        battery(3, 0, 80, 11.9),
        battery(4, 1, 60, 11.9),
        battery(5, 0, 79, 11.8),
        battery(6, 1, 59, 11.8),
    )
    events = list(gateway_of(client).events(9))
    reports = ((None, 12.0), (80.0, 12.0), (60.0, 11.9), (59.0, 11.8))
    assert events == [BatteryUpdated(1000, "drake", *report) for report in reports]


def test_an_unchanged_battery_is_reported_every_half_minute_in_floats() -> None:
    client, clock = Client(), MissionClock(0, wall=False)
    gateway = Gateway("drake", client, clock)  # type: ignore[arg-type]
    found: list[Any] = []
    for second in range(0, 70, 10):
        clock.now_us = second * 1_000_000
        client.outgoing = [bridge.Battery(clock.now_us, 0, 80, 12.0, 15.0, 900, 1200)]
        found += list(gateway.events(clock.now_us))
    values = (80.0, 12.0, 15.0, 900.0, 1200.0)
    assert len(found) == 3
    for event in found:
        shown: tuple[Any, ...] = (event.percent, event.voltage_v, event.current_a)
        shown = (*shown, event.consumed_mah, event.time_remaining_s)
        assert shown == values
        assert all(isinstance(value, float) for value in shown)


def test_the_fix_is_reported_when_it_changes() -> None:
    fixes = ("no fix", "2d", "2d", "3d", "3d", "rtk fixed", "no gps")
    client = Client(*(bridge.GpsFix(1, fix, place) for place, fix in enumerate(fixes)))
    events = list(gateway_of(client).events(9))
    assert events == [
        GpsFixChanged(1000, "drake", good, fix)
        for good, fix in (
            (False, "no fix"),
            (False, "2d"),
            (True, "3d"),
            (True, "rtk fixed"),
            (False, "no gps"),
        )
    ]


def burn(**vehicle: Any) -> Scenario:
    data = load_scenario("default").model_dump(exclude_unset=True)
    data["planner"] = {"rule": "burn"}
    data["vehicles"] = [
        {"name": "drake", "kind": "copter", "home_lat_deg": 36.3, "home_lon_deg": -84.2, **vehicle}
    ]
    data["burn"] = {
        "unit": [[36.3, -84.2], [36.31, -84.2], [36.31, -84.19]],
        "stations": [{"name": "anchor", "lat_deg": 36.3, "lon_deg": -84.2}],
        "dropper": {"by": "gripper", "number": 1},
    }
    return parse_scenario(data, Path("burn.toml"))


def test_burns_ask_for_positions_fast_and_for_what_keeps_them_safe() -> None:
    rates = rates_hz(burn())
    assert rates[POSITION] == 10.0
    assert {1, 24, 147} <= set(rates)  # SYS_STATUS, GPS_RAW_INT, BATTERY_STATUS
    assert rates_hz(load_scenario("default")) == RATES_HZ
    assert RATES_HZ[POSITION] == 4.0
    assert dropper_of(burn()) == Dropper("gripper", 1, 1900.0, 1100.0, 0.2)
    assert dropper_of(load_scenario("default")) is None


@pytest.mark.parametrize("stack", ["px4", "ardupilot"])
def test_a_mock_with_faults_reports_its_battery_and_its_fix(stack: str) -> None:
    mock = mock_of(stack_named(stack, "copter"), battery_minutes=30.0)
    faulty = FaultyMock(mock, parse_faults(["gps-loss@12..20", "battery-low@25"]))
    client = NativeClient(rates_hz=rates_hz(burn()))
    gateway = Gateway("drake", client, MissionClock(0, wall=False), SERVO)
    timed_events: list[tuple[float, VehicleEvent]] = []
    for now_us in range(0, 30 * SECOND, 25_000):
        faulty.handle_timer(now_us)
        for datagram in faulty.data_to_send():
            client.receive_data(datagram, now_us)
        client.handle_timer(now_us)
        timed_events += [(now_us / 1e6, event) for event in gateway.events(now_us)]
        for datagram in client.data_to_send():
            faulty.receive_data(datagram, now_us)
    fixes = [(at_s, event.good) for at_s, event in timed_events if isinstance(event, GpsFixChanged)]
    assert [good for _, good in fixes] == [True, False, True]
    assert [at_s for at_s, _ in fixes[1:]] == pytest.approx([12.0, 20.0], abs=1.5)
    batteries = [event.percent for _, event in timed_events if isinstance(event, BatteryUpdated)]
    assert batteries == [100.0, 14.0]
    steady = [
        at_s for at_s, event in timed_events if isinstance(event, Telemetry) and 8 < at_s < 12
    ]
    assert len(steady) == 31  # between the two; the mock computes 8 steps a second
    assert not any(
        12.1 < at_s < 20.0 for at_s, event in timed_events if isinstance(event, Telemetry)
    )
    assert any(isinstance(event, ModeChanged) for _, event in timed_events) is False


@pytest.mark.parametrize(
    ("stack", "by", "words"),
    [("px4", "servo", "PX4 has no DO_SET_SERVO"), ("ardupilot", "actuator", "no DO_SET_ACTUATOR")],
)
def test_a_scenario_whose_vehicle_has_no_such_dropper_is_refused(
    stack: str, by: str, words: str
) -> None:
    data = burn(stack=stack).model_dump(exclude_unset=True)
    data["burn"]["dropper"] = {"by": by}
    with pytest.raises(ScenarioError, match=words):
        parse_scenario(data, Path("burn.toml"))
