"""Find the time of each feature in a file from the feature's attributes."""

import math
import re
from collections.abc import Sequence
from datetime import UTC, date, datetime, timedelta, tzinfo
from numbers import Real
from typing import Any, NamedTuple

import numpy as np

Record = dict[str, Any]

# Fields with the time of a perimeter, in order of preference; the fields in one row have the same
# meaning. Case is ignored. Shapefiles truncate names to ten bytes.
FIELDS = (
    ("PolygonDateTime", "poly_PolygonDateTime"),  # WFIGS, and its views with a prefix
    ("perimeterdatetime", "perDatTime"),  # GeoMAC
    ("poly_DateCurrent", "DateCurrent"),  # FIRIS, CAL FIRE (NIFC); elsewhere: last change
    ("timestamp", "when", "begin"),  # KML; GDAL returns the start of a TimeSpan as a field
    ("datetime", "date_time"),
    ("time",),
)
FIRIS_DATE, FIRIS_TIME = "YYYYMMDD", "24_HHMMSS"
CUT = 10  # maximum length of a field name in a Shapefile

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
YEARS = range(1900, 2201)
MIN_EPOCH_S, MIN_EPOCH_MS = 1e8, 1e11  # March 1973; smaller numbers are not times in s or ms
NUMBER = re.compile(r"[+-]?\d+(\.\d*)?")
DAY = re.compile(r"\d{4}-\d\d-\d\d")
MIDNIGHT = re.compile(r"\d{4}-\d\d-\d\d[T ]00:00(:00(\.0+)?)?")
US_TIMES = ("%m/%d/%Y %I:%M:%S %p", "%m/%d/%Y %I:%M %p")  # formats in GeoMAC's perDatTime


class TimeColumn(NamedTuple):
    """The times of a file's features, as they are in the file."""

    field: str  # the name of the field in the file, for messages
    values: list[Any]  # one for each feature; None if there is no time


def time_column(records: Sequence[Record]) -> TimeColumn | None:
    """Return the field with the features' times, from the attributes of each feature.

    If the two FIRIS fields with the date and the time of day are present, their values are joined.
    Otherwise, the field is the first of ``FIELDS`` that has a value in any feature. Returns None if
    there is no such field.
    """
    names = {key.lower(): key for record in records for key in record}
    day, clock = names.get(FIRIS_DATE.lower()), names.get(FIRIS_TIME.lower())
    if day and clock:
        pairs = [_joined(record.get(day), record.get(clock)) for record in records]
        return TimeColumn(f"{FIRIS_DATE} and {FIRIS_TIME}", pairs)
    for same in FIELDS:
        spellings = [each.lower() for name in same for each in (name, name[:CUT])]
        keys = list(dict.fromkeys(names[each] for each in spellings if each in names))
        values = [_first(record, keys) for record in records]
        if any(value is not None for value in values):
            return TimeColumn(" or ".join(keys), _without_midnight(values))
    return None


def is_firis(column: TimeColumn) -> bool:
    """Return True if the times are from the two fields of FIRIS."""
    return column.field.startswith(FIRIS_DATE)


def _joined(day: Any, clock: Any) -> str | None:
    """Return the date and time as ISO 8601 from numbers or text such as 20191031 and 19:37:11."""
    if _is_missing(day) or _is_missing(clock):
        return None
    days, clocks = (re.sub(r"\.0+$", "", str(value).strip()) for value in (day, clock))
    parts = clocks.split(":")
    width = 6 if len(parts) == 1 else 2  # 93711 and 9:37:11 are the same time
    return f"{days}T{''.join(part.zfill(width) for part in parts)}"


def _first(record: Record, keys: list[str]) -> Any:
    values = (record.get(key) for key in keys)
    return next((value for value in values if not _is_missing(value)), None)


def _is_missing(value: Any) -> bool:
    if isinstance(value, str):
        return not value.strip()
    if isinstance(value, np.datetime64):
        return bool(np.isnat(value))
    return value is None or (isinstance(value, Real) and math.isnan(value))


def _without_midnight(values: list[Any]) -> list[Any]:
    """Return dates if all times are 00:00 without offset: GDAL returns KML dates in this form."""
    given = [value for value in values if value is not None]
    if not all(isinstance(value, str) and MIDNIGHT.fullmatch(value) for value in given):
        return values
    return [value and value[:10] for value in values]


def time_in(value: Any, zone: tzinfo) -> datetime | date:
    """Return the time in a field's value: an aware datetime in UTC, or a date with no time of day.

    Args:
        value: A text in ISO 8601 or with slashes (2019/10/31 19:37:11+00, 10/31/2019 7:37:11 PM),
            a number (seconds or milliseconds since 1970 UTC, also as text), or numpy.datetime64.
        zone: The time zone of times without a UTC offset.

    Raises:
        ValueError: The value is not a time from 1900 to 2200.
    """
    try:
        found = _parsed(value)
        if found.year not in YEARS:
            raise ValueError
        if not isinstance(found, datetime):
            return found
        return (found if found.tzinfo else found.replace(tzinfo=zone)).astimezone(UTC)
    except (ValueError, TypeError, OverflowError):
        raise ValueError(
            f"{str(value)[:40]!r} is not a date and time from {YEARS[0]} to {YEARS[-1]}"
        ) from None


def _parsed(value: Any) -> datetime | date:
    if isinstance(value, np.datetime64):
        value = str(value.astype("datetime64[us]")) if value.dtype != "M8[D]" else str(value)
    if not isinstance(value, str):
        return _from_epoch(float(value))
    text = value.strip()
    if NUMBER.fullmatch(text):
        return _from_epoch(float(text))
    if text.upper().endswith("M"):
        return _from_us(text)
    text = text.replace("/", "-")
    return date.fromisoformat(text) if DAY.fullmatch(text) else datetime.fromisoformat(text)


def _from_epoch(number: float) -> datetime:
    if number < MIN_EPOCH_S:
        raise ValueError
    return EPOCH + timedelta(seconds=number / 1e3 if number >= MIN_EPOCH_MS else number)


def _from_us(text: str) -> datetime:
    for form in US_TIMES:
        try:
            return datetime.strptime(text, form)  # noqa: DTZ007
        except ValueError:
            continue
    raise ValueError
