"""Compute the lines of sight of a camera's pixels, with lens distortion, from its pose. Pure."""

import math
from typing import NamedTuple

import numpy as np

from firemodel.arrays import Floats

UNDISTORTION_STEPS, UNDISTORTED = 50, 1e-7  # at most; a change below a thousandth of a pixel


class Lens(NamedTuple):
    """A camera with Brown-Conrady distortion, as OpenCV defines it; all lengths are in pixels.

    ``distortion`` is k1, k2, p1, p2, k3. The principal point is the centre of the image.
    """

    width: int
    height: int
    focal_px: float
    distortion: tuple[float, float, float, float, float] = (0.0,) * 5


class CameraPose(NamedTuple):
    """The position and the direction of a camera.

    ``yaw_deg`` is clockwise from grid north, ``pitch_deg`` is -90 straight down and 0 at the
    horizon, and ``roll_deg`` is clockwise as seen from behind the camera.
    """

    x_m: float
    y_m: float
    altitude_amsl_m: float
    yaw_deg: float
    pitch_deg: float
    roll_deg: float = 0.0


class PoseErrors(NamedTuple):
    """Standard deviations of the parts of a pose, and of the elevation of the ground."""

    position_sd_m: float  # of each horizontal axis
    altitude_sd_m: float
    direction_sd_deg: float  # of each of yaw, pitch and roll
    elevation_sd_m: float

    def shifted(self, pose: CameraPose) -> list[CameraPose]:
        """Return the pose with each of its parts in error by one standard deviation.

        An error of the elevation has the effect of an opposite error of the altitude.
        """
        vertical_m = math.hypot(self.altitude_sd_m, self.elevation_sd_m)
        steps = {
            "x_m": self.position_sd_m,
            "y_m": self.position_sd_m,
            "altitude_amsl_m": vertical_m,
            "yaw_deg": self.direction_sd_deg,
            "pitch_deg": self.direction_sd_deg,
            "roll_deg": self.direction_sd_deg,
        }
        return [pose._replace(**{name: getattr(pose, name) + steps[name]}) for name in steps]


def focal_px_of(field_of_view_deg: float, width: int) -> float:
    """Return the focal length in pixels of a horizontal field of view, without distortion."""
    return width / 2.0 / math.tan(math.radians(field_of_view_deg) / 2.0)


def undistorted(lens: Lens, col: Floats, row: Floats) -> tuple[Floats, Floats]:
    """Return the tangents (right, down) of the lines of sight of pixels (n,), without distortion.

    The inverse of the distortion is found by fixed-point iteration, as in OpenCV.
    """
    k1, k2, p1, p2, k3 = lens.distortion
    right = (col - (lens.width - 1) / 2.0) / lens.focal_px
    down = (row - (lens.height - 1) / 2.0) / lens.focal_px
    x, y = right.copy(), down.copy()
    if any(lens.distortion):
        for _ in range(UNDISTORTION_STEPS):
            r2 = x * x + y * y
            radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
            before = x
            x, y = (
                (right - 2.0 * p1 * x * y - p2 * (r2 + 2.0 * x * x)) / radial,
                (down - p1 * (r2 + 2.0 * y * y) - 2.0 * p2 * x * y) / radial,
            )
            if np.abs(x - before).max(initial=0.0) < UNDISTORTED:
                break
    return x, y


def axes_of(pose: CameraPose) -> Floats:
    """Return the camera's axes (3, 3): right, up and forward, each as east, north and up."""
    yaw, pitch, roll = np.deg2rad([pose.yaw_deg, pose.pitch_deg, pose.roll_deg])
    forward = np.array(
        [math.sin(yaw) * math.cos(pitch), math.cos(yaw) * math.cos(pitch), math.sin(pitch)]
    )
    level = np.array([math.cos(yaw), -math.sin(yaw), 0.0])
    up = np.cross(level, forward)
    right = math.cos(roll) * level - math.sin(roll) * up
    return np.array([right, np.cross(right, forward), forward])


def lines_of_sight(lens: Lens, pose: CameraPose, col: Floats, row: Floats) -> Floats:
    """Return the unit vectors (n, 3), east, north and up, of pixels (n,) at columns and rows."""
    right, down = undistorted(lens, col, row)
    local = np.column_stack([right, -down, np.ones_like(right)])
    found: Floats = local @ axes_of(pose)
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    return found


def mounted_direction(
    platform_deg: tuple[float, float, float], mount_deg: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Return yaw, pitch and roll of a camera on a platform in degrees.

    Args:
        platform_deg: Heading from true north, pitch and roll of the aircraft.
        mount_deg: Azimuth, elevation and roll of the camera relative to the aircraft; MISB ST 0601
            tags 18 to 20. An elevation of -90 is straight down for a level aircraft.
    """
    forward, right, _ = (_turns(*platform_deg) @ _turns(*mount_deg)).T
    yaw, pitch = math.atan2(forward[1], forward[0]), math.asin(np.clip(-forward[2], -1.0, 1.0))
    level = np.array([-math.sin(yaw), math.cos(yaw), 0.0])
    below = np.cross(forward, level)
    roll = math.atan2(float(right @ below), float(right @ level))
    return math.degrees(yaw) % 360.0, math.degrees(pitch), math.degrees(roll)


def _turns(yaw_deg: float, pitch_deg: float, roll_deg: float) -> Floats:
    """Return the matrix (3, 3) from a body's axes (forward, right, down) to north, east, down."""
    (sy, cy), (sp, cp), (sr, cr) = (
        (math.sin(each), math.cos(each)) for each in np.deg2rad([yaw_deg, pitch_deg, roll_deg])
    )
    yaw = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    pitch = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    roll = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    found: Floats = yaw @ pitch @ roll
    return found
