"""The sensor ``observation_files``: perimeters, detections and rasters that arrive in a folder.

A thread (``watched_folder``) reads each new file of ``estimate.observation_files.folder`` in a
separate process. ``report`` returns the shapes and groups of pixels of a file one by one, in order
of time, and ``observe`` returns the rasters.
"""

import time
from collections import deque
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.errors import MissionServiceError
from mission_service.events import AnyEvent, FireObserved, Observed, Telemetry
from mission_service.sensors.files.file_contents import FileCells, FileReport, FileSettings
from mission_service.sensors.files.observation_file import PARTS, SUFFIXES, read_observation_file
from mission_service.sensors.sensor_files import file_part
from mission_service.sensors.watched_folder import Change, WatchedFolder

AHEAD_S = 300.0  # tolerated difference between the clocks of the source and the service


class _Arrived(NamedTuple):
    """An observation in a file, with the names of the file and of its event (``sensor_files``)."""

    file: str
    part: str
    seen: FileReport | FileCells


class ObservationFolder(WatchedFolder):
    """A watched folder of observation files."""

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        """Check the folder. Raises ScenarioError if no folder is given, or if it does not exist."""
        section = scenario.estimate.observation_files
        key = "estimate.observation_files.folder"
        super().__init__(key, section.folder, (*SUFFIXES, *PARTS), "a file")
        self._landscape, self._max_age_s = landscape, section.max_age_s
        self._settings = settings_of(scenario)
        self._reports: deque[_Arrived] = deque()
        self._rasters: deque[_Arrived] = deque()

    def observe(self, fix: Telemetry) -> Observed | None:
        """Return the next raster that has arrived, or None; the first call starts the thread."""
        self.start()
        taken = self._next(self._rasters, fix.at_us)
        if taken is None:
            return None
        each, seen_at_us = taken
        if seen_at_us < 0:
            before_s = -seen_at_us / 1e6
            self.refuse(each.file, f"{each.file}: was observed {before_s:.0f} s before time 0")
            return None
        assert isinstance(each.seen, FileCells)
        found = each.seen
        return Observed(
            seen_at_us,
            fix.vehicle,
            *(found.row, found.col, found.cells),
            position_sd_m=found.position_sd_m,
            file=each.part,
        )

    def report(self, at_us: int) -> FireObserved | None:
        """Return the next shape or group of pixels, or None; the first call starts the thread."""
        self.start()
        taken = self._next(self._reports, at_us)
        if taken is None:
            return None
        each, seen_at_us = taken
        assert isinstance(each.seen, FileReport)
        found = each.seen
        return FireObserved(
            at_us,
            "",
            "",
            found.state,
            found.shape,
            found.points,
            seen_at_us,
            found.position_sd_m,
            found.false_alarms,
            found.source,
            islands=found.islands,
            file=each.part,
        )

    def on_event(self, event: AnyEvent) -> None:
        """Ignore the events of the run."""

    def process_file(self, path: Path, now: datetime) -> None:
        """Read a file. Raises MissionServiceError for a file without a usable observation."""
        file = self.event_name_of(path.name)
        contents = read_observation_file(path, self._landscape, self._settings)
        count = len(contents.observations)
        ages_s = [now.timestamp() - each.seen_unix_s for each in contents.observations]
        if min(ages_s) < -AHEAD_S:
            raise MissionServiceError(
                f"{path}: was observed {-min(ages_s):.0f} s in the future; check the clocks, and "
                f"the time zone of the file (estimate.observation_files.time_zone)"
            )
        too_old = [
            f"{path}: was observed {age_s:.0f} s ago; "
            f"estimate.observation_files.max_age_s = {self._max_age_s:g}"
            for age_s in ages_s
            if age_s > self._max_age_s
        ]
        if len(too_old) == count:
            raise MissionServiceError(too_old[-1])
        for number, each in enumerate(contents.observations, start=1):
            part = file_part(file, number, count)
            if ages_s[number - 1] <= self._max_age_s and part not in self.used_parts:
                queue = self._rasters if isinstance(each, FileCells) else self._reports
                queue.append(_Arrived(path.name, part, each))
        if unused := (*contents.notes, *too_old):
            total = count + len(contents.notes)
            text = f"{len(unused)} of {total} observations in a file are not used: {unused[0]}"
            self.note_problem(path.name, text)

    def _files(self) -> dict[str, Change]:
        """Return the last modification of each file; the parts of a Shapefile count as one file."""
        files = super()._files()
        parts = {name: each for name, each in files.items() if name.lower().endswith(PARTS)}
        for name, (changed_ns, size) in parts.items():
            del files[name]
            shp = f"{Path(name).stem}.shp"
            if (whole := files.get(shp)) is not None:
                files[shp] = (max(changed_ns, whole[0]), size + whole[1])
        return files

    def _next(self, queue: deque[_Arrived], at_us: int) -> tuple[_Arrived, int] | None:
        """Return the next observation in a queue and its mission time."""
        if not queue:
            return None
        each = queue.popleft()
        return each, at_us - max(round((time.time() - each.seen.seen_unix_s) * 1e6), 0)


def settings_of(scenario: Scenario) -> FileSettings:
    """Return the settings of a scenario on which the contents of a file depend."""
    section = scenario.estimate.observation_files
    return FileSettings(
        section.time_zone, section.position_sd_m, section.burned_values, section.unburned_values
    )
