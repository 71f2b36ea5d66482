"""Motion of the mock: wind, limits, terrain, battery."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import pytest

from autopilot_bridge.items import MissionItem, loiter_unlimited, takeoff, waypoint
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.kinematics import (
    GRAVITY_M_S2,
    STEP_S,
    Limits,
    Motion,
    Wind,
    crab,
    step_copter,
    step_plane,
)
from autopilot_bridge.stacks.stacks import STACKS, Stack, stack_named
from tests.bridge.helpers import HOME, mock_of
from tests.bridge.mock_exchange import COPTER, PLANE, PX4, each_stack

PX4_COPTER = stack_named("px4", "copter")
WEST = Wind(270.0, 6.0)
M = 1e-5 / 1.10974  # about a metre of latitude, in degrees


@dataclass
class Flown:
    """A mock that flies its mission without a link."""

    mock: MockAutopilot
    now_s: float = 0.0

    def steps(self, seconds: float) -> list[Motion]:
        """Advance step by step; return a copy of the motion after each step."""
        seen = []
        for _ in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            self.mock.flight.step(self.now_s)
            seen.append(replace(self.mock.flight.motion))
        return seen


def flown(stack: Stack, items: tuple[MissionItem, ...], **more: Any) -> Flown:
    """Return an armed mock in its mission."""
    mock = mock_of(stack, **more)
    home = (waypoint(*HOME),) if stack.item_0_is_home else ()
    mock.flight.items = (*home, *items)
    mock.flight.armed = True
    mock.flight.set_mode("mission", 0.0)
    return Flown(mock)


def north_then_east(z: float = 360.0) -> tuple[MissionItem, ...]:
    """Return a mission of 2 km to the north, then 3 km to the east."""
    first = waypoint(36.3 + 2000 * M, -84.2, z)
    return (takeoff(*HOME[:2], z), first, waypoint(36.3 + 2000 * M, -84.2 + 3000 * M / 0.809, z))


def test_the_wind_triangle_closes() -> None:
    heading, ground = crab(0.0, 20.0, Wind(270.0, 6.0))
    assert math.degrees(heading) == pytest.approx(-17.458, abs=1e-3)  # into the wind
    assert ground == pytest.approx(math.sqrt(20.0**2 - 6.0**2))
    assert crab(math.pi / 2, 20.0, WEST)[1] == pytest.approx(26.0)
    assert crab(-math.pi / 2, 20.0, WEST)[1] == pytest.approx(14.0)


def test_a_plane_in_wind_keeps_its_airspeed_and_its_line() -> None:
    flight = flown(PX4, north_then_east(), wind=WEST)
    flight.steps(60.0)
    target = flight.mock.flight.target
    assert target is not None
    start, end = target.leg_start, flight.mock.flight.frame.local(target.item)
    track = math.atan2(end[1] - start[1], end[0] - start[0])
    on_leg = [m for m in flight.steps(60.0) if 600.0 < m.north_m < 1500.0]
    assert len(on_leg) > 200
    off = [
        (m.east_m - start[1]) * math.cos(track) - (m.north_m - start[0]) * math.sin(track)
        for m in on_leg
    ]
    assert max(map(abs, off)) < 2.0
    assert all(m.airspeed_m_s == 18.0 for m in on_leg)
    heading, ground = crab(track, 18.0, WEST)
    assert on_leg[-1].speed_m_s == pytest.approx(ground, abs=0.05)
    assert on_leg[-1].heading_rad % math.tau == pytest.approx(heading % math.tau, abs=0.01)
    assert on_leg[-1].course_rad == pytest.approx(track, abs=0.01)
    assert abs(math.degrees(heading - track)) > 15.0
    downwind = [m for m in flight.steps(70.0) if 1000.0 < m.east_m < 2000.0]
    assert downwind[-1].speed_m_s == pytest.approx(24.0, abs=0.1)


@pytest.mark.parametrize("radius_m", [120.0, -120.0])
def test_a_plane_holds_its_circle_in_wind(radius_m: float) -> None:
    place = loiter_unlimited(36.31, -84.2, 360.0, radius_m)
    flight = flown(PX4, (takeoff(*HOME[:2], 360.0), place), wind=WEST)
    flight.steps(180.0)
    centre = flight.mock.flight.frame.local(place)
    circling = flight.steps(120.0)
    off = [math.hypot(m.north_m - centre[0], m.east_m - centre[1]) - 120.0 for m in circling]
    assert max(map(abs, off)) < 0.1
    assert max(m.speed_m_s for m in circling) == pytest.approx(24.0, abs=0.3)
    assert min(m.speed_m_s for m in circling) == pytest.approx(12.0, abs=0.3)


def test_a_wind_stronger_than_the_plane_blows_it_off() -> None:
    flight = flown(PX4, north_then_east(), wind=Wind(0.0, 25.0))
    last = flight.steps(120.0)[-1]
    assert last.north_m < -400.0


def test_turns_are_within_the_bank_limit() -> None:
    flight = flown(PLANE, north_then_east(), wind=WEST)
    motions = flight.steps(200.0)
    most = GRAVITY_M_S2 * math.tan(math.radians(40.0)) / 18.0
    headings = [m.heading_rad for m in motions if m.airspeed_m_s > 0.0]
    turns = [
        abs((after - before + math.pi) % math.tau - math.pi) / STEP_S
        for before, after in pairwise(headings)
    ]
    assert max(turns) == pytest.approx(most, rel=1e-6)
    assert max(abs(math.degrees(m.roll_rad)) for m in motions) == pytest.approx(40.0, abs=0.01)


def test_climb_sink_and_yaw_have_limits() -> None:
    limits = Limits(climb_m_s=3.0, sink_m_s=2.0, yaw_rate_deg_s=45.0)
    motion = Motion(0.0, 0.0, 100.0)
    step_plane(motion, 0.0, 200.0, limits)
    assert motion.climb_m_s == 3.0
    step_plane(motion, 0.0, 0.0, limits)
    assert motion.climb_m_s == -2.0
    motion = Motion(0.0, 0.0, 100.0)
    for _ in range(8):
        step_copter(motion, (0.0, 500.0), 100.0, limits, stop=True)
    assert motion.speed_m_s == pytest.approx(3.0)  # the motion after one second
    assert math.degrees(motion.heading_rad) == pytest.approx(45.0, abs=8.0)
    assert motion.course_rad == pytest.approx(math.pi / 2)


def test_a_copter_holds_its_place_in_wind_up_to_its_highest_airspeed() -> None:
    motion, limits = Motion(0.0, 0.0, 100.0), Limits(max_airspeed_m_s=15.0)
    for _ in range(80):
        step_copter(motion, (0.0, 0.0), 100.0, limits, stop=True, wind=Wind(0.0, 10.0))
    assert motion.north_m == 0.0
    assert motion.airspeed_m_s == pytest.approx(10.0)
    for _ in range(80):
        step_copter(motion, (0.0, 0.0), 100.0, limits, stop=True, wind=Wind(0.0, 17.0))
    assert motion.north_m == pytest.approx(-20.0, abs=5.0)  # 2 m/s for 10 s


# Terrain ----------------------------------------------------------------------------------------


def hill(lat_deg: float, lon_deg: float) -> float:
    """Return the terrain: it rises from 300 m to 500 m within 2 km north of home."""
    return 300.0 + max(0.0, min((lat_deg - 36.3) / M / 10.0, 200.0))


@pytest.mark.parametrize("stack", [PLANE, COPTER], ids=lambda s: s.vehicle)
def test_ardupilot_follows_the_terrain_in_terrain_frames(stack: Stack) -> None:
    there = replace(waypoint(36.3 + 2500 * M, -84.2, 80.0), frame=10)
    up = MissionItem(22, 10, 363000000, -842000000, 80.0)
    flight = flown(stack, (up, there), terrain=hill)
    flight.steps(40.0)
    on_hill = [m for m in flight.steps(60.0) if 300.0 < m.north_m < 1900.0]
    assert len(on_hill) > 100
    assert all(
        m.altitude_m - 300.0 - m.north_m / 10.0 == pytest.approx(80.0, abs=3.0) for m in on_hill
    )


@each_stack
def test_a_vehicle_that_flies_into_the_ground_has_crashed_and_stays_there(stack: Stack) -> None:
    flight = flown(stack, north_then_east(400.0), terrain=hill)
    flight.steps(300.0)
    mock = flight.mock
    assert mock.flight.crashed
    assert not mock.flight.armed
    assert mock.flight.motion.north_m == pytest.approx(1000.0, abs=30.0)
    assert any(words.startswith("SIM Hit ground") for _, words in mock.flight.texts)
    before = replace(mock.flight.motion)
    mock.flight.armed = True  # commands that a station may send
    flight.steps(10.0)
    assert mock.flight.motion == before
    assert not mock.flight.armed
    mock.reboot(0)
    assert mock.flight.crashed


# Battery ----------------------------------------------------------------------------------------


@each_stack
def test_a_battery_drains_and_its_vehicle_goes_home_when_it_is_low(stack: Stack) -> None:
    flight = flown(stack, north_then_east(), battery_minutes=2.0)
    assert flight.mock.battery_percent == 100.0
    flight.steps(60.0)
    assert flight.mock.battery_percent == pytest.approx(50.0, abs=1.0)
    modes = [flight.mock.flight.mode]
    flight.steps(43.0)
    modes.append(flight.mock.flight.mode)
    assert modes == ["mission", "rtl"]
    words = "Battery 1 is low" if stack.name == "ardupilot" else "Low battery"
    assert sum(text.startswith(words) for _, text in flight.mock.flight.texts) == 1


@pytest.mark.parametrize("stack", [PX4, COPTER], ids=lambda s: s.vehicle)
def test_an_empty_battery_ends_on_the_ground(stack: Stack) -> None:
    far = (takeoff(*HOME[:2], 400.0), waypoint(36.5, -84.2, 400.0))
    flight = flown(stack, far, battery_minutes=1.5)
    flight.steps(150.0)
    assert flight.mock.flight.crashed
    assert flight.mock.flight.motion.altitude_m == pytest.approx(300.0, abs=1.0)


@pytest.mark.parametrize("stack", [PX4_COPTER, COPTER], ids=lambda s: s.name)
def test_a_copter_that_returns_lands_at_home_and_disarms(stack: Stack) -> None:
    flight = flown(stack, north_then_east())
    flight.steps(80.0)
    flight.mock.flight.set_mode("rtl", flight.now_s)
    flight.steps(200.0)
    motion = flight.mock.flight.motion
    assert (motion.altitude_m, flight.mock.flight.armed) == (300.0, False)
    assert math.hypot(motion.north_m, motion.east_m) < 1.5


def test_an_engine_that_runs_again_has_the_limits_it_had() -> None:
    for stack in STACKS:
        mock = mock_of(stack, airspeed_m_s=18.1)
        before = mock.flight.limits
        for _ in range(3):
            mock.flight.fail_engine(True)
            assert mock.flight.limits.airspeed_m_s < before.airspeed_m_s
            mock.flight.fail_engine(False)
        assert mock.flight.limits == before
        mock.flight.fail_engine(True)
        mock.reboot(0)
        mock.flight.fail_engine(False)
        assert mock.flight.limits == before
