"""The gateway between core and client: requests, commands and events."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.missions.transfer import TransferResult
from autopilot_bridge.stacks.stacks import Stack, stack_named
from autopilot_bridge.vehicle import client_events as bridge
from autopilot_bridge.vehicle.message_rates import RATES_HZ, rates_for
from mission_service.commands import ChangeSpeed, GoAround, Hold, Orbit, Return
from mission_service.config.scenario import load_scenario
from mission_service.events import (
    AutopilotText,
    CommandFinished,
    EstimatorStatusChanged,
    FenceStatusChanged,
    GpsFixChanged,
    LandedStateChanged,
    ModeChanged,
    RemoteIdChanged,
    SystemStateChanged,
    WindMeasured,
)
from mission_service.runtime.gateway import Gateway, MissionClock
from mission_service.simulation.sim import simulate


class Client:
    """A client that records commands and reports the given events."""

    stack: Stack | None = None

    def __init__(self, *events: bridge.ClientEvent) -> None:
        self.orders: list[str] = []
        self._events = list(events)

    def __getattr__(self, name: str) -> Any:
        return lambda *args: self.orders.append(args[0] if name == "command" else name)

    def report(self, event: bridge.ClientEvent) -> None:
        self._events.append(event)

    def next_event(self) -> bridge.ClientEvent | None:
        return self._events.pop(0) if self._events else None


def test_a_return_is_ordered_of_the_client() -> None:
    client = Client()
    gateway = Gateway("hawk", client, MissionClock(0, wall=False))
    gateway.execute(Return("hawk"), 0)
    gateway.execute(Hold("hawk"), 0)
    assert client.orders == ["return", "hold"]


def test_an_order_to_a_vehicle_that_is_not_connected_is_refused_and_stops_no_other() -> None:
    gateway = Gateway("hawk", NativeClient(), MissionClock(0, False))
    gateway.execute(GoAround("hawk", 36.0, -84.0, 400.0), 0)
    (refused,) = gateway.events(0)
    assert refused == CommandFinished(
        *(0, "hawk", "go around", False),
        "no autopilot is connected yet; wait for the event Connected",
    )


def test_orbits_and_speeds_are_the_clients_own_orders() -> None:
    ordered: list[tuple[Any, ...]] = []

    class Ordered(Client):
        def __getattr__(self, name: str) -> Any:
            return lambda *args: ordered.append((name, *args))

    gateway = Gateway("hawk", Ordered(), MissionClock(0, wall=False))
    gateway.execute(Orbit("hawk", 36.0, -84.0, 700.0, -150.0), 5)
    gateway.execute(ChangeSpeed("hawk", 17.5), 6)
    assert ordered == [
        ("command", "orbit", 5, 36.0, -84.0, 700.0, -150.0),
        ("command", "change speed", 6, 17.5),
    ]


def test_wind_and_modes_are_reported_with_mission_time() -> None:
    client = Client(bridge.Wind(7, 45.04, 6.001), bridge.ModeChanged(8, 5, True, "return"))
    gateway = Gateway("hawk", client, MissionClock(1000, wall=False))
    assert list(gateway.events(9)) == [
        WindMeasured(1000, "hawk", 6.0, 45.0),
        ModeChanged(1000, "hawk", 5, True, "return"),
    ]


@pytest.mark.parametrize(
    ("stack", "message"),
    [("px4", mavlink.MAVLINK_MSG_ID_WIND_COV), ("ardupilot", mavlink.MAVLINK_MSG_ID_WIND)],
)
def test_each_stack_is_asked_for_its_own_message_of_the_wind(stack: str, message: int) -> None:
    asked = rates_for(stack_named(stack, "plane"), RATES_HZ)
    assert asked[message] <= 0.2
    winds = {mavlink.MAVLINK_MSG_ID_WIND_COV, mavlink.MAVLINK_MSG_ID_WIND}
    assert winds & set(asked) == {message}


@pytest.mark.parametrize(
    ("stack", "own", "other"),
    [
        ("px4", {"ESTIMATOR_STATUS"}, {"EKF_STATUS_REPORT", "FENCE_STATUS"}),
        ("ardupilot", {"EKF_STATUS_REPORT", "FENCE_STATUS"}, {"ESTIMATOR_STATUS"}),
    ],
)
def test_each_stack_is_asked_for_what_shows_its_trouble(
    stack: str, own: set[str], other: set[str]
) -> None:
    asked = rates_for(stack_named(stack, "plane"), RATES_HZ)
    names = {mavlink.mavlink_map[number].msgname: hz for number, hz in asked.items()}
    assert names["EXTENDED_SYS_STATE"] == 4.0
    for name in own | {"GPS_RAW_INT"}:
        assert names[name] == 1.0
    assert not other & set(names)
    assert {"SYS_STATUS", "BATTERY_STATUS"} <= set(names)


@pytest.mark.parametrize("stack", ["px4", "ardupilot"])
def test_simulated_vehicles_measure_the_wind_of_the_fire(stack: str, tmp_path: Any) -> None:
    from mission_service.journal.journal_file import SegmentReader

    overrides = (f"vehicles.0.stack={stack}", "start_s=3500", "duration_s=3700")
    path = tmp_path / "journal.jsonl"
    simulate(load_scenario("default", overrides), path, "")
    winds = [
        entry.content for entry in SegmentReader(path) if isinstance(entry.content, WindMeasured)
    ]
    assert 10 < len(winds) < 45
    assert {(wind.speed_m_s, wind.from_deg) for wind in winds} == {(4.0, 45.0)}


def at(boot_s: float) -> bridge.Position:
    """Return a position with a time of the autopilot's own clock."""
    return bridge.Position(0, round(boot_s * 1e6), 36.0, -84.0, 500.0, 100.0, 0.0, 0.0, 0.0, 0.0)


