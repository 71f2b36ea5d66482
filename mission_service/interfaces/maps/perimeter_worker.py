"""A separate process that reads one uploaded perimeter: a file can crash only this process.

GEOS cannot be interrupted, holds the GIL for as long as it runs, and has crashed on invalid input,
so the process that flies never passes uploaded geometry to it. A ``Job`` arrives on stdin, ``Done``
or ``Failed`` is written to stdout.
"""

import os
import resource
import sys
from typing import Any

import msgspec
import shapely

from autopilot_bridge.errors import BridgeError
from firemodel.errors import FireModelError
from mission_service.interfaces.maps.perimeter_import import Perimeter, read_perimeter_in
from mission_service.interfaces.maps.thinning import thinned

MAX_RINGS = 50
MAX_POINTS = 900  # of a correction; less than requests may have
MAX_MEMORY_BYTES = 2 * 1024**3
MAX_CPU_S = 25
NICENESS = 5  # below the process that flies


class Job(msgspec.Struct):
    """A file, and the outline of the landscape (longitude, latitude)."""

    data: bytes
    file_name: str
    outline: list[tuple[float, float]]


class Done(msgspec.Struct, tag="done"):
    """The perimeter as GeoJSON, and a request for each of its outlines."""

    perimeter: msgspec.Raw
    wanted: list[dict[str, Any]]


class Failed(msgspec.Struct, tag="failed"):
    """Why there is none, in one line."""

    error: str


def corrections_of(perimeter: Perimeter) -> list[dict[str, Any]]:
    """Return a request for each outline, burning now. Raises FireModelError for too many outlines."""
    rings = perimeter.rings()
    if len(rings) > MAX_RINGS:
        raise FireModelError(f"it has {len(rings)} outlines; at most {MAX_RINGS} are accepted")
    asked = {"do": "correct", "state": "burning", "shape": "polygon"}
    return [{**asked, "points": thinned(ring, MAX_POINTS)} for ring in rings]


def answer_to(job: Job) -> Done | Failed:
    """Read the file; never raises for its content."""
    try:
        found = read_perimeter_in(job.data, job.file_name, shapely.Polygon(job.outline))
        wanted = corrections_of(found)
    except (FireModelError, BridgeError) as error:
        return Failed(" ".join(str(error).split()))
    return Done(msgspec.Raw(msgspec.json.encode(found.geojson())), wanted)


def main() -> None:
    """Return one job, within limits of memory and time."""
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (MAX_CPU_S, MAX_CPU_S))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.nice(NICENESS)
    job = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=Job)
    sys.stdout.buffer.write(msgspec.json.encode(answer_to(job)))


if __name__ == "__main__":
    main()
