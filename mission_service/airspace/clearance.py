"""Checks the space occupied by a vehicle against closed volumes and the altitude limit."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from firemodel.landscape.landscape import Landscape
from mission_service.airspace.occupied_space import Part, Position
from mission_service.airspace.volumes import Volume

ROUNDING_M = 0.5  # altitude tolerance, because altitudes in missions are rounded


@dataclass(frozen=True, slots=True)
class Margins:
    """The distances in metres that planned flights keep from closed volumes."""

    horizontal_m: float
    vertical_m: float


@dataclass(frozen=True, slots=True)
class Airspace:
    """The closed volumes at one time, the margins, and the highest altitude above ground."""

    volumes: tuple[Volume, ...]
    margins: Margins
    max_altitude_agl_m: float | None = None

    @property
    def is_limited(self) -> bool:
        """Whether any limit applies."""
        return bool(self.volumes) or self.max_altitude_agl_m is not None

    def volume_at(self, position: Position) -> Volume | None:
        """Return a closed volume that contains a position, without margins, or None."""
        return next((volume for volume in self.volumes if volume.contains(*position)), None)

    def blocked(self, lowest_m: float, highest_m: float) -> list[Volume]:
        """Return the volumes that affect flights between two altitudes, including the margin."""
        margin_m = self.margins.vertical_m
        return [
            volume
            for volume in self.volumes
            if volume.floor_m - margin_m < highest_m and lowest_m < volume.ceiling_m + margin_m
        ]

    def conflict(
        self, parts: Iterable[Part], landscape: Landscape, start: Position | None = None
    ) -> str | None:
        """Return the airspace that the parts would enter, in words; None without a conflict.

        If a flight begins at ``start`` within the margin of a volume, the parts near ``start``
        (within that margin) need only be as far from the volume as ``start``, so that the flight
        can leave the margin. Parts that lead from above or below the volume towards its altitudes
        keep the full margin.
        """
        parts = list(parts)
        for volume in self.volumes:
            if self._enters(parts, volume, start):
                return volume.words
        if self.max_altitude_agl_m is None:
            return None
        for part in [each for each in parts if not each.beside]:
            above_m = _highest_above_ground_m(part, landscape)
            if above_m > self.max_altitude_agl_m + ROUNDING_M:
                return f"the airspace above the limit of {self.max_altitude_agl_m:g} m above ground"
        return None

    def _enters(self, parts: Sequence[Part], volume: Volume, start: Position | None) -> bool:
        margin_m, vertical_m = self.margins.horizontal_m, self.margins.vertical_m
        floor_m, ceiling_m = volume.floor_m - vertical_m, volume.ceiling_m + vertical_m
        within = [part for part in parts if floor_m < part.highest_m and part.lowest_m < ceiling_m]
        if not within:
            return False
        shapes = np.array([part.shape for part in within])
        leaves = np.zeros(len(within), dtype=bool)
        margin_here_m = margin_m
        if start is not None and floor_m < start[2] < ceiling_m:
            here = shapely.Point(start[:2])
            off_m = float(shapely.distance(volume.area_m, here))
            margin_here_m = min(margin_m, max(off_m - 1.0, 0.0))
            leads_into = np.array([_leads_into(part, start[2], volume) for part in within])
            leaves = shapely.dwithin(shapes, here, margin_m) & ~leads_into
        enter = shapely.dwithin(volume.area_m, shapes[~leaves], margin_m)
        leaving_enter = shapely.dwithin(volume.area_m, shapes[leaves], margin_here_m)
        return bool(np.any(enter) or np.any(leaving_enter))


def _leads_into(part: Part, altitude_m: float, volume: Volume) -> bool:
    """Return whether a part leads from above or below a volume towards its altitudes."""
    climbs = altitude_m < volume.floor_m and part.highest_m > altitude_m + ROUNDING_M
    return climbs or (altitude_m > volume.ceiling_m and part.lowest_m < altitude_m - ROUNDING_M)


def blocked_area(volumes: Iterable[Volume], margin_m: float) -> BaseGeometry:
    """Return the union of the volumes' areas, enlarged by a margin."""
    areas = [volume.area_m.buffer(margin_m, quad_segs=4) for volume in volumes]
    return shapely.union_all(areas)


def _highest_above_ground_m(part: Part, landscape: Landscape) -> float:
    """Return a flight part's greatest height above the lowest ground below it."""
    line = part.shape.exterior if isinstance(part.shape, shapely.Polygon) else part.shape
    points = shapely.get_coordinates(shapely.segmentize(line, landscape.cell_size_m / 2.0))
    ground_m = landscape.elevation_at(points[:, 0], points[:, 1])
    return part.highest_m - float(np.min(ground_m))
