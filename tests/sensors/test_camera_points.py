"""Hot points and tracked objects that cameras report by MAVLink become observations."""

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.vehicle.camera_telemetry import HottestPoint, TrackedPlace, camera_event
from benchmarks.thermal_frames import pose_above, steep_landscape
from firemodel.landscape.landscape import Landscape
from mission_service import events
from mission_service.config.scenario import load_scenario
from mission_service.fire.sensors import Sensors
from mission_service.runtime.camera_reports import CameraReports
from mission_service.sensors.thermal.camera_points import CameraPoints
from tests.sensors.test_telemetry_poses import message

HEADING_DEG = 90.0


@pytest.fixture(scope="module")
def land() -> Landscape:
    return steep_landscape(10.0)


def fix_at(land: Landscape, at_us: int, vehicle: str = "hawk") -> events.Telemetry:
    pose = pose_above(land, 300.0, 300.0, 0.0, -90.0)
    lat_deg, lon_deg = (float(each) for each in land.lat_lon_of(pose.x_m, pose.y_m))
    place = (lat_deg, lon_deg, pose.altitude_amsl_m)
    return events.Telemetry(at_us, vehicle, *place, 120.0, 0.0, 0.0, HEADING_DEG)


def points_over(land: Landscape, until_us: int) -> CameraPoints:
    """Return the sensor after the telemetry of a hovering vehicle that looks straight down."""
    found = CameraPoints(load_scenario("default"), land)
    found.on_event(events.CameraFieldOfView(0, "hawk", 45.0, 36.0))
    feed(found, land, 0, until_us)
    return found


def feed(sensor: CameraPoints, land: Landscape, since_us: int, until_us: int) -> None:
    yaw_deg = float(land.true_deg(HEADING_DEG))
    for at_us in range(since_us, until_us, 250_000):
        sensor.on_event(fix_at(land, at_us))
        sensor.on_event(events.CameraDirection(at_us, "hawk", yaw_deg, -90.0, 0.0, gimbal=True))


@pytest.mark.parametrize(
    ("x", "y", "south_cells", "east_cells"),
    [(0.5, 0.5, 0, 0), (1.0, 0.5, 5, 0), (0.5, 0.0, 0, 4)],  # the top of the image is east
)
def test_a_hot_point_is_placed_by_the_pose_of_the_camera(
    x: float, y: float, south_cells: int, east_cells: int, land: Landscape
) -> None:
    sensor = points_over(land, 2_000_000)
    sensor.on_event(events.HotPointSeen(1_100_000, "hawk", 450.0, x, y))
    seen = sensor.observe(fix_at(land, 2_000_000))
    assert seen is not None
    assert (seen.at_us, seen.cells) == (1_100_000, ("b",))
    steep = 2 if south_cells or east_cells else 0  # the ground below is not level
    assert seen.row - 300 == pytest.approx(south_cells, abs=steep)
    assert seen.col - 300 == pytest.approx(east_cells, abs=steep)
    assert 1.5 < seen.position_sd_m < 6.0
    found = Sensors({"camera_points": sensor}, land.shape)
    sensor.on_event(events.HotPointSeen(1_200_000, "hawk", 450.0, x, y))
    assert [each.source for each in found.observe(fix_at(land, 2_250_000))] == ["camera_points"]


