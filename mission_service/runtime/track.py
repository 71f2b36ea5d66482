"""Stores a vehicle's track in bounded memory; a full track is thinned to every second point."""

from collections.abc import Iterator, Sequence
from typing import Any, overload

import numpy as np

MAX_POINTS = 8_192  # 256 KiB; two hours and a quarter at one point per second
EVERY_US = 1_000_000

Point = tuple[int, float, float, float]


class Track(Sequence[Point]):
    """The points (at_us, lat_deg, lon_deg, altitude_amsl_m), at least 1 s apart."""

    def __init__(self) -> None:
        self._points = np.empty((64, 4))  # float64 is exact for 285 years in microseconds
        self._count = 0
        self._every_us = EVERY_US
        self._latest_us = 0  # time of the last point

    def append_point(self, point: Point) -> None:
        """Add the current position if the interval between points has passed."""
        if self._count and point[0] - self._latest_us < self._every_us:
            return
        if self._count == MAX_POINTS:
            self._count = MAX_POINTS // 2
            self._points[: self._count] = self._points[::2].copy()
            self._every_us *= 2
        elif self._count == len(self._points):
            larger = np.empty((min(2 * self._count, MAX_POINTS), 4))
            larger[: self._count] = self._points
            self._points = larger
        self._points[self._count] = point
        self._count += 1
        self._latest_us = point[0]

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, place: int) -> Point: ...
    @overload
    def __getitem__(self, place: slice) -> list[Point]: ...
    def __getitem__(self, place: int | slice) -> Point | list[Point]:
        found = self._points[: self._count][place]
        return _point(found) if isinstance(place, int) else [_point(each) for each in found]

    def __iter__(self) -> Iterator[Point]:
        return map(_point, self._points[: self._count])


def feature(geometry: str, coordinates: Any, /, **properties: Any) -> dict[str, Any]:
    """Return a GeoJSON Feature with a geometry of the given type."""
    shape = {"type": geometry, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": shape}


def track_geojson(name: str, points: Sequence[Point]) -> dict[str, Any]:
    """Return a track as a GeoJSON Feature, without a geometry for fewer than two points."""
    line = [[lon_deg, lat_deg, altitude_m] for _, lat_deg, lon_deg, altitude_m in points]
    return {
        "type": "Feature",
        "geometry": {"type": "LineString", "coordinates": line} if len(line) > 1 else None,
        "properties": {"vehicle": name, "at_us": [point[0] for point in points]},
    }


def _point(row: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]") -> Point:
    at_us, lat_deg, lon_deg, altitude_m = row.tolist()
    return int(at_us), lat_deg, lon_deg, altitude_m
