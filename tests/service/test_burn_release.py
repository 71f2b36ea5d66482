"""The predicted landing point of spheres, its uncertainty, and the time of release."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.items import takeoff, waypoint
from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.mock.kinematics import Wind
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle.client_events import Position
from autopilot_bridge.vehicle.message_rates import DROP_RATES_HZ
from autopilot_bridge.vehicle.orders import Dropper
from mission_service.guidance.burn.drop_release import (
    ImpactPoint,
    VehicleMotion,
    impact_point,
    release_decision,
)
from tests.bridge.helpers import HOME, SECOND, Pair, mock_of

VT, DELAY_S = 15.0, 0.2
LINE = VehicleMotion(100.0, -50.0, 15.0, 3.0, 4.0)
WIND = (4.0, -2.0)


def integrated(
    vehicle: VehicleMotion, wind: tuple[float, float], vt: float, delay_s: float
) -> tuple[float, float, float]:
    """Integrate the same equations in the frame of the ground, by another method."""

    def rates(_: float, state: np.ndarray) -> np.ndarray:
        in_air = state[3:] - np.array([*wind, 0.0])
        drag = 9.80665 / vt**2 * float(np.linalg.norm(in_air)) * in_air
        return np.concatenate([state[3:], -drag - np.array([0.0, 0.0, 9.80665])])

    def ground(_: float, state: np.ndarray) -> float:
        return float(state[2])

    ground.terminal = True  # type: ignore[attr-defined]
    velocity = (vehicle.east_m_s, vehicle.north_m_s, vehicle.climb_m_s)
    place = np.array(vehicle[:3]) + delay_s * np.array(velocity)
    found = solve_ivp(
        rates, (0.0, 60.0), [*place, *velocity], events=ground, rtol=1e-10, atol=1e-10
    )
    assert found.y_events is not None
    assert found.t_events is not None
    x, y = found.y_events[0][0][:2]
    return float(x), float(y), delay_s + float(found.t_events[0][0])


@pytest.mark.parametrize("seed", range(8))
def test_spheres_land_where_an_independent_integration_has_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, y, height, east, north, climb = rng.uniform(-1.0, 1.0, 6)
    vehicle = VehicleMotion(
        500.0 * x, 500.0 * y, 41.0 + 39.0 * height, 12.0 * east, 12.0 * north, 12.0 * climb
    )
    wind = (float(rng.uniform(-12.0, 12.0)), float(rng.uniform(-12.0, 12.0)))
    vt, delay_s = float(rng.uniform(8.0, 40.0)), float(rng.uniform(0.0, 0.5))
    # Height above the ground at the release.
    vehicle = vehicle._replace(height_m=vehicle.height_m + 6.0)
    found = impact_point(vehicle, wind, vt, delay_s)
    assert found == pytest.approx(integrated(vehicle, wind, vt, delay_s), abs=2e-3)


def test_without_drag_it_is_galileos_parabola() -> None:
    found = impact_point(LINE, (0.0, 0.0), 1e6, 0.0)
    fall_s = math.sqrt(2.0 * 15.0 / 9.80665)
    assert found.after_s == pytest.approx(fall_s, abs=1e-4)
    assert found[:2] == pytest.approx((100.0 + 3.0 * fall_s, -50.0 + 4.0 * fall_s), abs=1e-3)


def test_wind_carries_a_sphere_and_drag_holds_it_back() -> None:
    calm = impact_point(LINE, (0.0, 0.0), VT, DELAY_S)
    assert calm.after_s > DELAY_S + math.sqrt(2.0 * 15.0 / 9.80665)
    assert impact_point(LINE, (8.0, 0.0), VT, DELAY_S).x_m > calm.x_m + 1.0
    assert impact_point(LINE, (0.0, -8.0), VT, DELAY_S).y_m < calm.y_m - 1.0
    assert impact_point(LINE, (0.0, 0.0), 8.0, DELAY_S).x_m < calm.x_m


def test_on_the_ground_it_lies_where_it_is_let_go() -> None:
    assert impact_point(LINE._replace(height_m=0.0), WIND, VT, 0.0) == (100.0, -50.0, 0.0)


def flown(
    target_m: tuple[float, float], step_s: float, first_s: float, max_miss_m: float
) -> tuple[list[str], ImpactPoint]:
    """Return the decisions along a line at 5 m/s until one is not "wait", and the landing point."""
    decisions: list[str] = []
    for step in range(4000):
        at_s = first_s + step * step_s
        vehicle = VehicleMotion(5.0 * at_s, 0.0, 15.0, 5.0, 0.0)
        there = impact_point(vehicle, WIND, VT, DELAY_S)
        decisions.append(release_decision(vehicle, there, target_m, step_s, max_miss_m))
        if decisions[-1] != "wait":
            return decisions, there
    return decisions, there


@pytest.mark.parametrize("step_s", [0.1, 0.125, 0.25])
@pytest.mark.parametrize("first_s", [0.0, 0.031, 0.077])
def test_it_is_let_go_at_the_telemetry_step_nearest_to_the_target(
    step_s: float, first_s: float
) -> None:
    off_y = impact_point(VehicleMotion(0.0, 0.0, 15.0, 5.0, 0.0), WIND, VT, DELAY_S).y_m
    decisions, there = flown((60.0, off_y), step_s, first_s, 4.0)
    assert decisions[-1] == "release"
    assert abs(there.x_m - 60.0) <= 0.5 * step_s * 5.0 + 1e-9
    assert len(decisions) > 20


def test_what_is_passed_too_far_off_is_missed_and_never_let_go() -> None:
    off_y = impact_point(VehicleMotion(0.0, 0.0, 15.0, 5.0, 0.0), WIND, VT, DELAY_S).y_m
    assert flown((60.0, off_y + 3.9), 0.1, 0.0, 4.0)[0][-1] == "release"
    assert flown((60.0, off_y + 4.3), 0.1, 0.0, 4.0)[0][-1] == "missed"
    # Another leg, at the spacing of lines, does not concern the target.
    for x_m in (30.0, 60.0, 90.0):
        vehicle = VehicleMotion(x_m, 0.0, 15.0, 5.0, 0.0)
        there = impact_point(vehicle, WIND, VT, DELAY_S)
        assert release_decision(vehicle, there, (60.0, off_y + 20.0), 0.1, 4.0) == "wait"


def test_a_gap_in_telemetry_lets_go_late_only_within_the_miss_allowed() -> None:
    vehicle = VehicleMotion(0.0, 0.0, 15.0, 5.0, 0.0)
    there = impact_point(vehicle, (0.0, 0.0), VT, DELAY_S)
    assert release_decision(vehicle, there, (there.x_m - 3.0, there.y_m), 0.1, 4.0) == "release"
    assert release_decision(vehicle, there, (there.x_m - 4.5, there.y_m), 0.1, 4.0) == "missed"


def test_hovering_over_the_place_is_due_and_next_to_it_waits() -> None:
    vehicle = VehicleMotion(0.0, 0.0, 15.0, 0.1, 0.0)
    there = impact_point(vehicle, (0.0, 0.0), VT, DELAY_S)
    assert release_decision(vehicle, there, (1.0, 0.0), 0.1, 4.0) == "release"
    assert release_decision(vehicle, there, (there.x_m + 4.05, 0.0), 0.1, 4.0) == "wait"


@pytest.mark.parametrize("seed", range(3))
def test_spheres_of_a_flown_line_lie_where_they_were_planned(seed: int) -> None:
    # A copter flies its mission in wind; telemetry and orders take 50 ms, and a tenth is lost.
    wind = Wind(from_deg=300.0, speed_m_s=5.0)
    mock = mock_of(stack_named("ardupilot", "copter"), airspeed_m_s=5.0, wind=wind)
    pair = Pair(mock, client=NativeClient(rates_hz=DROP_RATES_HZ))
    pair.run_for(4.0)
    north = (HOME[0] + 0.0027, HOME[1])
    items = (takeoff(*HOME[:2], 315.0), waypoint(*north, 315.0))
    assert pair.result_of(pair.client.upload(items, pair.now_us)).outcome == "accepted"
    pair.client.command("start mission", pair.now_us)
    pair.run_for(5.0)
    pair.up, pair.down = (MemoryLink(0.1, 50_000, seed=2 * seed + way) for way in (0, 1))
    targets = [(0.0, 30.0 + 15.0 * number) for number in range(14)]
    blown = (wind.east_m_s, wind.north_m_s)
    fallen: list[ImpactPoint] = []
    missed = seen = 0
    while targets and pair.now_us < 120 * SECOND:
        switched = len(mock.outputs)
        pair.run_for(0.025)
        moving = mock.flight.motion
        if any(value == 1900.0 for *_, value in mock.outputs[switched:]):
            true = VehicleMotion(
                *(moving.east_m, moving.north_m, moving.altitude_m - 300.0, 0.0, moving.speed_m_s)
            )
            fallen.append(impact_point(true, blown, VT, 0.0))
        positions = pair.of(Position)
        if len(positions) == seen:
            continue
        seen = len(positions)
        at = positions[-1]
        x, y = (at.lon_deg - HOME[1]) * 89_830.0, (at.lat_deg - HOME[0]) * 110_974.0
        speed = (at.velocity_east_m_s, at.velocity_north_m_s)
        vehicle = VehicleMotion(x, y, at.altitude_relative_m, *speed)
        there = impact_point(vehicle, blown, VT, 0.1)
        due = release_decision(vehicle, there, (there.x_m, targets[0][1]), 0.125, 2.0)
        if due != "wait":
            targets.pop(0)
            missed += due == "missed"
            if due == "release":
                pair.client.drop(Dropper("servo", 9, 1900.0, 1100.0), pair.now_us)
                pair.exchange()
    pair.run_for(0.5)
    assert missed <= 1
    assert len(fallen) >= 9
    off_m = [min(abs(end.y_m - 30.0 - 15.0 * number) for number in range(14)) for end in fallen]
    assert max(off_m) < 2.0 + 0.5
    assert float(np.median(off_m)) < 0.7
