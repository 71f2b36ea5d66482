"""The burn unit: the area to burn, no-drop areas, people, and the geofence for flights."""

import hashlib
import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.readers.shapes import box_of, read_shapes
from mission_service.config.sections import BurnSection
from mission_service.errors import MissionServiceError
from mission_service.guidance.burn.lines.ignition_lines import only_areas
from mission_service.visibility_graph import VisibilityGraph

Floats = NDArray[np.float64]
Corners = tuple[tuple[float, float], ...]  # lat_deg, lon_deg

ARC = 16  # number of segments in a quarter circle
MIN_AREA_M2 = 1.0
CLEAR_M = 0.01  # added to margins to allow for rounding errors


class ExclusionCircle(NamedTuple):
    """A circle around a person or an object, within which drops and low flight are forbidden."""

    name: str
    x_m: float
    y_m: float
    radius_m: float


@dataclass(frozen=True, eq=False)
class BurnUnit:
    """A burn unit, in the landscape's metres; flights stay inside ``fence`` unless it is None."""

    area: BaseGeometry  # Polygon or MultiPolygon, whose holes are not burned
    no_drop: BaseGeometry
    fence: BaseGeometry | None
    people: tuple[ExclusionCircle, ...]
    edge_m: float

    @cached_property
    def droppable(self) -> BaseGeometry:
        """Return the area where spheres may fall; ``may_drop`` accepts every point of this area."""
        left = self.area.difference(_grown(self.area.boundary, self.edge_m + CLEAR_M))
        left = left.difference(_grown(self.no_drop, self.edge_m + CLEAR_M))
        return self._without_people(left if self.fence is None else left.intersection(self.fence))

    @cached_property
    def low_graph(self) -> VisibilityGraph:
        """Return the visibility graph for paths below the safe height."""
        inside = self.area if self.fence is None else self.area.intersection(self.fence)
        return VisibilityGraph(self._without_people(inside))

    @cached_property
    def high_graph(self) -> VisibilityGraph | None:
        """Return the visibility graph for paths at the safe height; None without a fence."""
        return None if self.fence is None else VisibilityGraph(self.fence)

    def _without_people(self, area: BaseGeometry) -> BaseGeometry:
        for person in self.people:
            circle = _grown(shapely.Point(person.x_m, person.y_m), person.radius_m + CLEAR_M)
            area = area.difference(circle)
        return only_areas(area)

    def may_drop(self, places_m: Floats) -> NDArray[np.bool_]:
        """Return, for each position (n, 2), whether a sphere may fall there.

        The test uses exact distances instead of polygonal buffers.
        """
        points = shapely.points(np.asarray(places_m, np.float64).reshape(-1, 2))
        good = shapely.covers(self.area, points)
        good &= shapely.distance(self.area.boundary, points) >= self.edge_m
        if not self.no_drop.is_empty:
            good &= shapely.distance(self.no_drop, points) > self.edge_m
        for person in self.people:
            middle = shapely.Point(person.x_m, person.y_m)
            good &= shapely.distance(middle, points) > person.radius_m
        if self.fence is not None:
            good &= shapely.covers(self.fence, points)
        return np.asarray(good, np.bool_)

    def with_people(self, people: tuple[ExclusionCircle, ...]) -> "BurnUnit":
        """Return a copy of the unit with ``people`` in place of the current people."""
        return replace(self, people=people)

    def digest(self, settings: BurnSection) -> str:
        """Return the SHA-256 (hexadecimal) of the unit's areas, its people and the settings."""
        sha = hashlib.sha256()
        for shape in (self.area, self.no_drop, self.fence):
            sha.update(b"none" if shape is None else shapely.to_wkb(shape, byte_order=1))
            sha.update(b";")
        for person in self.people:
            sha.update(f"{person.name!r},{person[1:]!r};".encode())
        sha.update(f"{self.edge_m!r};".encode())
        sha.update(settings.model_dump_json().encode())
        return sha.hexdigest()


def _grown(shape: BaseGeometry, by_m: float) -> BaseGeometry:
    """Return a polygonal buffer that circumscribes the exact buffer.

    If the shape is empty or the distance is not positive, the shape is returned unchanged.
    """
    if shape.is_empty or by_m <= 0.0:
        return shape
    found: BaseGeometry = shape.buffer(by_m / math.cos(math.pi / (4 * ARC)), quad_segs=ARC)
    return found


