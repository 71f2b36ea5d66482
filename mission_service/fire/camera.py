"""Compute the ground footprint of a nadir-pointing camera."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mission_service.config.sections import VehicleSection

EDGE = 1e-9  # tolerance: a position on an edge is inside


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera whose footprint is a disc or, with ``along_rad``, a rectangle along the heading.

    ``across_rad`` and ``along_rad`` are the fields of view across and along the track, in rad.
    """

    across_rad: float
    along_rad: float | None = None

    def half_width_m(self, height_m: float) -> float:
        """Return the disc's radius, or half the rectangle's width, at a height above ground."""
        return max(height_m, 0.0) * math.tan(self.across_rad / 2.0)

    def half_length_m(self, height_m: float) -> float:
        """Return half the rectangle's length along the track; 0 for a disc."""
        return max(height_m, 0.0) * math.tan((self.along_rad or 0.0) / 2.0)


def beyond_rectangle(
    south: Any, east: Any, heading_deg: float, half_width: float, half_length: float
) -> NDArray[np.bool_]:
    """Return the mask of positions outside a rectangle about (0, 0), aligned with a heading."""
    cos, sin = math.cos(math.radians(heading_deg)), math.sin(math.radians(heading_deg))
    ahead, right = east * sin - south * cos, east * cos + south * sin
    return np.asarray((np.abs(ahead) > half_length + EDGE) | (np.abs(right) > half_width + EDGE))


def camera_of(vehicle: VehicleSection) -> Camera:
    """Return the camera of a vehicle."""
    along_deg = vehicle.camera_along_deg
    along_rad = None if along_deg is None else math.radians(along_deg)
    return Camera(math.radians(vehicle.camera_fov_deg), along_rad)
