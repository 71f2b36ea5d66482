"""Reads the machine's clocks, for live code only; other code receives the time as an argument."""

import time
from datetime import UTC, datetime
from pathlib import Path


def clock_us() -> int:
    """Return the time of the machine's monotonic clock in microseconds."""
    return time.monotonic_ns() // 1000


def wall_us() -> int:
    """Return the wall-clock time in microseconds since 1970."""
    return time.time_ns() // 1000


def last_written_s(path: Path) -> float:
    """Return the time of the last write to a file, in seconds since 1970."""
    return path.stat().st_mtime


def now_text() -> str:
    """Return the date and time in the format of a journal's header."""
    return datetime.now(UTC).isoformat(timespec="seconds")
