"""A plan's path as a mission: over terrain, for both stacks, without a drop."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.missions.check import check
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.local_frame import LocalFrame
from autopilot_bridge.stacks.stacks import stack_named
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import load_scenario
from mission_service.config.sections import BurnSection, PlannerSection, VehicleSection
from mission_service.guidance.burn.plan_mission import (
    BAND,
    has_drop,
    mission_items,
    plan_points,
    return_height_m,
)
from mission_service.ignition_plan import PathPoint
from tests.bridge.helpers import SECOND, Pair

stacks = pytest.mark.parametrize("stack", ["ardupilot", "px4"])
BURN = BurnSection(
    unit=((36.3, -84.2), (36.31, -84.2), (36.31, -84.19)),
    stations=({"name": "anchor", "lat_deg": 36.3, "lon_deg": -84.2},),  # type: ignore[arg-type]
)


def land(seed: int | None) -> Landscape:
    """Return hills (10 m cells, slopes up to 30 degrees); without a seed flat ground at 300 m."""
    elevation = np.full((60, 60), 300.0)
    if seed is not None:
        rng = np.random.default_rng(seed)
        y, x = np.mgrid[0:60, 0:60] * 10.0
        for _ in range(6):
            along, across = rng.normal(size=2)
            length_m, phase = rng.uniform(80.0, 500.0), rng.uniform(0.0, math.tau)
            way = (along * x + across * y) / math.hypot(along, across)
            elevation += 0.03 * length_m * np.sin(math.tau * way / length_m + phase)
    return Landscape(
        "EPSG:32616",
        750_000.0,
        4_020_600.0,
        10.0,
        np.ones((60, 60), dtype=np.int16),
        elevation.astype(np.float32),
    )


# The path leads from the start up, across, down to the drop height, along a line, back beside the
# line, and up.
LINE = np.array(
    [
        [750_100.0, 4_020_100.0, 60.0, 0.0],
        [750_200.0, 4_020_100.0, 60.0, 20.0],
        [750_200.0, 4_020_100.0, 15.0, 42.5],
        [750_200.0, 4_020_480.0, 15.0, 118.5],
        [750_220.0, 4_020_480.0, 15.0, 122.5],
        [750_420.0, 4_020_130.0, 15.0, 203.0],
        [750_420.0, 4_020_130.0, 60.0, 218.0],
        [750_300.0, 4_020_100.0, 60.0, 243.0],
    ]
)


def vehicle_of(stack: str, landscape: Landscape) -> VehicleSection:
    lat, lon = landscape.lat_lon_of(*LINE[0, :2])
    given: dict[str, Any] = {"name": "drake", "stack": stack, "kind": "copter"}
    return VehicleSection(home_lat_deg=float(lat), home_lon_deg=float(lon), **given)


def heights_m(points: tuple[PathPoint, ...], landscape: Landscape) -> list[tuple[float, ...]]:
    """Return (height above ground, planned height) at each half metre of the straight legs."""
    found: list[tuple[float, ...]] = []
    for start, end in itertools.pairwise(points):
        x0, y0 = landscape.xy_of_lat_lon(start.lat_deg, start.lon_deg)
        x1, y1 = landscape.xy_of_lat_lon(end.lat_deg, end.lon_deg)
        length_m = math.hypot(x1 - x0, y1 - y0)
        if length_m < 0.1:  # a climb in place
            continue
        for share in np.linspace(0.0, 1.0, max(round(2.0 * length_m), 2)):
            ground = landscape.elevation_at(x0 + share * (x1 - x0), y0 + share * (y1 - y0))
            rise = share * (end.altitude_amsl_m - start.altitude_amsl_m)
            height = start.altitude_amsl_m + rise - float(ground)
            found.append((height, start.height_m + share * (end.height_m - start.height_m)))
    return found


@pytest.mark.parametrize("seed", [None, *range(10)])
def test_each_leg_clears_the_ground_by_its_height_and_not_by_much_more(seed: int | None) -> None:
    landscape = land(seed)
    points = plan_points(LINE, landscape)
    heights = heights_m(points, landscape)
    assert len(heights) > 800
    for height_m, planned_m in heights:
        assert planned_m - 0.15 < height_m < (1.0 + BAND) * planned_m + 0.15
    # Legs are divided only where the slope of the ground changes.
    assert len(points) == len(LINE) if seed is None else len(LINE) < len(points) < 60
    assert [point.after_s for point in points] == sorted(point.after_s for point in points)
    assert {round(row[3], 3) for row in LINE} <= {point.after_s for point in points}


def test_altitudes_are_the_autopilots_own() -> None:
    plain, raised = plan_points(LINE, land(3)), plan_points(LINE, land(3), above_map_m=4.25)
    for low, high in zip(plain, raised, strict=True):
        assert high.altitude_amsl_m - low.altitude_amsl_m == pytest.approx(4.25, abs=1e-6)


@stacks
@pytest.mark.parametrize("from_ground", [True, False])
def test_both_stacks_take_the_mission_and_it_ends_high(stack: str, from_ground: bool) -> None:
    landscape = land(4)
    low = plan_points(LINE[:-1], landscape)[:-1]  # the last climb is part of the mission
    assert low[-1].height_m == 15.0
    vehicle = vehicle_of(stack, landscape)
    items = mission_items(low, 5.0, vehicle, BURN, from_ground)
    assert check(items, stack_named(stack, "copter")) == []
    assert not has_drop(items)
    commands = [item.command for item in items]
    assert (commands[0] == mavlink.MAV_CMD_NAV_TAKEOFF) == from_ground
    assert commands.count(mavlink.MAV_CMD_NAV_WAYPOINT) == len(low)
    assert commands.index(mavlink.MAV_CMD_DO_CHANGE_SPEED) == from_ground
    assert commands[-1] == mavlink.MAV_CMD_NAV_LOITER_UNLIM
    ground = float(landscape.elevation_at(*LINE[6, :2]))
    assert 59.9 < items[-1].z - ground < 75.0
    assert (items[-1].x, items[-1].y) == (items[-2].x, items[-2].y)


@stacks
def test_a_mock_flies_it_over_the_ground_at_its_heights_and_speed(stack: str) -> None:
    landscape = land(4)
    vehicle = vehicle_of(stack, landscape)
    home_m = float(landscape.elevation_at(*LINE[0, :2]))
    mock = MockAutopilot(
        stack_named(stack, "copter"),
        LocalFrame(vehicle.home_lat_deg, vehicle.home_lon_deg, home_m),
        airspeed_m_s=12.0,
    )
    pair = Pair(mock)
    pair.run_for(4.0)
    points = plan_points(LINE[:-1], landscape)[:-1]  # the last climb is part of the mission
    items = mission_items(points, 5.0, vehicle, BURN, True)
    assert pair.result_of(pair.client.upload(items, pair.now_us)).outcome == "accepted"
    pair.client.command("start mission", pair.now_us)
    low, speeds = [], []
    climbs = []
    last = len(items) - (0 if mock.stack.item_0_is_home else 1)
    while mock.flight.current < last and pair.now_us < 600 * SECOND:
        pair.run_for(0.5)
        motion = mock.flight.motion
        lat, lon = mock.flight.frame.global_position(motion)
        x, y = landscape.xy_of_lat_lon(lat, lon)
        height_m = motion.altitude_m - float(landscape.elevation_at(x, y))
        speeds.append(motion.speed_m_s)
        climbs.append(motion.climb_m_s)
        if y > 4_020_105.0:
            low.append(height_m)
    assert mock.flight.current == last
    assert height_m < 20.0
    pair.run_for(30.0)
    ground = float(landscape.elevation_at(*LINE[6, :2]))
    assert mock.flight.motion.altitude_m - ground == pytest.approx(66.0, abs=7.0)
    assert mock.flight.motion.speed_m_s < 0.1
    assert max(speeds) < 5.5
    assert float(np.median(speeds[len(speeds) // 2 :])) == pytest.approx(5.0, abs=0.1)
    assert min(climbs) == pytest.approx(-BURN.sink_m_s if stack == "ardupilot" else -1.5, abs=0.01)
    # Corners are cut by 5 m, over ground for which they were not planned.
    assert min(low) > 13.0
    assert max(low) < 20.0  # it sank in place before it flew the line
    assert mock.outputs == []


def test_returns_are_as_high_as_is_safe_over_all_ground_on_the_way() -> None:
    landscape = land(None)
    elevation = landscape.elevation_m
    assert elevation is not None
    elevation[25:28, 30:33] = 340.0  # a hill in the unit
    elevation[2:5, 50:55] = 500.0  # a mountain elsewhere
    corners = [(750_250.0, 4_020_250.0), (750_400.0, 4_020_250.0), (750_400.0, 4_020_450.0)]
    places = [landscape.lat_lon_of(*corner) for corner in corners]
    vehicle = vehicle_of("px4", landscape)
    scenario = load_scenario("default").model_copy(
        update={
            "vehicles": (vehicle,),
            "planner": PlannerSection(rule="burn"),
            "burn": BURN.model_copy(
                update={"unit": tuple((float(a), float(b)) for a, b in places)}
            ),
        }
    )
    assert return_height_m(scenario, landscape) == pytest.approx(100.0)
    assert return_height_m(load_scenario("default"), landscape) is None


SWITCHES = (
    *(181, 182, 183, 184, 187, 211, 216, 42600),  # relays, servos, actuators, gripper, ... winch
    *(
        94,
        30001,
        30002,
        208,
        218,
        217,
        42702,
        600,
    ),  # payloads, parachute, functions, scripts, jumps
    *(203, 206, 214, 2000, 2003, 205, 220, 223, 209),  # cameras, mounts, engine and motors
    *(31010, 31000, 40001, 42703, 65535),  # commands without a fixed meaning
)


@pytest.mark.parametrize("command", SWITCHES)
def test_whatever_may_switch_an_output_counts_as_a_drop(command: int) -> None:
    landscape = land(None)
    flight = mission_items(
        plan_points(LINE, landscape), 5.0, vehicle_of("px4", landscape), BURN, True
    )
    switch = MissionItem(command, 2, 0, 0, 0.0, 9.0, 1900.0)
    assert not has_drop(flight)
    assert has_drop((*flight[:3], switch, *flight[3:]))
