"""Raises and clears the alarm about event-loop delays. Pure."""

from mission_service.commands import Severity
from mission_service.runtime.state_view import StateView

LATE_US, LATE_SEVERE_US = 500_000, 3_000_000


class HealthMonitor:
    """A monitor that compares the intervals between its calls with the intended interval."""

    def __init__(self, state_view: StateView, every_us: int) -> None:
        """Raise alarms in ``state_view``; ``check_delay`` is called every ``every_us``."""
        self._state_view = state_view
        self._every_us = every_us
        self._checked_us: int | None = None

    def check_delay(self, now_us: int) -> None:
        """Check the delay of this call; ``now_us`` is the time on the machine's clock."""
        if self._checked_us is not None:
            late_us = now_us - self._checked_us - self._every_us
            if late_us >= LATE_US:
                severity: Severity = "severe" if late_us >= LATE_SEVERE_US else "warning"
                text = f"the event loop was blocked for {late_us / 1e6:.1f} s"
                self._state_view.alarm("late", text, severity)
            else:
                self._state_view.clear_alarm("late")
        self._checked_us = now_us