def behind_s(rates: dict[str, float], seconds: int, delay: range = range(0)) -> list[float]:
    """Return the delay of swift behind hawk each second, over a link that delivers in bursts."""
    clock = MissionClock(0, wall=False)
    clients = {name: Client() for name in rates}
    gateways = {name: Gateway(name, client, clock) for name, client in clients.items()}
    found = []
    for second in range(seconds):
        reached_s = {}
        for name, client in clients.items():
            client.report(at(100.0 + rates[name] * second))
            held = name == "swift" and second in delay
            for event in [] if held else gateways[name].events(second * 1_000_000):
                reached_s[name] = event.at_us / 1e6
        if len(reached_s) == 2:
            found.append(reached_s["hawk"] - reached_s["swift"])
    return found


def test_a_vehicle_slower_than_the_others_stays_with_them() -> None:
    # Two simulators at 4 and 3.9 times real time; found when ArduCopter was 13 s behind PX4.
    found = behind_s({"hawk": 4.0, "swift": 3.9}, 300)
    assert max(found) < 2.5
    assert found[-1] >= 0.0


def test_a_vehicle_that_was_only_delayed_is_not_set_forward() -> None:
    assert set(behind_s({"hawk": 1.0, "swift": 1.0}, 60, delay=range(20, 45))) == {0.0}


def test_a_vehicle_that_joined_while_another_was_lost_is_seen_by_it() -> None:
    clock = MissionClock(0, wall=False)
    hawk, swift = Client(), Client()
    gateways = Gateway("hawk", hawk, clock), Gateway("swift", swift, clock)
    for second in range(100):
        if not 10 <= second < 70:
            hawk.report(at(500.0 + second))
        if second >= 60:
            swift.report(at(20.0 + second))
        events = [[*gateway.events(second * 1_000_000)] for gateway in gateways]
    assert events[0][0].at_us - events[1][0].at_us == 0


@pytest.mark.parametrize("rate", [1.0, 5.0])
def test_mission_time_continues_while_all_vehicles_are_switched_off(rate: float) -> None:
    clock, client = MissionClock(0, wall=False), Client()
    gateway = Gateway("hawk", client, clock)
    for second in range(4000):
        if 600 <= second < 1200:  # the batteries are changed
            client.report(bridge.ClockChanged(second * 1_000_000))
        elif not 2400 <= second < 2460:  # the link is lost
            started_s = 0 if second < 600 else 1200
            client.report(at(20.0 + rate * (second - started_s)))
        list(gateway.events(second * 1_000_000))
        assert clock.now_us / 1e6 == pytest.approx(rate * second, abs=rate * 12.0)
        if second in (599, 1199, 1200, 2399, 2459, 2470, 3999):
            assert clock.now_us / 1e6 == pytest.approx(rate * second, abs=rate * 1.01)


