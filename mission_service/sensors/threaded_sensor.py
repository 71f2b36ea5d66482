"""The thread of a sensor that waits for files or for a stream."""

import threading
from abc import ABC, abstractmethod


class ThreadedSensor(ABC):
    """A sensor with a thread, which ``start`` starts and ``close`` ends."""

    def __init__(self) -> None:
        self._error: Exception | None = None  # the exception that ended the thread
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None

    @abstractmethod
    def _run(self) -> None:
        """Process input in the thread until ``_closed`` is set; set ``_error`` after an error."""

    def start(self) -> None:
        """Start the thread if it does not run. Raises the exception that ended the thread."""
        if self._error is not None:
            raise self._error
        if self._thread is None:
            name = type(self).__name__
            self._thread = threading.Thread(target=self._run, name=name, daemon=True)
            self._thread.start()

    def close(self) -> None:
        """End the thread after the input that is being processed."""
        self._closed.set()
