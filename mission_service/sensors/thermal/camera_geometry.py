"""Convert pixels to lines of sight and positions to pixels, for a camera's lens and pose. Pure."""

import math
from typing import NamedTuple

import numpy as np

from firemodel.arrays import Floats

Angles = tuple[float, float, float]  # yaw, pitch, roll in degrees
VERTICAL = 1e-3  # largest horizontal component of a line of sight that counts as vertical
UNDISTORTION_STEPS, UNDISTORTED = 50, 1e-7  # maximum; change at convergence, < 0.001 pixels
LEVEL = 1e-6  # smallest horizontal component of a line of sight that determines a yaw
WIDEST = 1.3  # largest tangent of a line of sight, as a multiple of that at an image corner


class Lens(NamedTuple):
    """A lens with Brown-Conrady distortion as in OpenCV; all lengths are in pixels.

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
    """Standard deviations of a pose's components, and of the ground's elevation.

    The error of a pose has six components: east, north and up in m, and rotations in rad about the
    camera's right, up and forward axes. Errors of yaw, pitch and roll would not suffice: if the
    camera points straight down, yaw and roll are the same rotation, and a sideways tilt would be
    missing.
    """

    position_sd_m: float  # along each horizontal axis
    altitude_sd_m: float
    direction_sd_deg: float  # of the rotation about each axis
    elevation_sd_m: float

    def pose_sds(self) -> Floats:
        """Return the standard deviations (6,) of the components of a pose's error."""
        position_m = [self.position_sd_m, self.position_sd_m, self.altitude_sd_m]
        return np.array([*position_m, *[math.radians(self.direction_sd_deg)] * 3])

    def covariance(self) -> Floats:
        """Return the covariance matrix (6, 6) of the error of a pose."""
        found: Floats = np.diag(self.pose_sds() ** 2)
        return found


def focal_px_of(field_of_view_deg: float, width: int) -> float:
    """Return the focal length in pixels of a horizontal field of view, without distortion."""
    return width / 2.0 / math.tan(math.radians(field_of_view_deg) / 2.0)


def undistorted(lens: Lens, col: Floats, row: Floats) -> tuple[Floats, Floats]:
    """Return the undistorted tangents (right, down) of the pixels' lines of sight (n,).

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
    """Return the camera's axes (3, 3; right, up, forward), each as a vector east, north, up."""
    yaw, pitch, roll = np.deg2rad([pose.yaw_deg, pose.pitch_deg, pose.roll_deg])
    forward = np.array(
        [math.sin(yaw) * math.cos(pitch), math.cos(yaw) * math.cos(pitch), math.sin(pitch)]
    )
    level = np.array([math.cos(yaw), -math.sin(yaw), 0.0])
    up = np.cross(level, forward)
    right = math.cos(roll) * level - math.sin(roll) * up
    return np.array([right, np.cross(right, forward), forward])


def tilted(angles: Angles, pitch_deg: float) -> Angles:
    """Return the direction of a camera that is fixed to an airframe at a given pitch.

    Args:
        angles: Yaw, pitch and roll of the airframe in degrees, with the signs of ``CameraPose``.
        pitch_deg: Pitch of the camera relative to the airframe, e.g. -90 for straight down.

    Returns:
        Yaw, pitch and roll of the camera in degrees; the roll of a vertical line of sight is 0.
    """
    right, up, forward = axes_of(CameraPose(0.0, 0.0, 0.0, *angles))
    pitch = math.radians(pitch_deg)
    sight = math.cos(pitch) * forward + math.sin(pitch) * up
    above = math.cos(pitch) * up - math.sin(pitch) * forward
    elevation = math.asin(max(-1.0, min(1.0, float(sight[2]))))
    if math.hypot(sight[0], sight[1]) < VERTICAL:
        east, north = above[:2] if elevation < 0.0 else -above[:2]
        return math.degrees(math.atan2(east, north)) % 360.0, math.degrees(elevation), 0.0
    yaw = math.atan2(sight[0], sight[1])
    level = np.array([math.cos(yaw), -math.sin(yaw), 0.0])
    roll = math.atan2(-float(right @ np.cross(level, sight)), float(right @ level))
    return math.degrees(yaw) % 360.0, math.degrees(elevation), math.degrees(roll)


def lines_of_sight(lens: Lens, pose: CameraPose, col: Floats, row: Floats) -> Floats:
    """Return the unit vectors (n, 3; east, north, up) along the lines of sight of pixels (n,)."""
    right, down = undistorted(lens, col, row)
    local = np.column_stack([right, -down, np.ones_like(right)])
    found: Floats = local @ axes_of(pose)
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    return found


def moved(pose: CameraPose, error: Floats) -> CameraPose:
    """Return a pose to which an error (6,; see ``PoseErrors``) is added."""
    east_m, north_m, up_m = (float(part) for part in error[:3])
    axes = axes_of(pose)
    right, _, forward = axes + np.cross(error[3:] @ axes, axes)  # for small rotations
    forward /= np.linalg.norm(forward)
    pitch_deg = math.degrees(math.asin(max(-1.0, min(1.0, forward[2]))))
    if math.hypot(forward[0], forward[1]) > LEVEL:
        yaw = math.atan2(forward[0], forward[1])
        level = np.array([math.cos(yaw), -math.sin(yaw), 0.0])
        roll = math.atan2(-right @ np.cross(level, forward), right @ level)
    else:  # straight down or up, where yaw and roll are the same rotation
        yaw, roll = math.atan2(-right[1], right[0]), 0.0
    return CameraPose(
        pose.x_m + east_m,
        pose.y_m + north_m,
        pose.altitude_amsl_m + up_m,
        math.degrees(yaw),
        pitch_deg,
        math.degrees(roll),
    )


def pixels_of(lens: Lens, pose: CameraPose, offset_m: Floats) -> tuple[Floats, Floats]:
    """Return the columns and rows (n,) of the pixels that show positions.

    This is the inverse of ``lines_of_sight``. ``offset_m`` (n, 3) contains the positions east,
    north and up from the camera. The result is NaN for positions behind the camera, and for
    positions so far to the side that the distortion polynomial does not apply.
    """
    right, up, forward = axes_of(pose) @ offset_m.T
    with np.errstate(divide="ignore", invalid="ignore"):
        ahead = forward > 0.0
        x, y = np.where(ahead, right / forward, np.nan), np.where(ahead, -up / forward, np.nan)
        x[np.hypot(x, y) > WIDEST * math.hypot(lens.width, lens.height) / 2 / lens.focal_px] = (
            np.nan
        )
    k1, k2, p1, p2, k3 = lens.distortion
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    along = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    down = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return (
        along * lens.focal_px + (lens.width - 1) / 2.0,
        down * lens.focal_px + (lens.height - 1) / 2.0,
    )


def mounted_direction(
    platform_deg: tuple[float, float, float], mount_deg: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Return yaw, pitch and roll in degrees of a camera that is mounted on an aircraft.

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
    """Return the rotation (3, 3) from a body's axes (forward, right, down) to north, east, down."""
    (sy, cy), (sp, cp), (sr, cr) = (
        (math.sin(each), math.cos(each)) for each in np.deg2rad([yaw_deg, pitch_deg, roll_deg])
    )
    yaw = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    pitch = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    roll = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    found: Floats = yaw @ pitch @ roll
    return found