def burn_unit_of(
    burn: BurnSection,
    landscape: Landscape,
    home: tuple[float, float] | None = None,
    corners: Corners | None = None,
) -> BurnUnit:
    """Return the burn unit that a scenario describes.

    ``home`` (lat, lon) is the position of the first takeoff. ``corners`` (lat, lon) replace the
    unit in the scenario.

    Raises MissionServiceError with a one-line text if the unit, its fence or a no-drop area is
    invalid, if no area remains for drops, or if home is outside the fence.
    """
    if corners is None and burn.unit_file is not None:
        area = _areas_of(burn.unit_file, landscape)
    else:
        area = _polygon("unit", corners or burn.unit or (), landscape)
    no_drop: BaseGeometry = shapely.MultiPolygon()
    if burn.no_drop_file is not None:
        no_drop = _areas_of(burn.no_drop_file, landscape)
    fence = None if burn.fence is None else _polygon("fence", burn.fence, landscape)
    people = tuple(
        ExclusionCircle(
            person.name, *landscape.xy_of_lat_lon(person.lat_deg, person.lon_deg), person.radius_m
        )
        for person in burn.people
    )
    unit = BurnUnit(area, no_drop, fence, people, burn.edge_m)
    check_unit(unit, None if home is None else landscape.xy_of_lat_lon(*home))
    return unit


def check_unit(unit: BurnUnit, home_m: tuple[float, float] | None = None) -> None:
    """Raise MissionServiceError if no area remains for drops, or if home is outside the fence."""
    if unit.fence is not None:
        if home_m is not None and not unit.fence.covers(shapely.Point(home_m)):
            away_m = unit.fence.distance(shapely.Point(home_m))
            raise MissionServiceError(
                f"burn: home is {away_m:.0f} m outside the fence; extend the fence to include "
                "home, or move home inside it"
            )
        if not only_areas(unit.area.intersection(unit.fence)).area > 0.0:
            raise MissionServiceError(
                "burn: no part of the unit is inside the fence; extend the fence to the unit"
            )
    if unit.droppable.is_empty:
        raise MissionServiceError(
            f"burn: no part of the unit ({unit.area.area / 1e4:.2f} ha) is available for drops: "
            f"edge_m = {unit.edge_m:g}, no-drop areas, people and the fence exclude all of it; "
            "enlarge the unit, or reduce the exclusions"
        )


def _polygon(name: str, corners: Corners, landscape: Landscape) -> BaseGeometry:
    places = np.array(corners, np.float64).reshape(-1, 2)
    x_m, y_m = landscape.xy_of_lat_lon(places[:, 0], places[:, 1])
    xy_m = np.stack([x_m, y_m], axis=1)
    inside = shapely.covers(box_of(landscape), shapely.points(xy_m))
    if not inside.all():
        corner = int(np.argmin(inside))
        raise MissionServiceError(
            f"burn: {name}: corner {corner + 1} (lat {places[corner, 0]:.5f}, lon "
            f"{places[corner, 1]:.5f}) is outside the landscape; correct it (lat first, then lon)"
        )
    if len(places) < 3:
        raise MissionServiceError(f"burn: {name}: has {len(places)} corners; specify at least 3")
    return _checked(f"burn: {name}", shapely.Polygon(xy_m), landscape)


def _areas_of(path: Path, landscape: Landscape) -> BaseGeometry:
    try:
        shapes = read_shapes(path, landscape)
    except FireModelError as error:
        raise MissionServiceError(f"burn: {error}") from None
    for number, shape in enumerate(shapes, start=1):
        if shape.geom_type not in ("Polygon", "MultiPolygon"):
            raise MissionServiceError(
                f"burn: {path}: feature {number} is a {shape.geom_type}; draw polygons only"
            )
    return _checked(f"burn: {path}", shapely.union_all(shapes), landscape)


def _checked(where: str, area: BaseGeometry, landscape: Landscape) -> BaseGeometry:
    if not area.is_valid:
        reason, _, place = shapely.is_valid_reason(area).rstrip("]").partition("[")
        lat, lon = landscape.lat_lon_of(*map(float, place.split()[:2]))
        raise MissionServiceError(
            f"{where}: {reason} at lat {lat:.5f}, lon {lon:.5f}; list "
            "its corners in order along the boundary, so that no two sides cross"
        )
    if not area.area >= MIN_AREA_M2:
        raise MissionServiceError(
            f"{where}: has no area; specify at least three corners that are not on one line"
        )
    if not box_of(landscape).covers(area):
        raise MissionServiceError(
            f"{where}: extends beyond the landscape; make it smaller, or use a larger landscape"
        )
    return area
