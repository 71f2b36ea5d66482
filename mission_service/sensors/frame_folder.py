"""The sensor ``thermal_frames``: reads thermal images that arrive in a folder.

A thread looks into the folder (``estimate.thermal_frames.folder``), reads each new file when it no
longer grows, and georeferences it. ``observe`` returns the results one by one. A file that is not
used is named in ``problem`` with the reason, which the service shows as an alarm.
"""

import os
import threading
import time
from collections import deque
from datetime import UTC, datetime
from pathlib import Path

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.errors import MissionServiceError, ScenarioError
from mission_service.events import AnyEvent, Observed, Telemetry
from mission_service.sensors.frame_cells import Burned, FrameCells, frame_cells
from mission_service.sensors.thermal_image import SUFFIXES, read_thermal_image

LOOK_EVERY_S = 0.25
AHEAD_S = 5.0  # tolerated difference between the clocks of camera and service
MAX_WAITING = 100  # images; the oldest are dropped
MISSED, FALSE_ALARMS = 0.05, 0.01  # shares of the cells, for the estimate

Change = tuple[int, int]  # time of the last change in ns, and size in bytes


class FrameFolder:
    """A watched folder of thermal images."""

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        """Check the folder. Raises ScenarioError if it is not given or does not exist."""
        self._settings = scenario.estimate.thermal_frames
        if self._settings.folder is None:
            raise ScenarioError("estimate.thermal_frames.folder is missing; give the folder")
        self._folder = Path(self._settings.folder)
        if not self._folder.is_dir():
            raise ScenarioError(f"{self._folder}: is not a folder; create it")
        self.problem = ""  # why the last unused file is not used
        self._landscape = landscape
        self._burned = Burned(landscape.shape)
        self._growing: dict[str, Change] = {}
        self._read: dict[str, Change] = {}
        self._arrived: deque[tuple[FrameCells, float]] = deque(maxlen=MAX_WAITING)
        self._error: Exception | None = None
        self._thread: threading.Thread | None = None

    def observe(self, fix: Telemetry) -> Observed | None:
        """Return the next image that has arrived, or None; the first call starts the thread."""
        if self._error is not None:
            raise self._error
        if self._thread is None:
            self._thread = threading.Thread(target=self._watch, name="frames", daemon=True)
            self._thread.start()
        if not self._arrived:
            return None
        found, taken_s = self._arrived.popleft()
        age_us = round((time.time() - taken_s) * 1e6)
        return Observed(
            max(fix.at_us - max(age_us, 0), 0),
            fix.vehicle,
            *found.window,
            position_sd_m=round(found.position_sd_m, 2),
            missed=MISSED,
            false_alarms=FALSE_ALARMS,
        )

    def on_event(self, event: AnyEvent) -> None:
        """Ignore the events of the run."""

    def _watch(self) -> None:
        try:
            while True:
                self.look(datetime.now(UTC))
                time.sleep(LOOK_EVERY_S)
        except Exception as error:  # raised by the next ``observe``
            self._error = error

    def look(self, now: datetime) -> None:
        """Read the files that are new and have not grown since the last look."""
        growing = {}
        for path, change in self._files():
            if self._read.get(path.name) == change:
                continue
            if self._growing.get(path.name) != change:
                growing[path.name] = change
                continue
            self._read[path.name] = change
            try:
                self._use(path, now)
            except (MissionServiceError, FireModelError) as error:
                self.problem = f"an image is not used: {error}"
        self._growing = growing

    def _files(self) -> list[tuple[Path, Change]]:
        """Return the images in the folder, the oldest first, and forget those that are gone."""
        found = []
        with os.scandir(self._folder) as entries:
            for entry in entries:
                if entry.name.lower().endswith(SUFFIXES) and entry.is_file():
                    state = entry.stat()
                    found.append((Path(entry.path), (state.st_mtime_ns, state.st_size)))
        names = {path.name for path, _ in found}
        self._read = {name: change for name, change in self._read.items() if name in names}
        return sorted(found, key=lambda each: (each[1][0], each[0].name))

    def _use(self, path: Path, now: datetime) -> None:
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
        found = self._burned.added(frame_cells(image, self._landscape, self._settings))
        self._arrived.append((found, image.taken.timestamp()))
