"""Poses of images from the telemetry of the vehicles, from MAVLink messages to observed cells."""

import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.vehicle.camera_telemetry import (
    FieldOfView,
    GimbalAttitude,
    ImageCaptured,
    angles_of,
    camera_event,
)
from autopilot_bridge.vehicle.client_events import Attitude
from mission_service import events
from mission_service.runtime.camera_reports import CameraReports
from mission_service.sensors.thermal.camera_geometry import CameraPose, axes_of, tilted
from mission_service.sensors.thermal.telemetry_poses import PoseUnknownError, TelemetryPoses
from mission_service.sensors.thermal.thermal_image import NoPoseError, read_thermal_image

ZERO = datetime(2026, 7, 4, 12, 0, 0, tzinfo=UTC)
DOWN = (90.0, -90.0, 0.0)


def message(kind: type[Any], component: int = 1, **fields: Any) -> Any:
    """Return a message whose other fields are 0."""
    values = {
        name: [0.0] * length if length > 1 and of != "char" else b"" if of == "char" else 0
        for name, of, length in zip(
            kind.fieldnames, _by_field(kind, "fieldtypes"), _by_field(kind, "lengths"), strict=True
        )
    }
    found = kind(**(values | fields))
    found._header.srcSystem, found._header.srcComponent = 1, component
    return found


def _by_field(kind: type[Any], key: str) -> list[Any]:
    """Return an attribute in the order of ``fieldnames``; ``lengths`` are in the order sent."""
    values = getattr(kind, key)
    if key == "fieldtypes":
        return list(values)
    order = dict(zip(kind.ordered_fieldnames, values, strict=True))
    return [order[name] for name in kind.fieldnames]


def turned(yaw_deg: float, pitch_deg: float, roll_deg: float) -> list[float]:
    """Return the quaternion (w, x, y, z) of a rotation by yaw, then pitch, then roll."""
    y, p, r = (math.radians(each) / 2.0 for each in (yaw_deg, pitch_deg, roll_deg))
    cy, sy, cp, sp, cr, sr = (*(f(each) for each in (y, p, r) for f in (math.cos, math.sin)),)
    return [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]


@pytest.mark.parametrize(
    "angles", [(30.0, -60.0, 5.0), (350.0, 10.0, -20.0), (200.0, -90.0, 0.0), (0.0, 0.0, 0.0)]
)
def test_angles_of_a_quaternion_are_those_it_was_made_of(
    angles: tuple[float, float, float],
) -> None:
    assert angles_of(turned(*angles)) == pytest.approx(angles, abs=1e-4)


def test_a_quaternion_of_zeros_or_nan_is_no_direction() -> None:
    assert angles_of([0.0] * 4) is None
    assert angles_of([math.nan] * 4) is None


def test_a_fixed_camera_turns_with_the_airframe() -> None:
    assert tilted((50.0, 0.0, 0.0), -90.0) == pytest.approx((50.0, -90.0, 0.0))
    assert tilted((50.0, 0.0, 0.0), -60.0) == pytest.approx((50.0, -60.0, 0.0))
    yaw_deg, pitch_deg, _ = tilted((0.0, 0.0, 20.0), -90.0)  # right wing down: it looks left
    assert (yaw_deg, pitch_deg) == pytest.approx((270.0, -70.0))
    airframe, camera = (17.0, 8.0, -25.0), (17.0, 8.0 - 40.0, -25.0)
    pitched = axes_of(CameraPose(0.0, 0.0, 0.0, *tilted(airframe, -40.0)))
    right, up, forward = axes_of(CameraPose(0.0, 0.0, 0.0, *airframe))
    turn = math.radians(-40.0)
    assert pitched[2] == pytest.approx(math.cos(turn) * forward + math.sin(turn) * up)
    assert pitched[0] == pytest.approx(right)
    assert not np.allclose(pitched, axes_of(CameraPose(0.0, 0.0, 0.0, *camera)))


