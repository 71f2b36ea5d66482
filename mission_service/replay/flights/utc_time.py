"""Converts UTC times between microseconds since 1970, text and datetime."""

from datetime import UTC, datetime, timedelta

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def utc(unix_us: int) -> str:
    """Return a time in ISO 8601 format with milliseconds."""
    return (EPOCH + timedelta(microseconds=unix_us)).isoformat(timespec="milliseconds")


def unix_us(instant: datetime) -> int:
    """Convert an instant with a UTC offset to microseconds since 1970."""
    return (instant - EPOCH) // timedelta(microseconds=1)