def texts(*reported: tuple[float, int, str]) -> list[tuple[int, str]]:
    """Return the announced texts for texts sent at these seconds of the link's clock."""
    client = Client(
        *(bridge.Text(round(at_s * 1e6), level, text) for at_s, level, text in reported)
    )
    gateway = Gateway("hawk", client, MissionClock(1000, wall=False))
    passed_on = list(gateway.events(9))
    return [(e.severity, e.text) for e in passed_on if isinstance(e, AutopilotText)]


def test_texts_are_passed_on_with_their_severity_but_for_debugging() -> None:
    assert texts((1.0, 0, "Emergency battery level"), (2.0, 6, "Landed"), (3.0, 7, "x")) == [
        (0, "Emergency battery level"),
        (6, "Landed"),
    ]


def test_a_text_that_is_repeated_is_passed_on_once_until_it_has_stopped() -> None:
    again = [(float(second), 4, "Low battery") for second in range(0, 60, 5)]
    assert texts(*again) == [(4, "Low battery")]
    assert len(texts(*again, (66.0, 4, "Low battery"))) == 2
    assert len(texts((0.0, 4, "a"), (1.0, 4, "b"), (2.0, 4, "a"))) == 2


def test_no_flood_of_texts_is_kept() -> None:
    client = Client(*(bridge.Text(number, 4, f"text {number}") for number in range(5000)))
    gateway = Gateway("hawk", client, MissionClock(0, wall=False))
    assert len(list(gateway.events(9))) == 5000
    assert len(gateway._texts) <= 32


def test_states_of_trouble_are_the_cores_events() -> None:
    client = Client(
        bridge.SystemState(7, "critical"),
        bridge.LandedState(7, "landing"),
        bridge.FenceStatus(7, True, "boundary"),
        bridge.EstimatorStatus(7, False, ("position lost",)),
        bridge.RemoteIdStatus(7, "fails", "no\tGPS"),
    )
    gateway = Gateway("hawk", client, MissionClock(1000, wall=False))
    assert list(gateway.events(9)) == [
        SystemStateChanged(1000, "hawk", "critical"),
        LandedStateChanged(1000, "hawk", "landing"),
        FenceStatusChanged(1000, "hawk", True, "boundary"),
        EstimatorStatusChanged(1000, "hawk", False, ("position lost",)),
        RemoteIdChanged(1000, "hawk", "fails", "no GPS"),
    ]


def test_states_are_reported_again_with_the_mission_that_is_read_back() -> None:
    """After a full disk, earlier states are not reported again when writing works again."""
    plane = stack_named("px4", "plane")
    client = Client(bridge.Connected(1, plane), bridge.SystemState(2, "critical"))
    gateway = Gateway("hawk", client, MissionClock(1000, wall=False))
    assert len(list(gateway.events(3))) == 2
    client.stack = plane
    gateway.read_back(lambda items, stack: 0, 4)
    assert [type(event).__name__ for event in gateway.events(5)] == [
        "VehicleConnected",
        "SystemStateChanged",
    ]


def test_states_are_reported_again_when_a_link_lost_during_a_read_back_returns() -> None:
    """A second ``read_back`` while the link is lost relies on the return of the link."""
    plane = stack_named("px4", "plane")
    fix = GpsFixChanged(1000, "hawk", True, "3d")

    class Reading(Client):
        def download(self, now_us: int) -> int:
            return 1

    client = Reading(bridge.Connected(1, plane), bridge.GpsFix(2, "3d", 9))
    gateway = Gateway("hawk", client, MissionClock(1000, wall=False))
    client.stack = plane
    assert fix in list(gateway.events(3))
    gateway.read_back(lambda items, stack: 0, 4)
    assert fix in list(gateway.events(5))
    client.report(bridge.LinkLost(6, 1_000_000))
    assert fix not in list(gateway.events(6))
    gateway.read_back(lambda items, stack: 0, 7)
    failed = TransferResult("failed", "no reply")
    client.report(bridge.TransferFinished(8, 1, "download", failed))
    assert fix not in list(gateway.events(8))
    client.report(bridge.LinkRestored(9))
    assert list(gateway.events(9))[1:] == [fix]
