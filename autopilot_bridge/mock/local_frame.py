"""Converts positions near home to metres, and altitudes from the frames of mission items."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from autopilot_bridge.items import RELATIVE_FRAMES, MissionItem
from autopilot_bridge.mock.kinematics import Motion
from autopilot_bridge.stacks.item_treatment import TERRAIN_FRAMES

Terrain = Callable[[float, float], float]  # (latitude, longitude) in degrees -> m AMSL


@dataclass(slots=True)
class LocalFrame:
    """Coordinates in metres north and east of home, using the WGS84 radii of curvature at home.

    Args:
        lat_deg: Latitude of home in degrees.
        lon_deg: Longitude of home in degrees.
        altitude_m: Altitude of home above mean sea level in metres.
    """

    lat_deg: float
    lon_deg: float
    altitude_m: float
    north_m_per_deg: float = field(init=False)
    east_m_per_deg: float = field(init=False)

    def __post_init__(self) -> None:
        sine = math.sin(math.radians(self.lat_deg))
        first = 1.0 - 6.69437999014e-3 * sine * sine
        meridian = 6378137.0 * (1.0 - 6.69437999014e-3) / first**1.5
        normal = 6378137.0 / math.sqrt(first)
        self.north_m_per_deg = math.radians(meridian)
        self.east_m_per_deg = math.radians(normal) * math.cos(math.radians(self.lat_deg))

    def local(self, item: MissionItem) -> tuple[float, float]:
        """Return an item's distances north and east of home, in metres."""
        return self.local_of(item.x / 1e7, item.y / 1e7)

    def local_of(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        """Return a position's distances north and east of home, in metres."""
        return (
            (lat_deg - self.lat_deg) * self.north_m_per_deg,
            (lon_deg - self.lon_deg) * self.east_m_per_deg,
        )

    def global_position(self, motion: Motion) -> tuple[float, float]:
        """Return the latitude and longitude of a vehicle in degrees."""
        return (
            self.lat_deg + motion.north_m / self.north_m_per_deg,
            self.lon_deg + motion.east_m / self.east_m_per_deg,
        )

    def altitude_amsl_m(self, item: MissionItem, terrain_amsl_m: float) -> float:
        """Return an item's altitude above mean sea level, for terrain at ``terrain_amsl_m``."""
        if item.frame in TERRAIN_FRAMES:
            return item.z + terrain_amsl_m
        return item.z + (self.altitude_m if item.frame in RELATIVE_FRAMES else 0.0)
