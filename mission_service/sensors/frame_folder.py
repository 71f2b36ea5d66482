"""The sensor ``thermal_frames``: georeferences thermal images that arrive in a folder.

A thread (``watched_folder``) reads the images of the folder ``estimate.thermal_frames.folder``.
``observe`` returns the results one by one.
"""

import time
from collections import deque
from datetime import datetime
from pathlib import Path

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.errors import MissionServiceError
from mission_service.events import AnyEvent, Observed, Telemetry
from mission_service.fire.sensor_files import file_part
from mission_service.sensors.frame_cells import Burned, FrameCells, frame_cells
from mission_service.sensors.thermal_image import SUFFIXES, read_thermal_image
from mission_service.sensors.watched_folder import WatchedFolder

AHEAD_S = 5.0  # tolerated difference between the clocks of camera and service
MAX_WAITING = 100  # images; the oldest are dropped
MISSED, FALSE_ALARMS = 0.05, 0.01  # shares of the cells, for the estimate


class FrameFolder(WatchedFolder):
    """A watched folder of thermal images."""

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        """Check the folder. Raises ScenarioError if it is not given or does not exist."""
        self._settings = scenario.estimate.thermal_frames
        key = "estimate.thermal_frames.folder"
        super().__init__(key, self._settings.folder, SUFFIXES, "an image")
        self._landscape = landscape
        self._burned = Burned(landscape.shape)
        self._arrived: deque[tuple[str, str, FrameCells, float]] = deque()

    def observe(self, fix: Telemetry) -> Observed | None:
        """Return the next image that has arrived, or None; the first call starts the thread."""
        self.start()
        if not self._arrived:
            return None
        name, part, found, taken_s = self._arrived.popleft()
        at_us = fix.at_us - max(round((time.time() - taken_s) * 1e6), 0)
        if at_us < 0:
            self.refuse(name, f"{name}: was taken {-at_us / 1e6:.0f} s before mission time 0")
            return None
        return Observed(
            at_us,
            fix.vehicle,
            *found.window,
            position_sd_m=round(found.position_sd_m, 2),
            missed=MISSED,
            false_alarms=FALSE_ALARMS,
            file=part,
        )

    def on_event(self, event: AnyEvent) -> None:
        """Ignore the events of the run."""

    def use_file(self, path: Path, now: datetime) -> None:
        """Read an image, and find its cells. Raises MissionServiceError or FireModelError."""
        image = read_thermal_image(path)
        age_s = (now - image.taken).total_seconds()
        if age_s < -AHEAD_S:
            raise MissionServiceError(
                f"{path}: was taken {-age_s:.0f} s in the future; check the camera's clock"
            )
        if age_s > self._settings.max_age_s:
            raise MissionServiceError(
                f"{path}: was taken {age_s:.0f} s ago; estimate.thermal_frames.max_age_s = "
                f"{self._settings.max_age_s:g}"
            )
        taken_s = image.taken.timestamp()
        cells = frame_cells(image, self._landscape, self._settings)
        found = self._burned.added(cells, taken_s)
        if not set("".join(found.window.cells)) <= {"."}:
            part = file_part(self.name_of(path.name))
            self._arrived.append((path.name, part, found, taken_s))
        while len(self._arrived) > MAX_WAITING:
            dropped, *_ = self._arrived.popleft()
            self.refuse(dropped, f"{dropped}: more than {MAX_WAITING} newer images wait")
