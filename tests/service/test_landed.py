"""A vehicle that has landed, but is not disarmed yet, is neither started nor lifted off."""

from typing import Literal

import pytest

from firemodel.landscape.landscape import Landscape
from mission_service.commands import (
    Announce,
    AnyCommand,
    GoAround,
    Hold,
    HoldAt,
    Return,
    StartMission,
)
from mission_service.config.scenario import load_scenario
from mission_service.events import (
    Aborted,
    CommandFinished,
    LandedStateChanged,
    ModeChanged,
    Order,
    OrderGiven,
)
from mission_service.fire.scenario_fire import landscape_of
from tests.service.landing_core import Vehicles, every
from tests.service.test_core import Flight, kinds, uploads


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("default"))


@pytest.fixture(scope="module")
def demo() -> Landscape:
    return landscape_of(load_scenario("demo"))


def ordered_to_start_in_its_return(land: Landscape) -> Flight:
    """Return a flight that returns home, and is ordered to start 30 m above home; it refuses."""
    flight = Flight(load_scenario("default", ("vehicles.0.kind=copter",)), land)
    (mission,) = uploads(flight.at_height(0.0))
    flight.finished(mission.mission_id, "accepted")
    flight.handle(ModeChanged(flight.at_us, "hawk", 0, True, "mission"))
    flight.at_height(80.0)
    order(flight, "return")
    flight.handle(ModeChanged(flight.at_us, "hawk", 0, True, "return"))
    flight.at_height(30.0)
    assert StartMission in kinds(order(flight, "start"))
    refused(flight)
    return flight


def order(flight: Flight, order: Order) -> list[AnyCommand]:
    return flight.handle(OrderGiven(flight.at_us, "ann", "desk", "hawk", order))


def refused(flight: Flight) -> None:
    flight.handle(CommandFinished(flight.at_us, "hawk", "start mission", False, "denied"))


def test_a_start_that_was_refused_in_the_air_is_repeated_there(land: Landscape) -> None:
    flight = ordered_to_start_in_its_return(land)
    assert StartMission in kinds(flight.at_height(20.0, later_s=11.0))


def test_a_start_that_was_refused_in_the_air_is_not_repeated_after_the_landing(
    land: Landscape,
) -> None:
    flight = ordered_to_start_in_its_return(land)
    flight.handle(LandedStateChanged(flight.at_us, "hawk", "on ground"))
    for _ in range(40):
        assert StartMission not in kinds(flight.at_height(0.0))
    flight.handle(ModeChanged(flight.at_us, "hawk", 0, False, "return"))
    for _ in range(40):
        assert StartMission not in kinds(flight.at_height(0.0))


def test_an_order_to_start_is_refused_until_the_vehicle_is_disarmed(land: Landscape) -> None:
    flight = ordered_to_start_in_its_return(land)
    flight.handle(LandedStateChanged(flight.at_us, "hawk", "on ground"))
    for each in ("start", "resume", "takeoff"):
        (answer,) = order(flight, each)
        assert isinstance(answer, Announce)
        assert "repeat the order when it is disarmed" in answer.text


LIFTS_OFF = (Hold, HoldAt, GoAround, Return, StartMission)


def landed_from_last_leg(demo: Landscape, kind: str) -> Vehicles:
    """Return a vehicle that an operator ordered to land; it is on the ground and still armed."""
    flight = Vehicles(demo, f'vehicles.0.kind="{kind}"')
    if kind == "copter":
        flight.order("land")
        flight.mode("return")
        flight.at(10.0, away_deg=0.0)
        assert flight.phase() == "final"
    else:
        flight.is_on_last_leg()
    flight.at(0.0)
    flight.handle(LandedStateChanged(flight.at_us, "hawk", "on ground"))
    return flight


@pytest.mark.parametrize("kind", ["plane", "copter"])
@pytest.mark.parametrize("order", ["hold", "go-around", "abort"])
def test_no_order_to_stop_lifts_a_landed_vehicle_off(
    demo: Landscape, kind: str, order: Order | Literal["abort"]
) -> None:
    flight = landed_from_last_leg(demo, kind)
    if order == "abort":
        commands = flight.handle(Aborted(flight.at_us, "ann", ""))
    else:
        commands = flight.order(order)
    commands += [each for _ in range(10) for each in flight.at(0.0)]
    assert not [each for each in commands if isinstance(each, LIFTS_OFF)]
    flight.mode("mission", armed=False)
    assert flight.phase() == "none"


@pytest.mark.parametrize("kind", ["plane", "copter"])
def test_orders_on_the_ground_are_refused_because_it_has_landed(demo: Landscape, kind: str) -> None:
    flight = landed_from_last_leg(demo, kind)
    orders: tuple[Order, ...] = ("start", "resume", "takeoff", "return", "land", "go-around")
    for each in orders:
        (answer,) = flight.order(each)
        assert isinstance(answer, Announce)
        assert "it has landed, but is not disarmed yet" in answer.text
        again = "repeat the order when it is disarmed" in answer.text
        assert again is (each in ("start", "resume", "takeoff"))


def test_a_hold_of_a_vehicle_that_had_not_landed_is_sent_when_this_is_reported(
    demo: Landscape,
) -> None:
    flight = landed_from_last_leg(demo, "copter")
    assert not every(flight.order("hold"), Hold)
    flight.handle(LandedStateChanged(flight.at_us, "hawk", "in air"))
    assert every(flight.at(8.0, later_s=4.0, away_deg=0.0), Hold)


def in_takeoff(demo: Landscape, height_m: float) -> Vehicles:
    """Return a plane in the takeoff item of its mission."""
    flight = Vehicles(demo)
    flight.mode("hold", armed=False)
    flight.at(0.0)
    flight.order("takeoff")
    flight.at(0.0)
    flight.answer_uploads()
    flight.mode("mission")
    flight.answer("start mission")
    flight.handle(LandedStateChanged(flight.at_us, "hawk", "takeoff"))
    flight.at(height_m, away_deg=0.0)
    assert flight.core.vehicles["hawk"].takes_off
    return flight


HELD = (Hold, HoldAt)


@pytest.mark.parametrize("order", ["hold", "abort"])
def test_a_plane_in_its_takeoff_climbs_before_it_holds(
    demo: Landscape, order: Literal["hold", "abort"]
) -> None:
    flight = in_takeoff(demo, 9.0)
    if order == "abort":
        commands = flight.handle(Aborted(flight.at_us, "ann", ""))
    else:
        commands = flight.order("hold")
    (words,) = every(commands, Announce)
    assert "it holds in 7 s, when it has climbed to 30 m" in words.text
    for second in range(1, 7):
        commands += flight.at(9.0 + 3.0 * second, away_deg=0.0)
    assert not [each for each in commands if isinstance(each, HELD)]
    assert [each for each in flight.at(30.0, away_deg=0.0) if isinstance(each, HELD)]


def test_a_plane_above_30_m_holds_at_once(demo: Landscape) -> None:
    flight = in_takeoff(demo, 31.0)
    assert [each for each in flight.order("hold") if isinstance(each, HELD)]


def test_a_plane_that_has_not_begun_to_roll_holds_at_once(demo: Landscape) -> None:
    flight = in_takeoff(demo, 0.0)
    flight.handle(LandedStateChanged(flight.at_us, "hawk", "on ground"))
    assert every(flight.order("hold"), Hold)
