"""Reads one uploaded perimeter in a separate process, because a file may crash the process.

GEOS cannot be interrupted, holds the GIL while it runs, and has crashed on invalid input, so the
service's process never passes uploaded geometry to it. The worker reads a ``Job`` from stdin and
writes ``Done`` or ``Failed`` to stdout.
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
MAX_POINTS = 900  # in a correction; below the limit of requests
MAX_MEMORY_BYTES = 2 * 1024**3
MAX_CPU_S = 25
NICENESS = 5  # lower priority than the service


class Job(msgspec.Struct):
    """An uploaded file, and the outline of the landscape (longitude, latitude)."""

    data: bytes
    file_name: str
    outline: list[tuple[float, float]]


class Done(msgspec.Struct, tag="done"):
    """The perimeter as GeoJSON, and a correction request for each of its outlines."""

    perimeter: msgspec.Raw
    corrections: list[dict[str, Any]]


class Failed(msgspec.Struct, tag="failed"):
    """The reason why the file is unusable, in one line."""

    error: str


def corrections_of(perimeter: Perimeter) -> list[dict[str, Any]]:
    """Return a correction request for each outline, as a line that is burning now.

    Raises FireModelError for more than ``MAX_RINGS`` outlines.
    """
    rings = perimeter.rings()
    if len(rings) > MAX_RINGS:
        raise FireModelError(f"it has {len(rings)} outlines; at most {MAX_RINGS} are accepted")
    request = {"do": "correct", "state": "burning", "shape": "polygon"}
    return [{**request, "points": thinned(ring, MAX_POINTS)} for ring in rings]


def answer_to(job: Job) -> Done | Failed:
    """Read the file of a job; return the result or the error."""
    try:
        found = read_perimeter_in(job.data, job.file_name, shapely.Polygon(job.outline))
        corrections = corrections_of(found)
    except (FireModelError, BridgeError) as error:
        return Failed(" ".join(str(error).split()))
    return Done(msgspec.Raw(msgspec.json.encode(found.geojson())), corrections)


def main() -> None:
    """Process one job, within limits of memory and time."""
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (MAX_CPU_S, MAX_CPU_S))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.nice(NICENESS)
    job = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=Job)
    sys.stdout.buffer.write(msgspec.json.encode(answer_to(job)))


if __name__ == "__main__":
    main()
