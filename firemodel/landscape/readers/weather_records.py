"""Read the records of weather files as text, with the column names of the CSV format."""

import csv
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import NamedTuple

from firemodel.errors import FireModelError
from firemodel.landscape.readers.fuel_files import text_of
from firemodel.landscape.readers.inputs_files import (
    MOISTURES,
    RAWS,
    START,
    WIND,
    WND,
    WTR,
    Inputs,
    began_year_before,
    is_inputs_file,
    read_inputs,
)
from firemodel.landscape.readers.stream_files import (
    COLUMNS,
    daily_records,
    table_in,
    units_in,
    wind_file_of,
)
from firemodel.physics.rothermel import Moisture

Rows = list[tuple[int, dict[str, str]]]  # line number, and each named field's text

YEAR = 2001  # the year of files without years, if the start is not given
KINDS = ".raws, .wxs, .wtr, .csv or a FARSITE inputs file"
# The wind speed column for each WIND_SPEED_UNITS of an inputs file.
WIND_COLUMNS = {"": "wind_speed_mph", "0": "wind_speed_mph", "1": "wind_10m_kmh"}


# The columns of Cell2Fire's Weather.csv, which has one row per hour. Wind is at 10 m.
CELL2FIRE = {
    "WS": "wind_10m_kmh",
    "WD": "wind_from_deg",
    "TMP": "temperature_c",
    "RH": "humidity_pct",
}
# Time formats in the ``datetime`` column of Cell2Fire's tables, in addition to ISO 8601.
DATES = ("%m/%d/%Y %H:%M", "%d/%m/%Y %H:%M", "%m/%d/%y %H:%M", "%d/%m/%y %H:%M")


class Records(NamedTuple):
    """The contents of a weather file, with at least one record."""

    rows: Rows
    start: datetime | None
    fuel_moistures: Mapping[int, Moisture]  # fractions by fuel code; 0 means all other fuels


def records_in(path: Path, wind: Path | None, start: datetime | None) -> Records:
    """Return the records of a weather file, which is recognised by its suffix or its first line.

    ``wind`` is the .wnd file of a .wtr file. The first record of a file without years is given the
    year of ``start``, or the year before if the records then reach the start. If ``start`` is None,
    the start in an inputs file is returned. Raises FireModelError if the file cannot be used or has
    no records.
    """
    suffix = path.suffix.lower()
    if wind is not None and suffix != ".wtr":
        raise FireModelError(f"{wind}: only a .wtr file has a separate wind file; leave it out")
    moistures: Mapping[int, Moisture] = {}
    if is_inputs_file(path):
        inputs = read_inputs(path)
        rows = _dated(path, partial(_inputs_rows, inputs), start)
        if inputs.has(MOISTURES):
            moistures = inputs.fuel_moistures()
        if start is None and rows and "time" in rows[0][1]:
            start = _start_in(inputs, *_ends(path, rows))
    elif suffix == ".csv":
        rows = _csv_rows(path)
    elif suffix == ".wtr":
        both = table_in(path), table_in(wind or wind_file_of(path))
        rows = _dated(
            path, lambda year: _named(*daily_records(*both, year, ("ENGLISH", "ENGLISH"))), start
        )
    else:
        rows = _raws_rows(path)
    if not rows:
        raise FireModelError(f"{path}: contains no weather; add at least one record")
    return Records(rows, start, moistures)


def _dated(path: Path, read: Callable[[int], Rows], start: datetime | None) -> Rows:
    """Return the records that ``read`` returns for the year of the first of them."""
    if start is None:
        return read(YEAR)
    rows = read(start.year)
    if rows and "time" in rows[0][1] and start.tzinfo is None:
        first, last = _ends(path, rows)
        if began_year_before(first, last, start):
            return read(start.year - 1)
    return rows


def _ends(path: Path, rows: Rows) -> tuple[datetime, datetime]:
    """Return the times of the first and of the last record."""
    first, last = (time_in(path, line, row["time"]) for line, row in (rows[0], rows[-1]))
    return first, last


def _start_in(inputs: Inputs, first: datetime, last: datetime) -> datetime | None:
    """Return the start in an inputs file with records from ``first`` to ``last``."""
    start = inputs.time(START, first.year)
    if start is not None and start < first:
        later = inputs.time(START, first.year + 1)
        return later if later is not None and later <= last else start
    return start


def _named(units: str, records: list[tuple[int, list[str]]]) -> Rows:
    names = ("time", *COLUMNS[units])
    return [(line, dict(zip(names, texts, strict=True))) for line, texts in records]


def _inputs_rows(inputs: Inputs, year: int) -> Rows:
    """Return the records of an inputs file: hourly or daily weather, or a constant wind."""
    if inputs.has(RAWS):
        other = inputs.file_of(RAWS)
        if other is not None:
            return _raws_rows(other)
        path, table = inputs.table(RAWS)
        units, table = units_in(path, table, inputs.units(RAWS))
        return [(line, raws_row(path, line, fields, units)) for line, fields in table]
    if inputs.has(WTR) or inputs.has(WND):
        units_of_both = inputs.units(WTR), inputs.units(WND)
        return _named(*daily_records(inputs.table(WTR), inputs.table(WND), year, units_of_both))
    speed, direction, wind_units = (inputs.values.get(key, (0, "")) for key in WIND)
    if not (speed[1] and direction[1]):
        raise FireModelError(
            f"{inputs.path}: contains no weather; add RAWS, WEATHER_DATA with WIND_DATA, or "
            "WIND_SPEED with WIND_DIRECTION"
        )
    line, unit = wind_units
    if unit not in WIND_COLUMNS:
        raise FireModelError(
            f"{inputs.path} line {line}: WIND_SPEED_UNITS = {unit}: must be 0 (mph) or 1 (km/h)"
        )
    record = {"at_s": "0", WIND_COLUMNS[unit]: speed[1], "wind_from_deg": direction[1]}
    return [(speed[0], record)]


