"""How a vehicle returns: by its parameters, and flown by the mock."""

import math

import pytest

from autopilot_bridge.items import waypoint
from autopilot_bridge.mock.kinematics import STEP_S
from autopilot_bridge.stacks.return_flight import (
    MULTIROTOR_BEGIN_S,
    UNREAD,
    ReturnFlight,
    parameters_of,
    return_flight_of,
    true_airspeed_factor,
)
from autopilot_bridge.stacks.stacks import STACKS, Stack, stack_named
from tests.bridge.test_mock_physics import M, flown

PX4_PLANE, PX4_COPTER = stack_named("px4", "plane"), stack_named("px4", "copter")
ARDUPLANE, ARDUCOPTER = stack_named("ardupilot", "plane"), stack_named("ardupilot", "copter")
CASES: list[tuple[Stack, dict[str, float], ReturnFlight]] = [
    (
        PX4_PLANE,
        {"FW_AIRSPD_TRIM": 15, "FW_T_CLMB_R_SP": 3, "FW_R_LIM": 50, "RTL_RETURN_ALT": 100},
        ReturnFlight(15, 100, 3, None, 50, to_landing=False),
    ),
    *(
        (PX4_PLANE, {"RTL_TYPE": kind}, ReturnFlight(to_landing=kind > 0.0))
        for kind in (0.0, 1.0, 2.0, 3.0, 4.0)
    ),
    (
        PX4_COPTER,
        {"MPC_XY_CRUISE": 5, "MPC_Z_V_AUTO_UP": 3, "MPC_ACC_HOR": 2, "RTL_RETURN_ALT": 30},
        ReturnFlight(5, 30, 3, 2),
    ),
    (ARDUPLANE, {"AIRSPEED_CRUISE": 22, "RTL_ALTITUDE": 100}, ReturnFlight(22, 100)),
    (
        ARDUPLANE,
        {"AIRSPEED_CRUISE": 22, "RTL_ALTITUDE": -1},
        ReturnFlight(22, at_current_height=True),
    ),
    (
        ARDUCOPTER,
        {"RTL_SPEED": 0, "WPNAV_SPEED": 1000, "WPNAV_ACCEL": 250, "RTL_ALT": 1500},
        ReturnFlight(10, 15, None, 2.5),
    ),
    (
        ARDUCOPTER,
        {"RTL_SPEED": 480, "WPNAV_SPEED": 1000, "WPNAV_SPEED_UP": 250},
        ReturnFlight(4.8, None, 2.5),
    ),
    (ARDUCOPTER, {"WPNAV_SPEED": 1000}, UNREAD),  # RTL_SPEED may be another speed
]


@pytest.mark.parametrize(("stack", "values", "wanted"), CASES)
def test_parameters_determine_the_return(
    stack: Stack, values: dict[str, float], wanted: ReturnFlight
) -> None:
    assert return_flight_of(stack, values) == wanted
    assert set(values) <= set(parameters_of(stack))


@pytest.mark.parametrize("stack", STACKS)
def test_the_mock_has_all_these_parameters(stack: Stack) -> None:
    mock = flown(stack, ()).mock
    assert set(parameters_of(stack)) <= set(mock.parameters.names)
    assert mock.flight.returns.speed_m_s == mock.flight.limits.airspeed_m_s


def test_the_true_airspeed_is_that_of_the_standard_atmosphere() -> None:
    # Densities of the standard atmosphere: 1.2250, 1.1117, 1.0066 kg/m3.
    assert true_airspeed_factor(0.0) == 1.0
    assert true_airspeed_factor(1000.0) == pytest.approx(math.sqrt(1.2250 / 1.1117), abs=1e-3)
    assert true_airspeed_factor(2000.0) == pytest.approx(math.sqrt(1.2250 / 1.0066), abs=1e-3)


@pytest.mark.parametrize("stack", [PX4_PLANE, ARDUPLANE])
def test_a_mock_plane_returns_at_the_airspeed_of_its_parameters(stack: Stack) -> None:
    flight = flown(stack, (waypoint(36.3 + 6000 * M, -84.2, 480.0),))
    flight.steps(120.0)
    mock = flight.mock
    mock.parameters.change("FW_AIRSPD_TRIM" if stack is PX4_PLANE else "AIRSPEED_CRUISE", 22.0)
    mock.flight.returns = mock.parameters.return_flight
    mock.flight.set_mode("rtl", flight.now_s)
    seen = flight.steps(40.0)
    wanted_m_s = 22.0 * true_airspeed_factor(480.0)
    assert seen[-1].airspeed_m_s == pytest.approx(wanted_m_s, rel=0.01)


@pytest.mark.parametrize("stack", [PX4_COPTER, ARDUCOPTER])
def test_a_mock_copter_stops_before_it_returns(stack: Stack) -> None:
    flight = flown(stack, (waypoint(36.3 + 3000 * M, -84.2, 480.0),))
    flight.steps(90.0)
    motion, limits = flight.mock.flight.motion, flight.mock.flight.limits
    from_m, speed_m_s = motion.north_m, motion.speed_m_s
    assert speed_m_s > 15.0
    flight.mock.flight.set_mode("rtl", flight.now_s)
    seen = flight.steps(30.0)
    farthest_m = max(each.north_m for each in seen)
    ahead_m = speed_m_s**2 / (2.0 * limits.acceleration_m_s2)
    assert farthest_m - from_m == pytest.approx(ahead_m, abs=3.0)
    stands_s = STEP_S * sum(abs(each.north_m - farthest_m) < 0.5 for each in seen)
    assert stands_s == pytest.approx(MULTIROTOR_BEGIN_S[stack.name], abs=2.0)
    assert seen[-1].north_m < from_m
