"""The sensor ``thermal_frames``: reads thermal images that arrive in a folder.

A thread looks into the folder (``estimate.thermal_frames.folder``), reads each new file when it no
longer grows, and georeferences it. ``observe`` returns the results one by one. A file that is not
used is named in ``problem`` with the reason, which the service shows as an alarm until the file is
replaced or removed. While the folder cannot be read, ``problem`` has the reason.
"""

import os
import threading
import time
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.errors import MissionServiceError, ScenarioError
from mission_service.events import AnyEvent, Observed, Telemetry
from mission_service.sensors.arrived_images import ArrivedImages
from mission_service.sensors.thermal_image import SUFFIXES, read_thermal_image

LOOK_EVERY_S = 0.25

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
        self._folder_problem = ""
        self._problems: dict[str, str] = {}  # why files are not used, by name
        self._images = ArrivedImages(landscape, self._settings, self._refuse)
        self._growing: dict[str, Change] = {}
        self._read: dict[str, Change] = {}
        self._error: Exception | None = None
        self._thread: threading.Thread | None = None

    def observe(self, fix: Telemetry) -> Observed | None:
        """Return the next image that has arrived, or None; the first call starts the thread."""
        if self._error is not None:
            raise self._error
        if self._thread is None:
            self._thread = threading.Thread(target=self._watch, name="frames", daemon=True)
            self._thread.start()
        return self._images.next_observed(fix, time.time())

    @property
    def problem(self) -> str:
        """Why the folder cannot be read, or why files in it are not used; or empty."""
        texts = list(self._problems.values())  # a copy; the thread changes it
        if self._folder_problem or not texts:
            return self._folder_problem
        others = f" (and {len(texts) - 1} others)" if texts[1:] else ""
        return f"an image is not used: {texts[-1]}{others}"

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
        try:
            files = self._files()
        except OSError as error:
            self._folder_problem = f"{self._folder}: cannot be read: {error.strerror}; restore it"
            return
        self._folder_problem = ""
        for gone in self._read.keys() - files.keys():
            del self._read[gone]
            self._problems.pop(gone, None)
        changed = {name: each for name, each in files.items() if self._read.get(name) != each}
        ready = [name for name, each in changed.items() if self._growing.get(name) == each]
        self._growing = {name: each for name, each in changed.items() if name not in ready}
        for name in sorted(ready, key=lambda name: (changed[name], name)):
            self._read[name] = changed[name]
            self._problems.pop(name, None)
            try:
                self._use(self._folder / name, now)
            except (MissionServiceError, FireModelError) as error:
                self._refuse(name, str(error))
            except Exception as error:  # one file must not end the watch
                self._refuse(name, f"{name}: {type(error).__name__}: {error}")

    def _files(self) -> dict[str, Change]:
        """Return the last changes of the images in the folder, by name."""
        found = {}
        with os.scandir(self._folder) as entries:
            for entry in entries:
                with suppress(OSError):  # it has been removed, or is a link to itself
                    if entry.name.lower().endswith(SUFFIXES) and entry.is_file():
                        state = entry.stat()
                        found[entry.name] = (state.st_mtime_ns, state.st_size)
        return found

    def _refuse(self, name: str, reason: str) -> None:
        """Note why a file is not used, in one line of text that each interface can show."""
        text = reason.encode(errors="backslashreplace").decode()
        self._problems[name] = " ".join(text.split())

    def _use(self, path: Path, now: datetime) -> None:
        self._images.add(read_thermal_image(path), now)
