"""Take images from a whole video file, for ``mission-service observe``."""

from collections.abc import Iterator
from pathlib import Path

from mission_service.config.fire_sections import ThermalVideoSection
from mission_service.errors import MissionServiceError
from mission_service.sensors.thermal.thermal_image import ThermalImage
from mission_service.sensors.video.video_problem import video_problem
from mission_service.sensors.video.video_stream import PART_BYTES, VideoStream

SUFFIXES = (".ts", ".mpegts")


def images_in(
    path: Path, settings: ThermalVideoSection, every_s: float
) -> Iterator[ThermalImage | MissionServiceError]:
    """Yield an image every ``every_s`` seconds, and at the end an error if data were not used."""
    stream = VideoStream(path.name, settings, every_s)
    try:
        with path.open("rb") as file:
            while data := file.read(PART_BYTES):
                yield from stream.feed(data)
    except OSError as error:
        yield MissionServiceError(f"{path}: {error.strerror}")
        return
    yield from stream.end()
    if not stream.counts.size:
        yield MissionServiceError(f"{path}: is empty")
    elif problem := video_problem(stream.counts, str(path), "", 0.0):
        yield MissionServiceError(problem)
