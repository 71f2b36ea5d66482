"""Writes the service's log to stderr as plain text or as one JSON object per line.

A filter removes secrets from every line, including tracebacks (``redaction.py``).
"""

import asyncio
import logging
import sys
from datetime import UTC, datetime
from typing import Any, Literal, TextIO

import msgspec

from mission_service.runtime.redaction import clean
from mission_service.runtime.run_context import RunContext

Form = Literal["text", "json"]
LOG_EVERY_S = 0.2
# The attributes that every record has; a record's other attributes come from ``extra``.
_USUAL = {*logging.makeLogRecord({}).__dict__, "message", "asctime", "taskName", "color_message"}


class _Formatter(logging.Formatter):
    """A formatter that writes each record as one line."""

    def __init__(self, form: Form) -> None:
        super().__init__("%(asctime)s %(levelname)-7s %(name)s: %(message)s")
        self._form = form

    def format(self, record: logging.LogRecord) -> str:
        if self._form == "text":
            return clean(super().format(record))
        at = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
        line: dict[str, Any] = {
            "at": at,
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": clean(record.getMessage()),
        }
        for name, value in record.__dict__.items():
            if name not in _USUAL:
                line[name] = clean(value) if isinstance(value, str) else value
        if record.exc_info:
            line["traceback"] = clean(self.formatException(record.exc_info))
        return msgspec.json.encode(line, enc_hook=lambda value: clean(str(value))).decode()


def set_up(form: Form = "text", level: str = "info", stream: TextIO | None = None) -> None:
    """Set up all loggers of the process to write to stderr."""
    handler = logging.StreamHandler(sys.stderr if stream is None else stream)
    handler.setFormatter(_Formatter(form))
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)
    for noisy in ("asyncio", "numba", "matplotlib", "uvicorn.access"):
        logging.getLogger(noisy).setLevel(max(logging.WARNING, logging.getLogger().level))


async def log_announcements(context: RunContext) -> None:
    """Copy announcements and alarms to the log until cancelled."""
    follower = LogFollower()
    try:
        while True:
            follower.catch_up(context)
            await context.changed(context.state_view.version)
            await asyncio.sleep(LOG_EVERY_S)  # collects lines that appear together
    finally:
        follower.catch_up(context)


class LogFollower:
    """A follower of the state view that logs each announcement once, and changes of alarms.

    An alarm is logged again when its severity changes.
    """

    def __init__(self) -> None:
        self._log = logging.getLogger("mission_service.announcements")
        self._last_id = 0
        self._severities: dict[str, str] = {}  # of the alarms that were logged, by key

    def catch_up(self, context: RunContext) -> None:
        """Log new announcements and changed alarms."""
        state_view = context.state_view
        for line in state_view.announcements_after(self._last_id):
            self._last_id = line.id
            level = logging.WARNING if line.level == "warning" else logging.INFO
            extra = {"vehicle": line.vehicle, "at_us": line.at_us}
            self._log.log(level, "%s: %s", line.vehicle, line.text, extra=extra)
        alarms = state_view.alarms
        for key, alarm in alarms.items():
            if alarm.severity != self._severities.get(key):
                level = logging.ERROR if alarm.severity == "severe" else logging.WARNING
                extra = {"alarm": key, "vehicle": alarm.vehicle, "at_us": alarm.at_us}
                self._log.log(level, "alarm %s: %s", key, alarm.text, extra=extra)
        for key in self._severities.keys() - alarms.keys():
            extra = {"alarm": key, "at_us": state_view.at_us}
            self._log.info("alarm %s: cleared", key, extra=extra)
        self._severities = {key: alarm.severity for key, alarm in alarms.items()}