def test_messages_of_both_stacks_are_decoded() -> None:
    px4 = message(
        mavlink.MAVLink_camera_image_captured_message,
        time_boot_ms=5_000,
        time_utc=round(ZERO.timestamp() * 1e6),
        lat=363_000_000,
        lon=-841_000_000,
        alt=500_000,
        q=turned(90.0, -60.0, 0.0),
        image_index=7,
        capture_result=1,
        file_url=b"http://10.0.0.2/DCIM/IMG_7.TIF",
    )
    image = camera_event(px4, 1)
    assert isinstance(image, ImageCaptured)
    assert (image.boot_us, image.image_index, image.of_vehicle) == (5_000_000, 7, True)
    assert image.angles == pytest.approx((90.0, -60.0, 0.0), abs=1e-3)
    assert image.file_name == "IMG_7.TIF"
    ardupilot = message(
        mavlink.MAVLink_camera_feedback_message,
        time_usec=round(ZERO.timestamp() * 1e6),
        lat=363_000_000,
        lng=-841_000_000,
        alt_msl=500.0,
        yaw=-90.0,
        img_idx=8,
    )
    feedback = camera_event(ardupilot, 1)
    assert isinstance(feedback, ImageCaptured)
    assert (feedback.boot_us, feedback.taken_utc_us) == (None, round(ZERO.timestamp() * 1e6))
    assert feedback.angles == (270.0, 0.0, 0.0)
    for flags, from_north in ((0, False), (16, True), (32, False), (64, True)):
        status = message(
            mavlink.MAVLink_gimbal_device_attitude_status_message,
            component=154,
            flags=flags,
            q=turned(10.0, -90.0, 0.0),
        )
        gimbal = camera_event(status, 1)
        assert isinstance(gimbal, GimbalAttitude)
        assert gimbal.from_north == from_north
        assert gimbal.angles == pytest.approx((10.0, -90.0, 0.0), abs=0.01)
    info = message(
        mavlink.MAVLink_camera_information_message, focal_length=13.0, sensor_size_h=7.68
    )
    lens = camera_event(info, 1)
    assert isinstance(lens, FieldOfView)
    assert lens.horizontal_deg == pytest.approx(32.9, abs=0.05)


@pytest.mark.parametrize(
    ("kind", "fields"),
    [
        (mavlink.MAVLink_camera_image_captured_message, {"lat": 2_000_000_000}),
        (mavlink.MAVLink_camera_image_captured_message, {"capture_result": 0, "lat": 1}),
        (mavlink.MAVLink_camera_feedback_message, {"alt_msl": math.inf, "lat": 1}),
        (mavlink.MAVLink_gimbal_device_attitude_status_message, {"q": [math.nan] * 4}),
        (mavlink.MAVLink_camera_fov_status_message, {"hfov": math.nan}),
        (mavlink.MAVLink_mount_orientation_message, {"pitch": math.nan}),
    ],
)
def test_implausible_messages_are_not_used(kind: type[Any], fields: dict[str, Any]) -> None:
    assert camera_event(message(kind, **fields), 1) is None


def test_the_direction_is_that_of_the_gimbal_while_it_reports() -> None:
    reports = CameraReports("hawk", 200.0)
    reports.on_gimbal(GimbalAttitude(0, (10.0, -80.0, 1.0), from_north=False))
    first = reports.on_attitude(Attitude(0, 0, 20.0, 5.0, 355.0), 100)
    assert first == events.CameraDirection(100, "hawk", 5.0, -80.0, 1.0, gimbal=True)
    assert reports.on_attitude(Attitude(0, 0, 20.0, 5.0, 355.3), 250_000) is None, "no change"
    turned = reports.on_attitude(Attitude(0, 0, 20.0, 5.0, 355.6), 500_000)
    assert turned == events.CameraDirection(500_000, "hawk", 5.6, -80.0, 1.0, gimbal=True)
    reports.on_gimbal(GimbalAttitude(0, (10.0, -80.0, 1.0), from_north=True))
    north = reports.on_attitude(Attitude(900_000, 0, 20.0, 5.0, 355.0), 900_000)
    assert north == events.CameraDirection(900_000, "hawk", 10.0, -80.0, 1.0, gimbal=True)
    silent = reports.on_attitude(Attitude(1_200_000, 0, 20.0, 5.0, 355.0), 1_200_000)
    assert silent == events.CameraDirection(1_200_000, "hawk", 355.0, 5.0, 20.0, gimbal=False)
    assert reports.on_field_of_view(FieldOfView(0, 45.0), 1) is not None
    assert reports.on_field_of_view(FieldOfView(0, 45.01), 2) is None, "reported on change"


def flown(poses: TelemetryPoses, vehicle: str = "hawk", gimbal: bool = True) -> None:
    """Add ten seconds of a flight to the east at 20 m/s that turns by 10 degrees a second."""
    for step in range(41):
        at_us = 250_000 * step
        lon_deg = -84.0 + 20.0 * at_us / 1e6 / (111_320.0 * math.cos(math.radians(36.0)))
        received_s = ZERO.timestamp() + at_us / 1e6
        fix = events.Telemetry(at_us, vehicle, 36.0, lon_deg, 500.0, 100.0, 0.0, 20.0, 90.0)
        poses.on_event(fix, received_s)
        yaw_deg = (340.0 + 10.0 * at_us / 1e6) % 360.0
        direction = events.CameraDirection(at_us, vehicle, yaw_deg, -80.0, 0.0, gimbal)
        poses.on_event(direction, received_s)


