"""The machine's clocks. Only what is live asks them; all else is told the time."""

import time
from datetime import UTC, datetime
from pathlib import Path


def clock_us() -> int:
    """Microseconds of the machine's monotonic clock."""
    return time.monotonic_ns() // 1000


def wall_us() -> int:
    """Microseconds since 1970."""
    return time.time_ns() // 1000


def last_written_s(path: Path) -> float:
    """When a file was last written to, in seconds since 1970."""
    return path.stat().st_mtime


def now_text() -> str:
    """The date and time, as a journal's header has it."""
    return datetime.now(UTC).isoformat(timespec="seconds")
