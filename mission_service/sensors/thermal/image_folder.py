"""The sensor ``thermal_frames``: georeferences thermal images that arrive in a folder.

A thread (``watched_folder``) reads the images of the folder ``estimate.thermal_frames.folder``.
``observe`` returns the observations one by one. A file without a pose is used once the vehicle's
telemetry has arrived. In a simulation there is no thread: ``observe`` lists the folder, and the
time is the mission time.
"""

import time
from datetime import UTC, datetime
from pathlib import Path

from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.events import AnyEvent, Observed, Telemetry
from mission_service.sensors.sensor_files import file_part
from mission_service.sensors.thermal.arrived_images import ArrivedImages
from mission_service.sensors.thermal.telemetry_poses import TelemetryPoses
from mission_service.sensors.thermal.thermal_image import SUFFIXES, NoPoseError, read_thermal_image
from mission_service.sensors.watched_folder import IncompleteError, WatchedFolder


class ImageFolder(WatchedFolder):
    """A watched folder of thermal images."""

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        """Check the folder. Raises ScenarioError if no folder is given, or if it does not exist."""
        settings = scenario.estimate.thermal_frames
        super().__init__(f"{settings.TABLE}.folder", settings.folder, SUFFIXES, "an image")
        self._images = ArrivedImages(landscape, settings, self.refuse)
        self._poses = TelemetryPoses(settings.fixed_pitch_deg, settings.file_time_sd_s)
        self.images = self._images.images
        self._zero_s: float | None = None  # mission time 0 in UTC, in a simulation

    def use_mission_time(self, zero: datetime) -> None:
        """Use the mission time, which begins at ``zero``, instead of the clock."""
        self._zero_s = zero.timestamp()

    def observe(self, fix: Telemetry) -> Observed | None:
        """Return the next image that has arrived, or None; the first call starts the thread."""
        if self._zero_s is None:
            self.start()
        else:
            self.scan(datetime.fromtimestamp(self._now_s(fix.at_us), UTC))
        now_s = self._now_s(fix.at_us)
        return self._images.next_observed(fix, now_s, self._poses.mission_us_of)

    def on_event(self, event: AnyEvent) -> None:
        """Store the telemetry of the vehicles, for images without a pose."""
        self._poses.on_event(event, self._now_s(event.at_us))

    def _now_s(self, at_us: int) -> float:
        """Return the current time in UTC; ``at_us`` is the current mission time."""
        return time.time() if self._zero_s is None else self._zero_s + at_us / 1e6

    def restore_burned(self, since_s: Floats, at_us: int) -> None:
        """Set which cells were shown as burned before a restart at ``at_us``."""
        self._images.restore_burned(since_s + (self._now_s(at_us) - at_us / 1e6))

    def process_file(self, path: Path, now: datetime) -> None:
        """Read an image, and find its cells. Raises MissionServiceError or FireModelError."""
        try:
            image = read_thermal_image(path, self._poses.pose_of)
        except NoPoseError as error:
            raise IncompleteError(str(error)) from None
        self._images.add_image(image, now, file_part(self.event_name_of(path.name)))
