"""Volumes of airspace that are closed to the vehicles, in landscape coordinates."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from firemodel.landscape.landscape import Landscape
from mission_service.config.airspace_section import AirspaceSection, AreaSection, ClosedVolume
from mission_service.config.scenario import Scenario
from mission_service.errors import ScenarioError

OUTSIDE = "outside the allowed areas"  # name of the volume
FAR_M = 100_000.0  # the area outside is closed up to this distance from the allowed areas


@dataclass(frozen=True, slots=True)
class Volume:
    """A volume that is closed to all vehicles for a period.

    Args:
        name: The name, which is unique in a run.
        area_m: The horizontal extent; x, y in metres on the landscape.
        floor_m: Lower limit, in metres above mean sea level; -inf: the ground.
        ceiling_m: Upper limit, in metres above mean sea level; inf: none.
        from_s: Mission time from which the volume is closed.
        until_s: Mission time at which the volume opens again; inf: never.
    """

    name: str
    area_m: BaseGeometry
    floor_m: float = -math.inf
    ceiling_m: float = math.inf
    from_s: float = 0.0
    until_s: float = math.inf

    @property
    def words(self) -> str:
        """The volume in messages to operators."""
        return f"the closed volume {self.name!r}"

    def is_closed(self, at_s: float, lead_s: float = 0.0) -> bool:
        """Return whether the volume is closed at ``at_s``, or will close within ``lead_s``."""
        return self.from_s - lead_s <= at_s < self.until_s

    def contains(self, x_m: float, y_m: float, altitude_m: float) -> bool:
        """Return whether a position is inside the volume."""
        inside = self.floor_m <= altitude_m <= self.ceiling_m
        return inside and bool(shapely.intersects_xy(self.area_m, x_m, y_m))


def volumes_of(section: AirspaceSection, landscape: Landscape) -> tuple[Volume, ...]:
    """Return all closed volumes of a scenario, including those in its files.

    Raises ScenarioError for a file that cannot be read, or if two volumes have the same name.
    """
    found = [volume_of(entry, landscape) for entry in closed_in(section)]
    if section.allowed:
        found.append(Volume(OUTSIDE, _outside(section.allowed, landscape)))
    return tuple(found)


def closed_in(section: AirspaceSection) -> list[ClosedVolume]:
    """Return the entries of all closed volumes of a scenario, including those in its files.

    Raises ScenarioError for a file that cannot be read, or if two volumes have the same name.
    """
    entries = [*section.closed]
    if section.files:
        from mission_service.airspace.volume_files import volumes_in  # imports GDAL

        entries += [entry for path in section.files for entry in volumes_in(path)]
    names = [entry.name for entry in entries]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise ScenarioError(
            f"airspace: two closed volumes have the name {repeated[0]!r}; rename one of them"
        )
    return entries


def volume_of(entry: ClosedVolume, landscape: Landscape) -> Volume:
    """Return the closed volume that an entry of the scenario describes.

    A floor given above ground is measured from the lowest ground in the area and a ceiling from the
    highest, so that the volume is never too small.
    """
    area_m = area_of(entry, landscape)
    lowest_m, highest_m = 0.0, 0.0
    if entry.floor_agl_m is not None or entry.ceiling_agl_m is not None:
        lowest_m, highest_m = ground_range_m(area_m, landscape)
    floor_m, ceiling_m = -math.inf, math.inf
    if entry.floor_amsl_m is not None:
        floor_m = entry.floor_amsl_m
    elif entry.floor_agl_m is not None:
        floor_m = lowest_m + entry.floor_agl_m
    if entry.ceiling_amsl_m is not None:
        ceiling_m = entry.ceiling_amsl_m
    elif entry.ceiling_agl_m is not None:
        ceiling_m = highest_m + entry.ceiling_agl_m
    if floor_m >= ceiling_m:
        raise ScenarioError(
            f"airspace: {entry.name}: its ceiling ({ceiling_m:.0f} m above mean sea level) is not "
            f"above its floor ({floor_m:.0f} m); correct one of them"
        )
    until_s = math.inf if entry.until_s is None else entry.until_s
    return Volume(entry.name, area_m, floor_m, ceiling_m, entry.from_s, until_s)


def require_homes_inside(scenario: Scenario, landscape: Landscape) -> None:
    """Raise ScenarioError if a home is outside the allowed areas: no mission would be sent."""
    if not scenario.airspace.allowed:
        return
    inside = shapely.union_all([area_of(entry, landscape) for entry in scenario.airspace.allowed])
    for vehicle in scenario.vehicles:
        home_m = landscape.xy_of_lat_lon(vehicle.home_lat_deg, vehicle.home_lon_deg)
        if not shapely.intersects_xy(inside, *home_m):
            raise ScenarioError(
                f"airspace: the home of {vehicle.name} is outside the allowed areas, so no mission "
                "would be sent; extend an area"
            )


def area_of(entry: AreaSection, landscape: Landscape) -> BaseGeometry:
    """Return the area of an entry (x, y in metres); raises ScenarioError for an empty area."""
    if entry.corners is not None:
        return polygon_of(entry.name, entry.corners, landscape)
    assert entry.lat_deg is not None
    assert entry.lon_deg is not None
    assert entry.radius_m is not None
    centre = landscape.xy_of_lat_lon(entry.lat_deg, entry.lon_deg)
    _require_finite(entry.name, centre)
    # The polygon around the circle is at most 0.5 % larger.
    return shapely.Point(centre).buffer(entry.radius_m / math.cos(math.pi / 64.0), quad_segs=16)


def polygon_of(
    name: str, corners: Sequence[tuple[float, float]], landscape: Landscape
) -> BaseGeometry:
    """Return the polygon with these corners (lat, lon); raises ScenarioError if it has no area."""
    places_m = np.array([landscape.xy_of_lat_lon(*corner) for corner in corners], dtype=float)
    _require_finite(name, places_m.ravel())
    area = shapely.make_valid(shapely.Polygon(places_m))
    if area.area <= 0.0:
        raise ScenarioError(f"airspace: {name}: the corners enclose no area; list them in order")
    return area


def _require_finite(name: str, places: Iterable[float]) -> None:
    if not np.isfinite(np.asarray(places, dtype=float)).all():
        raise ScenarioError(
            f"airspace: {name}: is too far from the landscape; correct its position"
        )


def ground_range_m(area_m: BaseGeometry, landscape: Landscape) -> tuple[float, float]:
    """Return the lowest and highest ground in an area; off the grid, the edge's is used.

    The ground between the centres of cells is interpolated bilinearly. Its extremes are therefore
    at centres or on the outline, which is sampled at an eighth of the cell size (in long outlines,
    at 100,000 points).
    """
    step_m = max(landscape.cell_size_m / 8.0, area_m.length / 1e5)
    x_m, y_m = shapely.get_coordinates(shapely.segmentize(area_m, step_m)).T
    outline_ground_m = np.asarray(landscape.elevation_at(x_m, y_m))
    assert landscape.elevation_m is not None
    west_m, south_m, east_m, north_m = area_m.bounds
    top, left = landscape.row_col_of(west_m, north_m)
    below, beyond = landscape.row_col_of(east_m, south_m)
    height, width = landscape.shape
    rows, cols = np.meshgrid(
        np.arange(max(math.ceil(top), 0), min(math.floor(below) + 1, height)),
        np.arange(max(math.ceil(left), 0), min(math.floor(beyond) + 1, width)),
    )
    inside = shapely.intersects_xy(area_m, *landscape.xy_of(rows, cols))
    ground_m = np.append(outline_ground_m, landscape.elevation_m[rows[inside], cols[inside]])
    return float(ground_m.min()), float(ground_m.max())


def _outside(allowed: Iterable[AreaSection], landscape: Landscape) -> BaseGeometry:
    inside = shapely.union_all([area_of(entry, landscape) for entry in allowed])
    return shapely.box(*inside.bounds).buffer(FAR_M).difference(inside)
