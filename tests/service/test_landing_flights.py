"""Landings on the mock autopilots of both stacks: takeoff, task, landing, disarm, go-around."""

import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from autopilot_bridge.mock.flight_model import FlightModel
from mission_service.commands import ShowLanding, StartMission
from mission_service.events import Order, OrderGiven
from tests.service.people_flights import ANN, Flight, Fly, flights_in

STACKS = ("px4", "ardupilot")
KINDS = [(stack, kind) for kind in ("plane", "vtol", "copter") for stack in STACKS]
MAX_MISS_M = {"plane": 15.0, "vtol": 3.0, "copter": 3.0}


@pytest.fixture
def fly(tmp_path: Path) -> Iterator[Fly]:
    yield from flights_in(tmp_path)


def of_kind(fly: Fly, stack: str, kind: str, *more: str, rule: str = "islam_hu_damped") -> Flight:
    """Return a flight in wind with all vehicles of one kind, two minutes after its start."""
    changes = [
        change
        for number in range(2)
        for change in (f'vehicles.{number}.stack="{stack}"', f'vehicles.{number}.kind="{kind}"')
    ]
    started = ("vehicles.0.autostart=true", "vehicles.1.autostart=true", "fly_in_wind=true")
    flight = fly(*changes, *started, *more, rule=rule)
    flight.run(150.0)
    return flight


def mock(flight: Flight, number: int = 0) -> FlightModel:
    return flight.sim.rigs[number].mock.flight


def order(flight: Flight, order: Order, name: str = "hawk") -> list[str]:
    return flight.submit(OrderGiven(flight.now_us, *ANN, name, order))


def until(flight: Flight, landing: str, name: str = "hawk", limit_s: float = 1200.0) -> None:
    """Run until the state of a vehicle shows a phase of its landing."""
    end_s = flight.now_s + limit_s
    while flight.state_view.vehicles[name].landing != landing:
        assert flight.now_s < end_s, f"{landing} was not reached"
        flight.run(1.0)


def height_m(flight: Flight, number: int = 0) -> float:
    model = mock(flight, number)
    return model.motion.altitude_m - model.frame.altitude_m


def landed_at_home(flight: Flight, kind: str, number: int = 0) -> None:
    """Require that a vehicle is disarmed on the ground at home, and stays there."""
    model = mock(flight, number)
    for _ in range(2):
        assert not model.armed
        assert not model.airborne
        assert not model.crashed
        miss_m = math.hypot(model.motion.north_m, model.motion.east_m)
        assert miss_m <= MAX_MISS_M[kind]
        flight.run(60.0)


@pytest.mark.parametrize(("stack", "kind"), KINDS)
def test_ordered_to_land_it_lands_at_home_and_is_disarmed(fly: Fly, stack: str, kind: str) -> None:
    flight = of_kind(fly, stack, kind)
    assert flight.mode == "mission"
    assert order(flight, "land") == ["landing: ordered by ann"]
    until(flight, "final")
    until(flight, "")
    landed_at_home(flight, kind)
    lines = flight.over()
    phases = [each.phase for each in lines if isinstance(each, ShowLanding)]
    sending = [] if kind == "copter" else ["sending"]
    assert phases == [*sending, "approach", "final", "none"]
    assert sum(isinstance(each, StartMission) for each in lines) == 1  # the takeoff


@pytest.mark.long
@pytest.mark.parametrize(("stack", "kind"), KINDS)
def test_after_a_go_around_it_holds_high_and_lands_by_another_order(
    fly: Fly, stack: str, kind: str
) -> None:
    flight = of_kind(fly, stack, kind)
    order(flight, "land")
    until(flight, "final")
    while height_m(flight) > 8.0:
        flight.run(0.5)
    order(flight, "go-around")
    assert flight.state_view.vehicles["hawk"].landing == "going around"
    until(flight, "", limit_s=60.0)
    assert flight.state_view.vehicles["hawk"].order == "hold"
    safe_m = {"plane": 45.0, "vtol": 35.0, "copter": 25.0}[kind]
    flight.run(10.0)
    for _ in range(12):
        flight.run(10.0)
        assert height_m(flight) > safe_m
    order(flight, "land")
    until(flight, "final")
    until(flight, "")
    landed_at_home(flight, kind)
    flight.over()


@pytest.mark.long
@pytest.mark.parametrize("stack", ["px4", "ardupilot"])
def test_a_pilot_who_takes_over_on_the_last_leg_keeps_the_vehicle(fly: Fly, stack: str) -> None:
    flight = of_kind(fly, stack, "plane")
    order(flight, "land")
    until(flight, "final")
    mock(flight).set_mode("hold", flight.now_s)
    flight.run(3.0)
    assert flight.state_view.vehicles["hawk"].landing == ""
    assert "mode/hawk" in flight.state_view.alarms
    flight.run(120.0)
    assert mock(flight).mode == "hold"
    assert mock(flight).airborne
    flight.over()


@pytest.mark.long
@pytest.mark.parametrize("stack", ["px4", "ardupilot"])
def test_two_planes_land_one_after_the_other(fly: Fly, stack: str) -> None:
    home = ("vehicles.1.home_lat_deg=36.3705", "vehicles.1.home_lon_deg=-84.1323")
    first = ("vehicles.0.home_lat_deg=36.3709", "vehicles.0.home_lon_deg=-84.1323")
    flight = of_kind(fly, stack, "plane", *home, *first, rule="team.circling")
    flight.run(120.0)
    order(flight, "land", "")
    names = list(flight.state_view.vehicles)
    shown = {flight.state_view.vehicles[name].landing for name in names}
    assert "waiting" in shown
    end_s = flight.now_s + 2000.0
    while any(mock(flight, number).armed for number in range(2)):
        assert flight.now_s < end_s
        low = [number for number in range(2) if mock(flight, number).armed]
        assert sum(height_m(flight, number) < 40.0 for number in low) <= 1
        flight.run(1.0)
    for number in range(2):
        landed_at_home(flight, "plane", number)
    flight.over()


@pytest.mark.long
def test_arduplane_lands_at_the_end_of_its_endurance(fly: Fly) -> None:
    flight = of_kind(fly, "ardupilot", "plane", "vehicles.0.endurance_s=500")
    until(flight, "final", limit_s=1500.0)
    until(flight, "")
    landed_at_home(flight, "plane")
    flight.over()