def time_of(second: float) -> datetime:
    return datetime.fromtimestamp(ZERO.timestamp() + second, UTC)


def test_a_pose_is_interpolated_at_the_time_of_the_file_with_the_error_of_this_time() -> None:
    poses = TelemetryPoses(None, 0.2)
    flown(poses)
    pose = poses.pose_of("a.tif", time_of(3.1))
    east_m = (pose.lon_deg + 84.0) * 111_320.0 * math.cos(math.radians(36.0))
    assert east_m == pytest.approx(62.0, abs=0.01)
    assert pose.direction == pytest.approx((11.0, -80.0, 0.0), abs=1e-6)
    assert pose.position_sd_m == pytest.approx(20.0 * 0.2)
    assert pose.direction_sd_deg == pytest.approx(10.0 * 0.2)
    assert poses.mission_us_of(time_of(3.1).timestamp()) == pytest.approx(3_100_000, abs=2)
    with pytest.raises(PoseUnknownError, match="no telemetry at 12:00:11 UTC"):
        poses.pose_of("a.tif", time_of(11.0))
    with pytest.raises(PoseUnknownError, match="reported no image with this name"):
        poses.pose_of("a.tif", None)


def captured(at_us: int, vehicle: str = "hawk", **changes: Any) -> events.ImageCaptured:
    fields: dict[str, Any] = {
        "direction": DOWN, "gimbal": True, "index": 1, "file_name": "", "taken_utc_us": None
    }  # fmt: skip
    return events.ImageCaptured(at_us, vehicle, 36.001, -84.002, 510.0, **(fields | changes))


def test_the_report_of_an_image_is_found_by_its_name_and_by_its_time() -> None:
    poses = TelemetryPoses(None, 0.2)
    flown(poses)
    poses.on_event(captured(4_000_000, file_name="IMG_4.TIF"), 0.0)
    named = poses.pose_of("img_4.tif", time_of(-3600.0))
    assert (named.lat_deg, named.direction, named.taken) == (36.001, DOWN, time_of(4.0))
    assert named.position_sd_m == pytest.approx(20.0 * 0.05)
    poses.on_event(captured(6_000_000), 0.0)
    assert poses.pose_of("b.tif", time_of(6.3)).altitude_amsl_m == 510.0
    assert poses.pose_of("b.tif", time_of(7.5)).altitude_amsl_m == 500.0, "another image"
    poses.on_event(captured(6_500_000), 0.0)
    assert poses.pose_of("b.tif", time_of(6.3)).altitude_amsl_m == 500.0, "either of two images"


def test_an_image_of_one_of_several_vehicles_needs_a_report() -> None:
    poses = TelemetryPoses(None, 0.2)
    flown(poses)
    flown(poses, "falcon")
    with pytest.raises(PoseUnknownError, match="poses without a report require a single vehicle"):
        poses.pose_of("a.tif", time_of(3.0))
    poses.on_event(captured(3_000_000, "falcon"), 0.0)
    assert poses.pose_of("a.tif", time_of(3.0)).lat_deg == 36.001


def test_a_camera_without_a_gimbal_needs_its_pitch() -> None:
    poses = TelemetryPoses(None, 0.2)
    flown(poses, gimbal=False)
    with pytest.raises(PoseUnknownError, match=r"estimate\.thermal_frames\.fixed_pitch_deg"):
        poses.pose_of("a.tif", time_of(3.0))
    fixed = TelemetryPoses(-10.0, 0.2)
    flown(fixed, gimbal=False)
    assert fixed.pose_of("a.tif", time_of(3.0)).direction == pytest.approx((10.0, -90.0, 0.0))


def test_a_file_without_metadata_is_completed(tmp_path: Path) -> None:
    path = tmp_path / "IMG_4.TIF"
    Image.fromarray(np.full((8, 10), 25.0, dtype=np.float32)).save(path)
    poses = TelemetryPoses(None, 0.2)
    with pytest.raises(NoPoseError, match=r"EXIF has no GPS .*; telemetry: the vehicles have"):
        read_thermal_image(path, poses.pose_of)
    flown(poses)
    poses.on_event(events.CameraFieldOfView(1, "hawk", 90.0), 0.0)
    poses.on_event(captured(4_000_000, file_name="IMG_4.TIF"), 0.0)
    image = read_thermal_image(path, poses.pose_of)
    assert (image.lat_deg, image.lon_deg, image.altitude_amsl_m) == (36.001, -84.002, 510.0)
    assert (image.yaw_deg, image.pitch_deg, image.roll_deg) == DOWN
    assert image.taken == time_of(4.0)
    assert image.focal_px == pytest.approx(5.0)
    assert image.position_sd_m == pytest.approx(1.0)
