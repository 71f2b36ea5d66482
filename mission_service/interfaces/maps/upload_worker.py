"""Reads one uploaded file in a separate process, because a file may crash the process.

GEOS cannot be interrupted, holds the GIL while it runs, and has crashed on invalid input, so the
service's process never passes uploaded geometry to GEOS. Uploaded rasters, too, are read with GDAL
only in the worker.
The worker reads a ``Job`` or ``RasterJob`` from stdin and writes ``Done``, ``RasterDone`` or
``Failed`` to stdout.
"""

import sys
from typing import Any

import msgspec
import shapely
from shapely.geometry.base import BaseGeometry

from autopilot_bridge.errors import BridgeError
from firemodel.errors import FireModelError
from firemodel.spread.front import multipolygon
from mission_service.interfaces.maps.perimeter_import import (
    Perimeter,
    printable,
    read_perimeter_in,
)
from mission_service.interfaces.maps.raster_import import read_raster
from mission_service.interfaces.maps.thinning import thinned
from mission_service.sensors.worker_process import limit_process

MAX_RINGS = 50  # polygons and islands together
EDGE_DEG = 1e-5  # one metre: corners on the landscape's edge may be rounded outwards
MAX_POINTS = 900  # maximum per correction; less than the limit for requests


class Job(msgspec.Struct, tag="perimeter"):
    """An uploaded perimeter, and the outline of the landscape (longitude, latitude)."""

    data: bytes
    file_name: str
    outline: list[tuple[float, float]]


class RasterJob(msgspec.Struct, tag="raster"):
    """An uploaded GeoTIFF, and the outline of the landscape (longitude, latitude)."""

    data: bytes
    file_name: str
    outline: list[tuple[float, float]]


class Done(msgspec.Struct, tag="done"):
    """The perimeter as GeoJSON, and a correction request for each of its outlines."""

    perimeter: msgspec.Raw
    corrections: list[dict[str, Any]]


class RasterDone(msgspec.Struct, tag="raster_done"):
    """The raster as a request, without its user, time and errors."""

    request: dict[str, Any]


class Failed(msgspec.Struct, tag="failed"):
    """The reason why the file is unusable, in one line."""

    error: str


def corrections_of(perimeter: Perimeter, extent: BaseGeometry) -> list[dict[str, Any]]:
    """Return a correction request for each outline: burning now, or unburned for an island.

    Corrections cover only the part in ``extent``, the landscape (lon, lat). Later corrections
    override earlier corrections, so each polygon is followed by its islands, and a polygon in an
    island comes after that island. Raises FireModelError for more than ``MAX_RINGS`` polygons.
    """
    on_it = multipolygon(perimeter.area.intersection(extent.buffer(-EDGE_DEG)))
    polygons = sorted(on_it.geoms, key=_area_within, reverse=True)
    room = MAX_RINGS - len(polygons)
    if room < 0:
        raise FireModelError(f"it has {len(polygons)} outlines; at most {MAX_RINGS} are accepted")
    islands = [ring for polygon in polygons for ring in polygon.interiors]
    islands.sort(key=_area_within, reverse=True)
    if len(islands) > room:
        perimeter.notes.append(
            f"the {len(islands) - room} smallest of {len(islands)} unburned islands count as burned"
        )
    kept = {ring.wkb for ring in islands[:room]}
    found = []
    for polygon in polygons:
        found.append(_correction("burning", polygon.exterior))
        inner = (ring for ring in polygon.interiors if ring.wkb in kept)
        found += [_correction("unburned", ring) for ring in inner]
    return found


def _area_within(shape: Any) -> float:
    """Return the area within the outer ring of a polygon, or within a ring."""
    return float(shapely.Polygon(getattr(shape, "exterior", shape)).area)


def _correction(state: str, ring: Any) -> dict[str, Any]:
    points = [(lat, lon) for lon, lat in ring.coords[:-1]]
    request = {"do": "correct", "state": state, "shape": "polygon"}
    within = [
        (lat, (lon + 180.0) % 360.0 - 180.0 if abs(lon) > 180.0 else lon)
        for lat, lon in thinned(points, MAX_POINTS)
    ]
    return {**request, "points": within}


def answer_to(job: Job | RasterJob) -> Done | RasterDone | Failed:
    """Read a job's file; return the result or the error."""
    try:
        extent = shapely.Polygon(job.outline)
        if isinstance(job, RasterJob):
            west, south, east, north = extent.bounds
            if west < -180.0 or east > 180.0:  # a raster is on one side of the antimeridian
                west, east = -180.0, 180.0
            bounds = (west, south, east, north)
            return RasterDone(read_raster(job.data, printable(job.file_name), bounds))
        found = read_perimeter_in(job.data, job.file_name, extent)
        corrections = corrections_of(found, extent)
    except (FireModelError, BridgeError) as error:
        return Failed(" ".join(str(error).split()))
    return Done(msgspec.Raw(msgspec.json.encode(found.geojson())), corrections)


def main() -> None:
    """Process one job within memory and time limits."""
    limit_process()
    job = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=Job | RasterJob)
    sys.stdout.buffer.write(msgspec.json.encode(answer_to(job)))


if __name__ == "__main__":
    main()
