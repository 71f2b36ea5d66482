"""Reads an observation file: shapes, satellite pixels or a raster. The format is detected.

``read_observation_file`` reads the file in a separate process (``worker_process``), which runs
``main`` of this module.
"""

import sys
import zipfile
from pathlib import Path

import msgspec

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.errors import MissionServiceError
from mission_service.sensors.files.file_contents import (
    FileContents,
    FileSettings,
    Grid,
    degrees_around,
    grid_of,
)
from mission_service.sensors.one_line import one_line
from mission_service.sensors.worker_process import limit_process, output_of

SHAPES = (".geojson", ".json", ".kml", ".kmz", ".gpkg", ".shp", ".zip")
RASTERS, TABLES, IMAGES = (".tif", ".tiff"), (".csv", ".txt"), (".jpg", ".jpeg", ".png")
SUFFIXES = (*SHAPES, *RASTERS, *TABLES, *IMAGES)
PARTS = (".shx", ".dbf", ".prj", ".cpg")  # further files of a Shapefile
MAX_FILE_BYTES = 64_000_000
MAX_UNPACKED_BYTES = 64_000_000  # limit for an archive
MODULE = "mission_service.sensors.files.observation_file"


class FileJob(msgspec.Struct):
    """A file to read, and the grid of the landscape."""

    path: str
    grid: Grid
    settings: FileSettings


class Unusable(msgspec.Struct, tag="unusable"):
    """The reason why a file is not usable, in one line that names the file."""

    reason: str


class Usable(msgspec.Struct, tag="usable"):
    """The contents of a file."""

    contents: FileContents


def read_observation_file(path: Path, landscape: Landscape, settings: FileSettings) -> FileContents:
    """Return the observations in a file.

    Raises MissionServiceError, whose text names the file and the reason, if the file is not usable,
    for example because it is too large, damaged, off the landscape or without a time.
    """
    check_file(path)
    job = msgspec.msgpack.encode(FileJob(str(path), grid_of(landscape), settings))
    try:
        found = msgspec.json.decode(output_of(MODULE, job), type=Usable | Unusable)
    except (OSError, msgspec.DecodeError, msgspec.ValidationError) as error:
        raise MissionServiceError(f"{path}: {error}; simplify the file") from None
    if isinstance(found, Unusable):
        raise MissionServiceError(found.reason)
    return found.contents


def check_file(path: Path) -> None:
    """Raise MissionServiceError for a file that is too large or cannot contain observations."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise MissionServiceError(f"{path}: has none of the suffixes {', '.join(SUFFIXES)}")
    try:
        if path.exists() and not path.is_file():
            raise MissionServiceError(f"{path}: is not a file")
        sizes = [path.stat().st_size]
        if suffix == ".shp":
            parts = (path.with_suffix(part) for part in PARTS)
            sizes += [part.stat().st_size for part in parts if part.exists()]
    except OSError as error:
        raise MissionServiceError(f"{path}: {error.strerror}") from None
    if sum(sizes) > MAX_FILE_BYTES:
        raise MissionServiceError(
            f"{path}: {sum(sizes) / 1e6:.0f} MB; the maximum is {MAX_FILE_BYTES / 1e6:.0f} MB"
        )
    if suffix in IMAGES:
        raise MissionServiceError(
            f"{path}: a picture does not state where fire is; copy images of thermal cameras to "
            "the folder of the sensor thermal_frames, or draw the fire on the map"
        )


def contents_of(path: Path, landscape: Landscape, settings: FileSettings) -> FileContents:
    """Read a file in this process, and return the observations in it.

    Raises MissionServiceError or FireModelError, whose text names the file and the reason.
    """
    from mission_service.sensors.files.raster_file import raster_contents
    from mission_service.sensors.files.satellite_pixels import read_satellite_pixels
    from mission_service.sensors.files.vector_reports import (
        groups_on,
        pixel_contents,
        vector_contents,
    )

    suffix = path.suffix.lower()
    if suffix in TABLES:
        pixels, _ = read_satellite_pixels(path, degrees_around(landscape))
        return pixel_contents(path, groups_on(pixels, landscape))
    if suffix in RASTERS:
        return raster_contents(path, landscape, settings)
    _refuse_large_archive(path)
    return vector_contents(path, landscape, settings)


def _refuse_large_archive(path: Path) -> None:
    if not zipfile.is_zipfile(path):
        return
    try:
        with zipfile.ZipFile(path) as archive:
            unpacked = sum(each.file_size for each in archive.infolist())
    except (zipfile.BadZipFile, NotImplementedError, OSError, ValueError) as error:
        raise FireModelError(f"{path}: is not a complete ZIP archive ({error})") from None
    if unpacked > MAX_UNPACKED_BYTES:
        raise FireModelError(
            f"{path}: contains {unpacked / 1e6:.0f} MB; the maximum is "
            f"{MAX_UNPACKED_BYTES / 1e6:.0f} MB"
        )


def answer_to(job: FileJob) -> Usable | Unusable:
    """Return the contents of a job's file, or the reason why the file is not usable."""
    path = Path(job.path)
    try:
        return Usable(contents_of(path, job.grid.level_ground(), job.settings))
    except (MissionServiceError, FireModelError) as error:
        reason = str(error)
    except MemoryError:
        reason = f"{path}: needs too much memory"
    except Exception as error:  # a damaged file may cause any error in the libraries that read it
        reason = f"{path}: cannot be read: {type(error).__name__}: {error}"
    return Unusable(one_line(reason))


def main() -> None:
    """Process the job on standard input, within memory and time limits."""
    limit_process()
    job = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=FileJob)
    sys.stdout.buffer.write(msgspec.json.encode(answer_to(job)))


if __name__ == "__main__":
    main()
