"""The sensor ``thermal_frames``: georeferences thermal images that arrive in a folder.

A thread (``watched_folder``) reads the images of the folder ``estimate.thermal_frames.folder``.
``observe`` returns the results one by one. A file without its pose waits for the telemetry of the
vehicle. In a simulation there is no thread: ``observe`` looks into the folder, and the time is the
mission time.
"""

import time
from collections import deque
from datetime import UTC, datetime
from pathlib import Path

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.errors import MissionServiceError
from mission_service.events import AnyEvent, Observed, Telemetry
from mission_service.fire.sensor_files import file_part
from mission_service.sensors.frame_cells import Burned, FrameCells, frame_cells, stated_errors
from mission_service.sensors.frame_registration import FrameRegistration
from mission_service.sensors.telemetry_poses import TelemetryPoses
from mission_service.sensors.thermal_image import SUFFIXES, NoPoseError, read_thermal_image
from mission_service.sensors.watched_folder import IncompleteError, WatchedFolder

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
        self._registration = FrameRegistration(landscape, stated_errors(self._settings))
        self._arrived: deque[tuple[str, str, FrameCells, float]] = deque()
        self._poses = TelemetryPoses(self._settings.fixed_pitch_deg, self._settings.time_sd_s)
        self._zero_s: float | None = None  # mission time 0 in UTC, in a simulation

    def use_mission_time(self, zero: datetime) -> None:
        """Take the time from the mission, which begins at ``zero``, instead of the clock."""
        self._zero_s = zero.timestamp()

    def observe(self, fix: Telemetry) -> Observed | None:
        """Return the next image that has arrived, or None; the first call starts the thread."""
        if self._zero_s is None:
            self.start()
        else:
            self.look(datetime.fromtimestamp(self._now_s(fix.at_us), UTC))
        if not self._arrived:
            return None
        name, part, found, taken_s = self._arrived.popleft()
        found_us = self._poses.mission_us_of(taken_s)
        at_us = fix.at_us - max(round((self._now_s(fix.at_us) - taken_s) * 1e6), 0)
        at_us = at_us if found_us is None else min(found_us, fix.at_us)
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
        """Store the telemetry of the vehicles, for images without their pose."""
        self._poses.on_event(event, self._now_s(event.at_us))

    def _now_s(self, at_us: int) -> float:
        """Return the time in UTC at a mission time, which is the present."""
        return time.time() if self._zero_s is None else self._zero_s + at_us / 1e6

    def use_file(self, path: Path, now: datetime) -> None:
        """Read an image, and find its cells. Raises MissionServiceError or FireModelError."""
        try:
            image = read_thermal_image(path, self._poses.pose_of)
        except NoPoseError as error:
            raise IncompleteError(str(error)) from None
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
        cells = frame_cells(image, self._landscape, self._settings, self._registration)
        found = self._burned.added(cells, taken_s)
        if not set("".join(found.window.cells)) <= {"."}:
            part = file_part(self.name_of(path.name))
            self._arrived.append((path.name, part, found, taken_s))
        while len(self._arrived) > MAX_WAITING:
            dropped, *_ = self._arrived.popleft()
            self.refuse(dropped, f"{dropped}: more than {MAX_WAITING} newer images wait")
