"""Collects the announcements of a run, as a progress display does."""

from typing import Any

from mission_service.runtime.state_view import StateView


class Announced:
    """A progress function; ``texts`` contains each announcement, ``lines`` also the vehicle."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.lines: list[str] = []
        self._last_id = 0

    def __call__(self, state_view: StateView, world: Any) -> None:
        """Read the new announcements."""
        for line in state_view.announcements_after(self._last_id):
            self._last_id = line.id
            self.texts.append(line.text)
            self.lines.append(f"{line.vehicle}: {line.text}")