def time_in(path: Path, line: int, text: str) -> datetime:
    """Return a time in ISO 8601. Raises FireModelError with file and line for other text."""
    try:
        return datetime.fromisoformat(text)
    except ValueError:
        raise FireModelError(
            f"{path} line {line}: time = {text!r} is not a date and time such as "
            "2016-07-15T03:00; correct or remove the line"
        ) from None


def _csv_rows(path: Path) -> Rows:
    lines = csv.reader(text_of(path).splitlines())
    names: list[str] = []
    rows: Rows = []
    for cells in lines:
        texts = [cell.strip() for cell in cells]
        if not any(texts):
            continue
        if not names:
            names = texts
            continue
        if len(texts) != len(names):
            raise FireModelError(
                f"{path} line {lines.line_num}: {len(texts)} values, but {len(names)} column "
                "names; each column needs one value"
            )
        rows.append((lines.line_num, dict(zip(names, texts, strict=True))))
    if len(set(names)) < len(names):
        raise FireModelError(f"{path} line 1: two columns have the same name; remove one")
    known = _cell2fire(names)
    if not known:
        return rows
    _check_order(path, rows)
    return [
        (line, {"at_s": f"{hour * 3600}"} | {to: row[name] for name, to in known.items()})
        for hour, (line, row) in enumerate(rows)
    ]


def _raws_rows(path: Path) -> Rows:
    """Return the records with the column names of the CSV format.

    The count in the ``RAWS:`` line is often 1. A larger count than the number of records means that
    the file is incomplete.
    """
    if path.suffix.lower() not in (".raws", ".wxs"):
        raise FireModelError(f"{path}: is not a known kind of weather file; use {KINDS}")
    units = ""
    rows: Rows = []
    counted, count = 0, ""  # the line with the count, and the count
    for line, text in enumerate(text_of(path).splitlines(), 1):
        fields = text.partition("#")[0].replace(":", " ").split()
        head = fields[0].upper() if fields else ""
        if head in COLUMNS or head == "RAWS_UNITS":
            units = fields[-1].upper()
            if units not in COLUMNS:
                raise FireModelError(
                    f"{path} line {line}: RAWS_UNITS = {fields[-1]}: must be English or Metric"
                )
        elif head[:1].isdigit():
            if not units:
                raise FireModelError(
                    f"{path} line {line}: no units before the first record; insert a line "
                    "'RAWS_UNITS: English' or 'RAWS_UNITS: Metric'"
                )
            rows.append((line, raws_row(path, line, fields, units)))
        elif head == "RAWS":
            counted, count = line, fields[-1]
        elif head not in ("", "RAWS_ELEVATION", "YEAR"):
            raise FireModelError(
                f"{path} line {line}: {fields[0]!r} is not the first field of a header line or a "
                "record; correct or remove the line"
            )
    if count.isdigit() and int(count) > len(rows):
        raise FireModelError(
            f"{path} line {counted}: RAWS = {count}, but the file has {len(rows)} of these "
            "records; it is probably incomplete: copy it again, or correct the number"
        )
    return rows


def _cell2fire(names: list[str]) -> dict[str, str]:
    """Return the columns to read from a Cell2Fire weather table; empty for other tables."""
    known = {name: CELL2FIRE[name.upper()] for name in names if name.upper() in CELL2FIRE}
    return known if {"WS", "WD"} <= {name.upper() for name in names} else {}


def _check_order(path: Path, rows: Rows) -> None:
    """Raise FireModelError if a value in the datetime column is not a time, or the times decrease.

    Some files contain only the date, so that consecutive times may be equal.
    """
    name = next((name for _, row in rows[:1] for name in row if name.lower() == "datetime"), None)
    if name is None:
        return
    times = _times_in(path, name, rows)
    for before, at, (line, row) in zip(times, times[1:], rows[1:], strict=False):
        if (at.utcoffset() is None) == (before.utcoffset() is None) and at < before:
            raise FireModelError(
                f"{path} line {line}: {name} = {row[name]} is earlier than the previous row; sort "
                "the rows, and keep only those of one scenario"
            )


def _times_in(path: Path, name: str, rows: Rows) -> list[datetime]:
    """Return the times in a column, in ISO 8601 or in a format of ``DATES`` that fits all rows."""
    for form in DATES:
        with suppress(ValueError):
            return [datetime.strptime(row[name], form) for _, row in rows]  # noqa: DTZ007
    return [time_in(path, line, row[name]) for line, row in rows]


def raws_row(path: Path, line: int, fields: list[str], units: str) -> dict[str, str]:
    if len(fields) != 10:
        raise FireModelError(
            f"{path} line {line}: {len(fields)} fields instead of 10: year, month, day, time, "
            "temperature, humidity, rain, wind speed, wind direction, cloud cover"
        )
    year, month, day, clock = (field.zfill(2) for field in fields[:4])
    clock = clock.zfill(4)
    time = f"{year}-{month}-{day}T{clock[:-2]}:{clock[-2:]}"
    return {"time": time} | dict(zip(COLUMNS[units], fields[4:10], strict=True))
