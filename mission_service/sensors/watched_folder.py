"""Watches a folder, for sensors whose input arrives as files.

A thread lists the folder and passes each new file to ``process_file`` when the file no longer
grows. ``problem`` names a file that is not used, and gives the reason. The service shows this text
as an alarm until the file is replaced or removed. While the folder cannot be read, ``problem``
gives the reason.
"""

import os
import time
from abc import abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from firemodel.errors import FireModelError
from mission_service.errors import MissionServiceError, ScenarioError
from mission_service.sensors.one_line import one_line
from mission_service.sensors.sensor_files import whole_files
from mission_service.sensors.threaded_sensor import ThreadedSensor

SCAN_EVERY_S = 0.25
MAX_SHARE = 0.05  # of the thread's time, for listing a folder with many files
MAX_AT_ONCE = 100  # files; if more files are new at once, only the newest are used

RETRIED_FOR_S = 3.0  # for a file whose use requires data that arrive later

Change = tuple[int, int]  # time of the last change in ns, and size in bytes


class IncompleteError(MissionServiceError):
    """A file that requires data that may arrive later; the message states what is missing."""


class WatchedFolder(ThreadedSensor):
    """A folder whose new files become observations."""

    def __init__(self, key: str, folder: str | None, suffixes: Sequence[str], noun: str) -> None:
        """Check the folder.

        Args:
            key: The scenario key that names the folder.
            folder: The value of the key.
            suffixes: The suffixes of the files to use, in lower case.
            noun: The word for a file in ``problem``, with its article, for example "an image".

        Raises:
            ScenarioError: The folder is not given or does not exist.
        """
        super().__init__()
        if folder is None:
            raise ScenarioError(f"{key} is missing; set it to the folder")
        self._folder, self._suffixes, self._noun = Path(folder), tuple(suffixes), noun
        if not self._folder.is_dir():
            raise ScenarioError(f"{self._folder}: is not a folder; create it")
        self._folder_problem = ""
        self._problems: dict[str, str] = {}  # texts about files, by name
        self._growing: dict[str, Change] = {}
        self._read: dict[str, Change] = {}
        self.used_parts: frozenset[str] = frozenset()  # events before a restart (``sensor_files``)
        self._used_files: frozenset[str] = frozenset()
        self._incomplete_since: dict[str, datetime] = {}
        self._listing_s = 0.0  # time that the last listing of the folder took

    @abstractmethod
    def process_file(self, path: Path, now: datetime) -> None:
        """Read a new file, in the thread. An exception gives the reason why the file is not used.

        After an IncompleteError, the file is read again for up to ``RETRIED_FOR_S``.
        """

    def skip(self, names: frozenset[str]) -> None:
        """Set the names of the events that the run made from files before a restart."""
        self.used_parts, self._used_files = names, whole_files(names)

    def event_name_of(self, name: str) -> str:
        """Return the name by which events refer to a file that was read (``sensor_files``)."""
        changed_ns, size = self._read[name]
        return f"{name} {changed_ns} {size}"

    @property
    def problem(self) -> str:
        """Why the folder, a file in it, or part of a file is not used; otherwise empty."""
        texts = list(self._problems.values())  # a copy, because the thread changes the dictionary
        if self._folder_problem or not texts:
            return self._folder_problem
        others = f" (and {len(texts) - 1} others)" if texts[1:] else ""
        return f"{texts[-1]}{others}"

    def refuse(self, name: str, reason: str) -> None:
        """Store the reason why a file is not used, as one line that each interface can show."""
        self.note_problem(name, f"{self._noun} is not used: {reason}")

    def note_problem(self, name: str, text: str) -> None:
        """Store a text about a file, as one line, until the file is replaced or removed."""
        self._problems[name] = one_line(text)

    def scan(self, now: datetime) -> None:
        """Use the files that are new and have not grown since the last scan.

        If there are more than ``MAX_AT_ONCE`` such files, the oldest are refused without being
        read, so that a backlog does not delay new observations.
        """
        try:
            files = self._files()
        except OSError as error:
            self._folder_problem = (
                f"{self._folder}: cannot be read: {error.strerror}; restore the folder"
            )
            return
        self._folder_problem = ""
        for gone in self._read.keys() - files.keys():
            del self._read[gone]
            self._problems.pop(gone, None)
        changed = {name: each for name, each in files.items() if self._read.get(name) != each}
        ready = [name for name, each in changed.items() if self._growing.get(name) == each]
        self._growing = {name: changed[name] for name in changed.keys() - set(ready)}
        ready.sort(key=lambda name: (changed[name], name))
        self._read |= {name: changed[name] for name in ready}
        ready = [name for name in ready if self.event_name_of(name) not in self._used_files]
        for name in ready[:-MAX_AT_ONCE]:
            self.refuse(name, f"{name}: {MAX_AT_ONCE} or more newer files arrived with it")
        for name in ready[-MAX_AT_ONCE:]:
            self._use(name, now)

    def _use(self, name: str, now: datetime) -> None:
        self._problems.pop(name, None)
        try:
            self.process_file(self._folder / name, now)
        except IncompleteError as error:
            since = self._incomplete_since.setdefault(name, now)
            if (now - since).total_seconds() < RETRIED_FOR_S:
                self._growing[name] = self._read.pop(name)
                return
            self.refuse(name, str(error))
        except (MissionServiceError, FireModelError) as error:
            self.refuse(name, str(error))
        except Exception as error:  # one file must not end the thread
            self.refuse(name, f"{name}: {type(error).__name__}: {error}")
        self._incomplete_since.pop(name, None)

    def _run(self) -> None:
        try:
            while not self._closed.is_set():
                self.scan(datetime.now(UTC))
                self._closed.wait(max(SCAN_EVERY_S, self._listing_s / MAX_SHARE))
        except Exception as error:  # raised by the next ``start``
            self._error = error

    def _files(self) -> dict[str, Change]:
        """Return the last change of each file in the folder with one of the suffixes, by name."""
        found = {}
        begun_s = time.monotonic()
        with os.scandir(self._folder) as entries:
            for entry in entries:
                with suppress(OSError):  # the entry was removed, or is a link to itself
                    named = entry.name.lower().endswith(self._suffixes)
                    if named and not entry.name.startswith(".") and entry.is_file():
                        state = entry.stat()
                        found[entry.name] = (state.st_mtime_ns, state.st_size)
        self._listing_s = time.monotonic() - begun_s
        return found
