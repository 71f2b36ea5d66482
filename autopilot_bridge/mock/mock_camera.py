"""Simulates the camera and the gimbal of a mock, according to the rules of each stack.

Both stacks take an image when the vehicle has moved the distance set by DO_SET_CAM_TRIGG_DIST since
the last image, and at once if the third param of the command is 1 (PX4 1.17 ``camera_trigger.cpp``,
ArduPilot 4.6.2 ``AP_Camera_Backend.cpp``). PX4 accepts DO_GIMBAL_MANAGER_PITCHYAW only after
DO_GIMBAL_MANAGER_CONFIGURE, because PX4's missions do not control the gimbal otherwise
(``input_mavlink.cpp``). Only ArduPilot executes IMAGE_START_CAPTURE itself. The gimbal keeps its
pitch and a roll of 0, and follows the heading.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Message
from autopilot_bridge.mock.kinematics import Motion
from autopilot_bridge.stacks.stacks import Stack

TARGETING = mavlink.MAV_MOUNT_MODE_MAVLINK_TARGETING
LOWEST_PITCH_DEG, HIGHEST_PITCH_DEG = -90.0, 30.0


class CapturedImage(NamedTuple):
    """One image: its number, its time since boot, and the true pose of the camera."""

    number: int
    boot_us: int
    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float
    yaw_deg: float
    pitch_deg: float
    roll_deg: float


@dataclass(slots=True)
class MockCamera:
    """The camera of one vehicle; ``on_image`` is called with each image."""

    stack: Stack
    on_image: Callable[[CapturedImage], None]
    pitch_deg: float = 0.0  # of the gimbal
    _distance_m: float = 0.0  # between images; 0 means no images
    _last: tuple[float, float] | None = None  # metres north and east
    _wanted: int = 0  # images to be taken at once
    _every_us: int = 0
    _due_us: int = 0
    _remaining: float = 0.0  # images requested by IMAGE_START_CAPTURE
    _in_control: bool = False  # whether missions control PX4's gimbal
    _index: int = 0

    def run_command(self, command: int, params: tuple[float, ...], at_us: int) -> bool:
        """Execute a command with params 1 to 7; return False if the stack does not support it."""
        px4 = self.stack.name == "px4"
        match command:
            case mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST:
                self._distance_m = max(params[0], 0.0)
                self._last = self._last if self._distance_m else None
                self._wanted += int(params[2]) == 1
            case mavlink.MAV_CMD_DO_DIGICAM_CONTROL:
                self._wanted += int(params[4]) == 1
            case mavlink.MAV_CMD_DO_MOUNT_CONTROL:
                if int(params[6]) == TARGETING:
                    self._point(params[0])
            case mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE if px4:
                self._in_control = True
            case mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW if not px4 or self._in_control:
                self._point(params[0])
            case mavlink.MAV_CMD_IMAGE_START_CAPTURE if not px4:
                self._every_us, self._due_us = round(params[1] * 1e6), at_us
                self._remaining = params[2] if params[2] or not params[1] else math.inf
                if not self._every_us:
                    self._wanted, self._remaining = self._wanted + 1, 0.0
            case mavlink.MAV_CMD_IMAGE_STOP_CAPTURE if not px4:
                self._remaining = 0.0
            case _:
                return False
        return True

    def _point(self, pitch_deg: float) -> None:
        if math.isfinite(pitch_deg):
            self.pitch_deg = min(max(pitch_deg, LOWEST_PITCH_DEG), HIGHEST_PITCH_DEG)

    def wants_image(self, motion: Motion, at_us: int) -> bool:
        """Return whether an image is due at a step."""
        place = (motion.north_m, motion.east_m)
        if self._distance_m > 0.0:
            if self._last is None:
                self._last = place
            self._wanted += math.dist(place, self._last) >= self._distance_m
        if self._remaining > 0 and at_us >= self._due_us:
            self._due_us += self._every_us
            self._remaining -= 1
            self._wanted += 1
        if not self._wanted:
            return False
        self._wanted = 0
        self._last = place
        return True

    def capture(self, place: tuple[float, float], motion: Motion, at_us: int) -> CapturedImage:
        """Take an image at a latitude and longitude, and return it."""
        yaw_deg = math.degrees(motion.heading_rad) % 360.0
        image = CapturedImage(
            self._index, at_us, *place, motion.altitude_m, yaw_deg, self.pitch_deg, 0.0
        )
        self._index += 1
        self.on_image(image)
        return image


def image_report(stack: Stack, image: CapturedImage, motion: Motion, home_m: float) -> Message:
    """Return the message that a stack sends for an image; it contains no file name."""
    place = (round(image.lat_deg * 1e7), round(image.lon_deg * 1e7))
    altitude_m = image.altitude_amsl_m
    if stack.name == "px4":
        heights = (round(altitude_m * 1e3), round((altitude_m - home_m) * 1e3))
        q = quaternion(image.yaw_deg, image.pitch_deg)
        return mavlink.MAVLink_camera_image_captured_message(
            image.boot_us // 1000, 0, 1, *place, *heights, q, image.number, 1, b""
        )
    attitude = (math.degrees(motion.roll_rad), 0.0, image.yaw_deg)
    return mavlink.MAVLink_camera_feedback_message(
        *(image.boot_us, 0, 0, image.number % 65536, *place),
        *(altitude_m, altitude_m - home_m, *attitude, 0.0, mavlink.CAMERA_FEEDBACK_PHOTO, 0),
    )


def gimbal_status(boot_ms: int, pitch_deg: float) -> Message:
    """Return the GIMBAL_DEVICE_ATTITUDE_STATUS of a gimbal that follows the heading."""
    flags = mavlink.GIMBAL_DEVICE_FLAGS_PITCH_LOCK | mavlink.GIMBAL_DEVICE_FLAGS_ROLL_LOCK
    unknown = math.nan
    return mavlink.MAVLink_gimbal_device_attitude_status_message(
        *(0, 0, boot_ms, flags, quaternion(0.0, pitch_deg), unknown, unknown, unknown, 0),
        *(unknown, unknown, 1),
    )


def quaternion(yaw_deg: float, pitch_deg: float) -> list[float]:
    """Return the quaternion (w, x, y, z) of a direction without roll."""
    yaw, pitch = math.radians(yaw_deg) / 2.0, math.radians(pitch_deg) / 2.0
    return [
        math.cos(yaw) * math.cos(pitch),
        -math.sin(yaw) * math.sin(pitch),
        math.cos(yaw) * math.sin(pitch),
        math.sin(yaw) * math.cos(pitch),
    ]
