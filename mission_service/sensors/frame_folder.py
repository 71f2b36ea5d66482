"""The sensor ``thermal_frames``: georeferences thermal images that arrive in a folder.

A thread (``watched_folder``) reads the images of the folder ``estimate.thermal_frames.folder``.
``observe`` returns the results one by one.
"""

import time
from datetime import datetime
from pathlib import Path

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.events import AnyEvent, Observed, Telemetry
from mission_service.sensors.arrived_images import ArrivedImages
from mission_service.sensors.thermal_image import SUFFIXES, read_thermal_image
from mission_service.sensors.watched_folder import WatchedFolder


class FrameFolder(WatchedFolder):
    """A watched folder of thermal images."""

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        """Check the folder. Raises ScenarioError if it is not given or does not exist."""
        settings = scenario.estimate.thermal_frames
        super().__init__("estimate.thermal_frames.folder", settings.folder, SUFFIXES, "an image")
        self._images = ArrivedImages(landscape, settings, self.refuse)

    def observe(self, fix: Telemetry) -> Observed | None:
        """Return the next image that has arrived, or None; the first call starts the thread."""
        self.start()
        return self._images.next_observed(fix, time.time())

    def on_event(self, event: AnyEvent) -> None:
        """Ignore the events of the run."""

    def use_file(self, path: Path, now: datetime) -> None:
        """Read an image, and find its cells. Raises MissionServiceError or FireModelError."""
        self._images.add(read_thermal_image(path), now)
