"""VTOLs of both stacks on the mock: the vertical takeoff and landing, hover and flight."""

import math
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import (
    MissionItem,
    fly_as_plane,
    loiter_unlimited,
    takeoff,
    vtol_takeoff,
    waypoint,
)
from autopilot_bridge.missions.check import check
from autopilot_bridge.mock.flight_model import FlightModel
from autopilot_bridge.mock.telemetry_source import landed_state
from autopilot_bridge.stacks.stacks import Stack, kind_of, kind_parameters, stack_named
from autopilot_bridge.vehicle.orders import land
from tests.bridge.helpers import HOME
from tests.bridge.test_mock_physics import Flown, M, flown

PX4, QUADPLANE = stack_named("px4", "vtol"), stack_named("ardupilot", "vtol")
each_vtol = pytest.mark.parametrize("stack", [PX4, QUADPLANE], ids=["px4", "ardupilot"])
FRAME = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
NORTH_500_M = (HOME[0] + 500 * M, HOME[1])
HOME_E7 = (round(HOME[0] * 1e7), round(HOME[1] * 1e7))
LAND = MissionItem(mavlink.MAV_CMD_NAV_VTOL_LAND, FRAME, *HOME_E7, 0.0)
AROUND = loiter_unlimited(*NORTH_500_M, HOME[2] + 60.0, 80.0)


def mission(*then: MissionItem) -> tuple[MissionItem, ...]:
    up = vtol_takeoff(HOME[0] + 200 * M, HOME[1], 40.0)
    return (up, waypoint(*NORTH_500_M, HOME[2] + 60.0), *then)


def height_m(flight: FlightModel) -> float:
    return flight.motion.altitude_m - HOME[2]


def away_m(flight: FlightModel) -> float:
    return math.hypot(flight.motion.north_m, flight.motion.east_m)


def until_low(run: Flown, below_m: float) -> FlightModel:
    """Run until a vehicle that flies its landing is below a height."""
    flight = run.mock.flight
    while not (flight.lands and height_m(flight) < below_m):
        run.steps(1.0)
    return flight


@each_vtol
def test_it_climbs_above_home_and_then_flies_as_a_plane(stack: Stack) -> None:
    run = flown(stack, mission(AROUND))
    flight = run.mock.flight
    while flight.hovers:
        assert away_m(flight) < 1.0
        run.steps(1.0)
    assert height_m(flight) == pytest.approx(40.0, abs=4.0)
    run.steps(60.0)
    assert flight.motion.speed_m_s > 10.0
    assert away_m(flight) > 200.0


@each_vtol
def test_it_lands_on_the_point_and_is_disarmed(stack: Stack) -> None:
    run = flown(stack, mission(LAND))
    flight = until_low(run, 20.0)
    assert flight.hovers
    assert away_m(flight) < 2.0
    run.steps(120.0)
    assert not flight.armed
    assert not flight.airborne
    assert away_m(flight) < 1.0


@each_vtol
def test_its_state_is_hover_or_flight(stack: Stack) -> None:
    run = flown(stack, mission(LAND))
    flight = run.mock.flight
    states: list[int] = []
    for _ in range(200):
        state = landed_state(stack, flight).vtol_state
        if not states or states[-1] != state:
            states.append(state)
        run.steps(1.0)
    hover, flies = mavlink.MAV_VTOL_STATE_MC, mavlink.MAV_VTOL_STATE_FW
    assert states == [hover, flies, hover]


def test_a_quadplane_climbs_by_the_altitude_of_its_takeoff_item() -> None:
    """ArduPlane 4.6.2 ``do_vtol_takeoff``: the frame does not count, also of a NAV_TAKEOFF."""
    run = flown(QUADPLANE, (takeoff(*HOME[:2], HOME[2] + 50.0), AROUND))
    run.steps(30.0)
    flight = run.mock.flight
    assert flight.hovers
    assert height_m(flight) > 60.0
    items = (takeoff(*HOME[:2], HOME[2] + 50.0), AROUND)
    (problem,) = check(items, QUADPLANE)
    assert (problem.kind, problem.index, problem.field) == ("dangerous", 0, "frame")
    assert check(mission(AROUND), QUADPLANE) == []


def test_a_quadplane_climbs_and_circles_after_a_go_around() -> None:
    run = flown(QUADPLANE, mission(LAND, AROUND))
    flight = until_low(run, 10.0)
    assert flight.go_around(0.0)
    run.steps(60.0)
    assert not flight.hovers
    assert flight.current == 4
    assert height_m(flight) > 40.0


def test_a_quadplane_that_has_not_begun_its_descent_refuses_a_go_around() -> None:
    run = flown(QUADPLANE, mission(LAND, AROUND))
    flight = run.mock.flight
    while not flight.lands:
        run.steps(1.0)
    assert not flight.hovers
    assert not flight.go_around(0.0)


def test_px4_hovers_on_in_its_next_mission_unless_it_is_sent_to_fly_as_a_plane() -> None:
    run = flown(PX4, mission(LAND))
    flight = until_low(run, 15.0)
    for first, hovers in (((), True), ((fly_as_plane(),), False)):
        flight.set_mode("hold", 0.0)
        flight.items = (*first, AROUND)
        flight.set_mode("mission", 0.0)
        flight.go_to(0, 0.0)
        run.steps(5.0)
        assert flight.hovers is hovers


def test_a_px4_that_returns_in_hover_lands_at_home() -> None:
    run = flown(PX4, mission(LAND))
    flight = until_low(run, 15.0)
    flight.set_mode("rtl", 0.0)
    run.steps(120.0)
    assert not flight.airborne
    assert away_m(flight) < 1.0


def test_orders_to_land_lead_to_a_vertical_landing() -> None:
    assert land(QUADPLANE) == (QUADPLANE.set_mode(QUADPLANE.mode_number("qland")),)
    assert land(PX4) == land(stack_named("px4", "plane"))


def test_the_parameter_decides_between_a_plane_and_a_quadplane() -> None:
    plane, copter = stack_named("ardupilot", "plane"), stack_named("ardupilot", "copter")
    assert kind_parameters(plane) == kind_parameters(QUADPLANE) == ("Q_ENABLE",)
    assert kind_of(plane, {"Q_ENABLE": 1.0}) == "vtol"
    assert kind_of(QUADPLANE, {"Q_ENABLE": 0.0}) == "plane"
    assert [kind_of(each, {}) for each in (plane, QUADPLANE, PX4, copter)] == [
        *("plane", "vtol", "vtol"),
        "copter",
    ]
    assert kind_of(PX4, {"Q_ENABLE": 0.0}) == "vtol"
    assert kind_parameters(PX4) == ()
    assert replace(plane, vtol=True).kind == "vtol"
