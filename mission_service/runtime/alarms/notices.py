"""A run's alarms and announcements, and the versions of the displayed states. Pure."""

from collections import deque
from collections.abc import Mapping

from mission_service.commands import Severity
from mission_service.events import NoteAdded
from mission_service.runtime.published_states import Alarm, Announcement, Record, RecordKind
from mission_service.runtime.run_statistics import RunStatistics

MAX_ANNOUNCEMENTS = 500
MAX_CLEARED = 50
MAX_RECORDS = 500


class Notices:
    """The alarms and announcements of a run; ``version`` increases with each change."""

    def __init__(self, at_us: int, statistics: RunStatistics) -> None:
        self.at_us = at_us
        self.version = 1
        self.changed: dict[str, int] = {}
        self.statistics = statistics
        self.alarms: dict[str, Alarm] = {}
        self.cleared: deque[Alarm] = deque(maxlen=MAX_CLEARED)
        self.announcements: deque[Announcement] = deque(maxlen=MAX_ANNOUNCEMENTS)
        self.records: deque[Record] = deque(maxlen=MAX_RECORDS)
        self.announcement_id = 0
        self.announcement_count = 0
        self.last_id_before_restart = 0  # id of the last announcement before the last restart

    def alarm(self, key: str, text: str, severity: Severity = "warning", vehicle: str = "") -> None:
        """Raise an alarm, or update its text."""
        before = self.alarms.get(key)
        if before is not None and (before.text, before.severity) == (text, severity):
            return
        since_us = self.at_us if before is None else before.at_us
        alarm = Alarm(key, since_us, vehicle, severity, text)
        if before is not None and (before.severity == "severe" or severity == "warning"):
            alarm.acknowledged_by = before.acknowledged_by
            alarm.acknowledged_at_us = before.acknowledged_at_us
        self.alarms[key] = alarm
        if before is None:
            self.statistics.alarms[key.partition("/")[0]] += 1
            self._record("alarm", vehicle, f"alarm: {text}", "warning")
        self._touch("alarms")

    def show_alarms(self, prefix: str, texts: Mapping[str, str], severity: Severity) -> None:
        """Raise an alarm ``prefix/NAME`` for each text; clear the other alarms with this prefix."""
        for key in [key for key in self.alarms if key.startswith(f"{prefix}/")]:
            if key.partition("/")[2] not in texts:
                self.clear_alarm(key)
        for name, text in texts.items():
            self.alarm(f"{prefix}/{name}", text, severity)

    def acknowledge_alarm(self, key: str, by: str) -> None:
        """Mark an active alarm as acknowledged by an operator; other keys have no effect."""
        alarm = self.alarms.get(key)
        if alarm is not None and not alarm.acknowledged_by:
            alarm.acknowledged_by, alarm.acknowledged_at_us = by, self.at_us
            self._touch("alarms")

    def clear_alarm(self, key: str) -> None:
        """Clear an alarm."""
        alarm = self.alarms.pop(key, None)
        if alarm is not None:
            alarm.cleared_at_us = self.at_us
            self.cleared.append(alarm)
            self._record("alarm", alarm.vehicle, f"alarm cleared: {alarm.text}")
            self._touch("alarms")

    def active_or_cleared_alarms(self) -> list[str]:
        """Return the keys of the active alarms, then of the alarms that cleared last."""
        return [*self.alarms, *(alarm.alarm for alarm in reversed(self.cleared))]

    def clear_all_but(self, *prefixes: str) -> None:
        """Clear all alarms without these prefixes; alarms whose cause persists are raised again."""
        for key in [key for key in self.alarms if key.partition("/")[0] not in prefixes]:
            self.clear_alarm(key)

    def announce(self, vehicle: str, text: str, level: str = "info") -> None:
        """Add an announcement for the operators."""
        self.announcement_id = self.version + 1  # the id is also the version of the change
        self.announcement_count += 1
        self.announcements.append(
            Announcement(self.announcement_id, self.at_us, vehicle, level, text)
        )
        self._touch("announcements")

    def _record(
        self,
        kind: RecordKind,
        vehicle: str,
        text: str,
        level: str = "info",
        note: NoteAdded | None = None,
    ) -> None:
        """Add a line to the log without an announcement."""
        self._touch("records")  # the id is the version of the change
        line = Record(self.version, self.at_us, vehicle, level, text, kind)
        if note is not None:
            line.note, line.lat_deg, line.lon_deg = note.text, note.lat_deg, note.lon_deg
            line.photo = note.photo
        self.records.append(line)

    def _warn(self, key: str, text: str) -> None:
        """Raise an alarm about the fire and announce it."""
        self.alarm(key, text)
        self.announce("fire", text, "warning")

    def announcements_after(self, line_id: int) -> list[Announcement]:
        """Return the announcements after ``line_id``, except those before the last restart."""
        return [
            line
            for line in self.announcements
            if line.id > max(line_id, self.last_id_before_restart)
        ]

    def _touch(self, *keys: str) -> None:
        self.version += 1
        for key in keys:
            self.changed[key] = self.version
