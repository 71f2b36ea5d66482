"""Converts people, roads and structures to places: cells near them that the fire may reach. Pure.

Fire-weather agencies call such roads, structures and areas *values at risk*.
"""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.errors import ScenarioError
from mission_service.fire_arrival.people import Person
from mission_service.uploaded_shapes import features_in

MAX_VALUES = 2000
MAX_NAME = 80
Kind = Literal["person", "value"]


class Place(NamedTuple):
    """A place that the fire may reach.

    ``cells`` are flat indices of the landscape's grid, at least one. ``key`` is unique and
    permanent; ``lat_deg`` and ``lon_deg`` are those of a point of the place. ``at_unix_us`` is the
    time of a person's position, None for other places.
    """

    key: str
    name: str
    kind: Kind
    lat_deg: float
    lon_deg: float
    at_unix_us: int | None
    cells: NDArray[np.intp]


def person_places(people: Iterable[Person], landscape: Landscape, distance_m: float) -> list[Place]:
    """Return the places within ``distance_m`` of people; people off the landscape are omitted."""
    found = []
    for person in people:
        point = shapely.Point(person.lon_deg, person.lat_deg)
        cells = _cells_near(point, landscape, distance_m)
        if cells.size:
            where = (person.lat_deg, person.lon_deg, person.at_unix_us)
            found.append(Place(f"person/{person.uid}", person.name, "person", *where, cells))
    return found


def values_in(
    path: Path, landscape: Landscape, distance_m: float, group: str | None = None
) -> list[Place]:
    """Return the places within ``distance_m`` of the points, lines and areas in a file.

    ``group`` is the second part of their keys (default: the name of the file). The file is a
    GeoJSON, KML, KMZ or zipped Shapefile (polygons only); the attribute ``name`` is the name of a
    feature. Features off the landscape are omitted. Raises ScenarioError with the file and the
    reason if the file cannot be read, or has no feature on the landscape.
    """
    try:
        features = features_in(path.read_bytes(), str(path))
    except (OSError, FireModelError) as error:
        raise ScenarioError(f"service.fire_arrival.values: {error}") from None
    found = []
    for number, drawn in enumerate(features, start=1):
        if drawn.shape.is_empty:
            continue
        cells = _cells_near(drawn.shape, landscape, distance_m)
        if cells.size:
            name = str(drawn.attributes.get("name") or f"{path.stem} {number}")
            name = "".join(each if each.isprintable() else " " for each in name)
            name = " ".join(name.split())[:MAX_NAME] or f"{path.stem} {number}"
            point = drawn.shape.representative_point()
            key = f"value/{group or path.stem}/{number}"
            found.append(Place(key, name, "value", point.y, point.x, None, cells))
    if not found:
        raise ScenarioError(
            f"service.fire_arrival.values: {path}: no feature lies on the landscape; use a file "
            "of this area, in longitude and latitude"
        )
    if len(found) > MAX_VALUES:
        raise ScenarioError(
            f"service.fire_arrival.values: {path}: {len(found)} features lie on the landscape; at "
            f"most {MAX_VALUES} are accepted: merge features, or keep only the important ones"
        )
    return found


def _cells_near(shape: BaseGeometry, landscape: Landscape, distance_m: float) -> NDArray[np.intp]:
    """Return the cells (flat indices) whose centres are near a shape (longitude, latitude).

    The largest distance is ``distance_m``, but at least half a cell diagonal, so that a point on
    the landscape is near at least one centre.
    """

    def projected(lon_lat: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack(landscape.xy_of_lat_lon(lon_lat[:, 1], lon_lat[:, 0]))

    on_map = shapely.transform(shape, projected)
    reach_m = max(distance_m, landscape.cell_size_m / math.sqrt(2.0))
    bounds_m = shapely.bounds(on_map)
    if not np.isfinite(bounds_m).all():  # too far away for projection
        return np.empty(0, dtype=np.intp)
    west_m, south_m, east_m, north_m = bounds_m
    rows, cols = landscape.shape
    top, left = landscape.row_col_of(west_m - reach_m, north_m + reach_m)
    bottom, right = landscape.row_col_of(east_m + reach_m, south_m - reach_m)
    row = np.arange(max(math.ceil(top), 0), min(math.floor(bottom), rows - 1) + 1)
    col = np.arange(max(math.ceil(left), 0), min(math.floor(right), cols - 1) + 1)
    row, col = (each.ravel() for each in np.meshgrid(row, col, indexing="ij"))
    shapely.prepare(on_map)
    near = shapely.dwithin(on_map, shapely.points(*landscape.xy_of(row, col)), reach_m)
    return np.asarray(row[near] * cols + col[near], dtype=np.intp)
