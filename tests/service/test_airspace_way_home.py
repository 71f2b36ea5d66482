"""Vehicles that were sent home or wait for a landing keep out of closed airspace all the way."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.mock.fault_kinds import Faults
from mission_service.commands import AnyCommand, Hold, HoldAt, Return, UploadMission
from mission_service.events import (
    AirspaceClosed,
    AirspaceOpened,
    AnyEvent,
    MissionReadBack,
    ModeChanged,
    Order,
    OrderGiven,
    Resumed,
    Telemetry,
    VehicleConnected,
)
from tests.service.intruders import fly_past, meeting
from tests.service.people_flights import ANN, Flight, Fly, flights_in
from tests.service.test_airspace import HAWK_HOME, here, inside_s, square

AROUND, HALF_M = "fly home clear of closed airspace and terrain", 120.0


@pytest.fixture
def fly(tmp_path: Path) -> Iterator[Fly]:
    yield from flights_in(tmp_path)


def order(flight: Flight, order: Order) -> list[str]:
    return flight.submit(OrderGiven(flight.now_us, *ANN, "hawk", order))


def close_halfway(flight: Flight) -> tuple[float, float]:
    """Close a volume between the vehicle and its home; return its centre."""
    place = here(flight)
    middle = ((place[0] + HAWK_HOME[0]) / 2.0, (place[1] + HAWK_HOME[1]) / 2.0)
    flight.submit(AirspaceClosed(flight.now_us, *ANN, "copter", square(middle, HALF_M)))
    return middle


def came_home(flight: Flight, centre: tuple[float, float]) -> list[AnyEvent | AnyCommand]:
    """Require that the vehicle was led around the volume, and then returned."""
    entries = flight.over()
    assert inside_s(entries, centre, HALF_M) == 0.0
    sent = [entry for entry in entries if isinstance(entry, Return | UploadMission)]
    around = [isinstance(entry, UploadMission) and entry.why == AROUND for entry in sent]
    first = around.index(True)
    assert isinstance(sent[-1], Return), "not home in the end"
    assert all(around[first:-1]), f"{sent[first:]}"
    return entries


def test_a_return_that_is_ordered_again_is_led_around_again(fly: Fly) -> None:
    flight = fly()
    flight.run(150)
    centre = close_halfway(flight)
    flight.run(1.0)
    order(flight, "return")
    flight.run(0.5)  # during the upload
    order(flight, "return")
    flight.run(90)
    came_home(flight, centre)


def test_a_refused_mission_home_is_sent_again(fly: Fly) -> None:
    flight = fly()
    flight.run(150)
    centre = close_halfway(flight)
    flight.run(1.0)
    server = flight.sim.rigs[0].mock.missions
    server.faults = Faults(refuse={(0, seq): mavlink.MAV_MISSION_ERROR for seq in range(50)})
    order(flight, "return")
    flight.run(8.0)
    server.faults = Faults()
    assert flight.mode == "hold"
    flight.run(90)
    assert flight.mode == "return"
    came_home(flight, centre)


def test_an_order_that_is_rejected_does_not_end_the_flight_home(fly: Fly) -> None:
    flight = fly()
    flight.run(150)
    centre = close_halfway(flight)
    flight.run(1.0)
    order(flight, "return")
    flight.run(8.0)
    assert flight.mode == "mission"
    assert "not landing" in " ".join(order(flight, "go-around"))
    flight.run(90)
    came_home(flight, centre)


def test_at_the_end_of_its_energy_it_waits_outside_until_the_way_is_free(fly: Fly) -> None:
    flight = fly("vehicles.0.endurance_s=420", "vehicles.0.endurance_reserve_s=60")
    flight.run(120)
    vehicle = flight.sim.service.core.vehicles["hawk"]
    assert vehicle.availability.airborne
    while not vehicle.sent_home:
        flight.run(1.0)
    flight.run(10.0)
    flight.submit(AirspaceClosed(flight.now_us, *ANN, "copter", square(here(flight), 200.0)))
    flight.submit(AirspaceClosed(flight.now_us, *ANN, "home", square(HAWK_HOME, 100.0)))
    closed_us = flight.now_us
    flight.run(100)
    assert flight.mode != "return"
    assert "overdue/hawk" in flight.state_view.alarms
    flight.submit(AirspaceOpened(flight.now_us, *ANN, "copter"))
    flight.submit(AirspaceOpened(flight.now_us, *ANN, "home"))
    flight.run(40)
    assert flight.mode == "return"
    entries = flight.over()
    at_us, whys = 0, set()
    for entry in entries:
        at_us = getattr(entry, "at_us", at_us)
        if isinstance(entry, UploadMission) and at_us > closed_us:
            whys.add(entry.why)
    assert whys <= {AROUND, "leave closed airspace"}, "a planner leads it"


def two_copters(fly: Fly) -> Flight:
    """Return a flight of two copters with one home: hawk lands, and kite waits to land."""
    changes = [
        change
        for number in range(2)
        for change in (
            f'vehicles.{number}.kind="copter"',
            f"vehicles.{number}.autostart=true",
            f"vehicles.{number}.home_lat_deg={HAWK_HOME[0] + 0.0005 * number}",
            f"vehicles.{number}.home_lon_deg={HAWK_HOME[1]}",
        )
    ]
    flight = fly(*changes, rule="team.bumper")
    flight.run(150)
    for name in ("hawk", "kite"):
        flight.submit(OrderGiven(flight.now_us, *ANN, name, "land"))
        flight.run(3.0)
    assert flight.state_view.vehicles["kite"].landing == "waiting"
    return flight


def of_kite(flight: Flight) -> tuple[float, float]:
    fix = flight.state_view.telemetry["kite"]
    return fix.lat_deg, fix.lon_deg


def test_a_vehicle_that_waits_for_its_landing_leaves_a_volume_that_closes(fly: Fly) -> None:
    flight = two_copters(fly)
    centre = of_kite(flight)
    flight.submit(AirspaceClosed(flight.now_us, *ANN, "copter", square(centre, 40.0)))
    closed_us = flight.now_us
    flight.run(30)
    assert "landing ended: it is inside" in flight.state_view.alarms["landing/kite"].text
    assert flight.state_view.vehicles["kite"].order == "hold"
    assert max(abs(a - b) for a, b in zip(of_kite(flight), centre, strict=True)) > 40.0 / 111_200.0
    at_us, holds = 0, 0
    for entry in flight.over():
        at_us = getattr(entry, "at_us", at_us)
        holds += at_us > closed_us and isinstance(entry, Hold) and entry.vehicle == "kite"
    assert holds == 0, "a hold interrupts its way out"


def test_no_landing_begins_through_a_volume_that_has_closed_while_it_waited(fly: Fly) -> None:
    flight = two_copters(fly)
    place = of_kite(flight)
    middle = ((place[0] + HAWK_HOME[0]) / 2.0, (place[1] + HAWK_HOME[1]) / 2.0)
    flight.submit(AirspaceClosed(flight.now_us, *ANN, "copter", square(middle, 100.0)))
    flight.run(300)
    assert not flight.state_view.vehicles["hawk"].armed
    assert "its way home would enter" in flight.state_view.alarms["landing/kite"].text
    entries = flight.over()
    assert not [e for e in entries if isinstance(e, Return) and e.vehicle == "kite"]


def test_the_alarm_of_a_held_vehicle_ends_when_its_flight_is_free(fly: Fly) -> None:
    flight = fly()
    flight.run(150)
    order(flight, "hold")
    flight.run(10)
    flight.submit(AirspaceClosed(flight.now_us, *ANN, "copter", square(here(flight), 100.0)))
    flight.run(2.0)
    assert "leaves" in flight.state_view.alarms["airspace/hawk"].text
    flight.run(60)
    assert "airspace/hawk" not in flight.state_view.alarms
    assert flight.state_view.vehicles["hawk"].order == "hold"
    flight.over()


def test_an_evasion_replaces_the_alarm_about_a_mission_that_was_not_sent(fly: Fly) -> None:
    flight = fly()
    flight.run(150)
    state = flight.sim.service.core.airspace._states["hawk"]
    state.withheld, state.alarm = True, "a mission is not sent"
    flight.submit(AirspaceClosed(flight.now_us, *ANN, "copter", square(here(flight), 150.0)))
    flight.run(2.0)
    assert "leaves" in flight.state_view.alarms["airspace/hawk"].text


def test_the_alarm_about_a_mission_on_the_ground_ends_when_the_airspace_opens(fly: Fly) -> None:
    corners = [list(place) for place in square(HAWK_HOME, 300.0)]
    flight = fly(f'airspace.closed=[{{name="home", corners={corners}}}]')
    flight.run(15)
    assert "is not s" in flight.state_view.alarms["airspace/hawk"].text
    order(flight, "hold")  # no further mission is planned
    flight.submit(AirspaceOpened(flight.now_us, *ANN, "home"))
    flight.run(2.0)
    assert "airspace/hawk" not in flight.state_view.alarms
    flight.over()


@pytest.mark.parametrize("evades", [True, False])
def test_after_a_restart_a_held_vehicle_flies_on_only_out_of_closed_airspace(
    fly: Fly, evades: bool
) -> None:
    flight = fly()
    flight.run(150)
    order(flight, "hold")
    flight.run(5.0)
    if evades:
        flight.submit(AirspaceClosed(flight.now_us, *ANN, "copter", square(here(flight), 150.0)))
        flight.run(4.0)
        assert flight.mode == "mission"
    core = flight.sim.service.core
    mission_id = core.airspace._states["hawk"].on_board_id
    fix, at_us = flight.state_view.telemetry["hawk"], flight.now_us
    place = (fix.lat_deg, fix.lon_deg, fix.altitude_amsl_m, 160.0, 0.0, 15.0, 0.0)
    restart: list[AnyEvent] = [
        Resumed(at_us, "service", "", 1.0),
        VehicleConnected(at_us, "hawk", "px4 plane", True),
        ModeChanged(at_us, "hawk", 0, True, "mission"),
        MissionReadBack(at_us, "hawk", mission_id, 5),
        *(Telemetry(at_us + step * 250_000, "hawk", *place) for step in range(1, 5)),
    ]
    found = [command for event in restart for command in core.handle(event)]
    assert any(isinstance(command, Hold) for command in found) != evades


def test_a_descent_below_an_aircraft_ends_above_closed_airspace(fly: Fly) -> None:
    flight = fly('surveillance.resolution="descend"')
    flight.run(120)
    fix = flight.state_view.telemetry["hawk"]
    ceiling_m = fix.altitude_amsl_m - 50.0
    area = square(here(flight), 1500.0)
    flight.submit(
        AirspaceClosed(flight.now_us, *ANN, "below", area, ceiling_amsl_m=round(ceiling_m))
    )
    fly_past(flight.sim, meeting(flight.sim, 60.0, track_deg=200.0), 40)
    flight.run(30)
    entries = flight.over()
    assert any(isinstance(entry, HoldAt | Hold) for entry in entries)
    assert not [e for e in entries if isinstance(e, UploadMission) and e.keeps_apart]
    lowest_m = min(e.altitude_amsl_m for e in entries[-400:] if isinstance(e, Telemetry))
    assert ceiling_m < lowest_m < fix.altitude_amsl_m - 20.0


def test_after_a_pilot_has_ended_a_return_the_end_of_its_energy_sends_it_home(fly: Fly) -> None:
    flight = fly("vehicles.0.endurance_s=570", "vehicles.0.endurance_reserve_s=210")
    flight.run(150)
    order(flight, "return")
    flight.run(10.0)
    # As its pilot would.
    flight.sim.rigs[0].client.command("start mission", flight.sim.link_us)
    flight.run(10.0)
    assert flight.mode == "mission"
    flight.run(110)
    assert flight.mode == "return"
    flight.over()