def test_a_vehicle_without_a_link_does_not_delay_the_points_of_others(land: Landscape) -> None:
    sensor = points_over(land, 1_000_000)
    place = fix_at(land, 0)
    for at_us, vehicle in ((1_000_000, "hawk"), (2_000_000, "owl"), (3_000_000, "owl")):
        at = (at_us, vehicle, place.lat_deg, place.lon_deg, 3.0)
        sensor.on_event(events.TargetTracked(*at))
    seen = [sensor.observe(fix_at(land, at_us, "owl")) for at_us in (2_250_000, 3_250_000)]
    assert [each and (each.vehicle, each.at_us) for each in seen] == [
        ("owl", 2_000_000),
        ("owl", 3_000_000),
    ]
    assert sensor.problem == ""
    assert sensor.observe(fix_at(land, 61_250_000, "owl")) is None
    assert sensor.problem == "a point from hawk is not used: no position arrived within 60 s"
    assert sensor.observe(fix_at(land, 61_500_000)) is None
    sensor.on_event(events.TargetTracked(61_600_000, "owl", place.lat_deg, place.lon_deg, 3.0))
    assert sensor.observe(fix_at(land, 61_750_000, "owl")) is not None
    assert sensor.problem == ""


def test_a_point_waits_for_its_telemetry_and_is_named_if_there_is_none(land: Landscape) -> None:
    sensor = points_over(land, 1_000_000)
    sensor.on_event(events.HotPointSeen(2_000_000, "hawk", 450.0, 0.5, 0.5))
    assert sensor.observe(fix_at(land, 2_250_000)) is None
    assert sensor.observe(fix_at(land, 5_250_000)) is None
    assert "a point from hawk is not used: no position at mission time 2.0 s" in sensor.problem
    sensor.on_event(events.HotPointSeen(6_000_000, "hawk", 450.0, 0.5, 0.5))
    feed(sensor, land, 5_500_000, 7_000_000)
    assert sensor.observe(fix_at(land, 7_000_000)) is not None
    assert sensor.problem == ""


def test_a_tracked_object_is_one_cell_with_the_error_that_the_camera_reports(
    land: Landscape,
) -> None:
    sensor = CameraPoints(load_scenario("default"), land)
    lat_deg, lon_deg = (float(each) for each in land.lat_lon_of(*land.xy_of(120.0, 140.0)))
    sensor.on_event(events.TargetTracked(1_000_000, "hawk", lat_deg, lon_deg, 4.0))
    assert sensor.observe(fix_at(land, 2_000_000, "falcon")) is None, "another vehicle"
    seen = sensor.observe(fix_at(land, 2_000_000))
    assert seen is not None
    assert (seen.row, seen.col, seen.position_sd_m) == (120, 140, 4.0)
    sensor.on_event(events.TargetTracked(2_000_000, "hawk", 10.0, 10.0, None))
    assert sensor.observe(fix_at(land, 3_000_000)) is None
    assert "not on the landscape" in sensor.problem


def test_messages_become_events_once_a_second_if_they_are_hot() -> None:
    hottest = camera_event(
        message(mavlink.MAVLink_camera_thermal_range_message, max=450.0, max_point_x=0.25), 1
    )
    assert hottest == HottestPoint(1, 450.0, 0.25, 0.0)
    unknown = message(mavlink.MAVLink_camera_thermal_range_message, max=math.nan)
    assert camera_event(unknown, 1) is None
    place = {"lat": 363_000_000, "lon": -841_000_000}
    status: dict[str, Any] = {"tracking_status": 1, "h_acc": np.nan, **place}
    kind = mavlink.MAVLink_camera_tracking_geo_status_message
    tracked = camera_event(message(kind, **status), 1)
    assert tracked == TrackedPlace(1, 36.3, -84.1, None)
    assert camera_event(message(kind, **(status | {"tracking_status": 0})), 1) is None
    reports = CameraReports("hawk", 200.0)
    assert isinstance(hottest, HottestPoint)
    assert isinstance(tracked, TrackedPlace)
    seen = reports.on_hottest(hottest, 1_000_000)
    assert seen == events.HotPointSeen(1_000_000, "hawk", 450.0, 0.25, 0.0)
    assert reports.on_hottest(hottest, 1_500_000) is None
    assert reports.on_hottest(HottestPoint(1, 150.0, 0.5, 0.5), 9_000_000) is None
    assert reports.on_target(tracked, 1_000_000) is not None
    assert reports.on_target(tracked, 1_500_000) is None
