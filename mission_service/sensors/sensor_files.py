"""Name the files that sensors have read, so that a restarted run does not use them again. Pure.

Each event that a sensor makes from a file contains the name of the file, the time of the file's
last modification in nanoseconds, the size of the file in bytes, and the number of the event among
the events of the file (for example 2/3). A file that replaces another with the same name is
therefore a new file.
"""

from collections.abc import Iterable

from mission_service.events import AnyEvent, FireObserved, Observed

MAX_NAMED = 20_000  # events; the oldest are removed


def file_part(file: str, number: int = 1, count: int = 1) -> str:
    """Return the name of event ``number`` when a file has ``count`` events."""
    return f"{file} {number}/{count}"


class SensorFiles:
    """The names of the last events that sensors made from files in a run."""

    def __init__(self) -> None:
        self._names: dict[str, None] = {}

    def on_event(self, event: AnyEvent) -> None:
        """Store the name of an event that a sensor made from a file."""
        if isinstance(event, Observed | FireObserved) and event.file:
            self._names[event.file] = None
            if len(self._names) > MAX_NAMED:
                del self._names[next(iter(self._names))]

    def names(self) -> frozenset[str]:
        """Return the names."""
        return frozenset(self._names)


def whole_files(names: Iterable[str]) -> frozenset[str]:
    """Return the files whose last event is in ``names``."""
    parts = (name.rpartition(" ") for name in names)
    return frozenset(
        file for file, _, part in parts if part.partition("/")[0] == part.partition("/")[2]
    )
