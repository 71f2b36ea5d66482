"""The sensor ``thermal_video``: thermal video with MISB ST 0601 metadata, by UDP or from a file.

A thread reads the stream (``video_sources``), takes one image per second (``video_stream``) and
georeferences each image. ``observe`` returns the observations one by one. Every ``WINDOW_S``, the
thread checks the received data and sets ``problem`` to the reason why data are not used.
"""

import time
from datetime import UTC, datetime, timedelta
from importlib.util import find_spec
from pathlib import Path

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.link_address import LinkAddress, parse_link
from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import ThermalVideoSection
from mission_service.config.scenario import Scenario
from mission_service.errors import MissionServiceError, ScenarioError
from mission_service.events import AnyEvent, Observed, Telemetry
from mission_service.sensors.thermal.arrived_images import ArrivedImages
from mission_service.sensors.threaded_sensor import ThreadedSensor
from mission_service.sensors.video.video_problem import video_problem
from mission_service.sensors.video.video_sources import DatagramSource, FileSource
from mission_service.sensors.video.video_stream import StreamCounts, VideoStream

WINDOW_S = 10.0
LIBRARIES = ("av", "tstrans")


class ThermalVideo(ThreadedSensor):
    """A thermal video that arrives while the service runs."""

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        """Check the settings. Raises ScenarioError for invalid settings and a missing library."""
        super().__init__()
        self._settings = scenario.estimate.thermal_video
        self._name = self._settings.source or ""
        self._source = source_of(self._settings)
        self._images = ArrivedImages(landscape, self._settings, self._drop)
        self.images = self._images.images
        self._stream = VideoStream("video", self._settings)
        self.problem = ""

    def observe(self, fix: Telemetry) -> Observed | None:
        """Return the next image that has arrived, or None; the first call starts the thread."""
        self.start()
        return self._images.next_observed(fix, time.time())

    def on_event(self, event: AnyEvent) -> None:
        """Ignore the events of the run."""

    def restore_burned(self, since_s: Floats, at_us: int) -> None:
        """Set which cells were shown as burned before a restart at ``at_us``."""
        self._images.restore_burned(since_s + (time.time() - at_us / 1e6))

    def _run(self) -> None:
        try:
            begun_s = time.monotonic()
            while not self._closed.is_set():
                self.use(self._source.next_bytes(), datetime.now(UTC))
                if time.monotonic() - begun_s >= WINDOW_S:
                    begun_s = time.monotonic()
                    self.end_window()
        except BaseException as error:  # tstrans raises BaseException for an internal fault
            self._error = RuntimeError(f"{type(error).__name__}: {error}")
        finally:
            self._source.close()

    def use(self, data: bytes, now: datetime) -> None:
        """Process bytes of the stream that arrived at ``now``; called in the thread."""
        oldest = now - timedelta(seconds=self._settings.max_age_s)
        for image in self._stream.feed(data, oldest) if data else ():
            try:
                self._images.add_image(image, now)
            except (MissionServiceError, FireModelError) as error:
                self._drop(image.name, str(error))

    def end_window(self) -> None:
        """Set ``problem`` from the data received since the last call; called in the thread.

        If no undamaged metadata have arrived, the next sender is used, as a new stream.
        """
        counts = self._stream.counts
        self.problem = video_problem(counts, self._name, self._source.notice, WINDOW_S)
        if counts.metadata == counts.damaged_metadata:
            self._source.release()
            self._stream = VideoStream("video", self._settings)
        self._stream.counts = StreamCounts(videos=self._stream.counts.videos)
        self._source.notice = ""

    def _drop(self, name: str, reason: str) -> None:
        self._stream.refuse(reason)


def source_of(settings: ThermalVideoSection) -> DatagramSource | FileSource:
    """Return the source of a video. Raises ScenarioError for unusable settings."""
    check_libraries()
    if settings.source is None:
        raise ScenarioError(
            f"{settings.TABLE}.source is missing; set it to udpin:HOST:PORT or a file"
        )
    if settings.hot_level is None and settings.grey_level_range_c is None:
        raise ScenarioError(f"{settings.TABLE}: set grey_level_range_c or hot_level")
    if "://" in settings.source:
        raise ScenarioError(
            f"{settings.TABLE}.source: {settings.source} is a URL; use udpin:HOST:PORT or a file "
            "(FFmpeg converts other streams: docs/video.md)"
        )
    if not settings.source.startswith("udpin:"):
        return FileSource(Path(settings.source))
    try:
        address = parse_link(settings.source)
    except BridgeError as error:
        raise ScenarioError(f"{settings.TABLE}.source: {error}") from None
    assert isinstance(address, LinkAddress)
    return DatagramSource(address)


def check_libraries() -> None:
    """Raise ScenarioError if a library for video is not installed."""
    if missing := [name for name in LIBRARIES if find_spec(name) is None]:
        raise ScenarioError(
            f"video requires {' and '.join(missing)}; run: pip install 'mission-service[video]'"
        )
