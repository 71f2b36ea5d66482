"""Compute hourly records from FARSITE's daily weather (.wtr) and wind (.wnd) files.

A .wtr file contains each day's minimum and maximum temperature with their hours, and the humidities
at these hours. Between two such hours temperature and humidity follow a half cosine (Beck & Trevitt
1989, as in FARSITE). The days before the first and after the last day are assumed to equal the
first and the last day. Rain falls evenly from its begin to its end, which is on the next day if it
is not later than the begin. A .wnd file contains winds; each wind is used until the time of the
next.
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from datetime import datetime, timedelta
from itertools import pairwise
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from firemodel.errors import FireModelError
from firemodel.landscape.readers.fuel_files import number, rows_of
from firemodel.landscape.readers.inputs_files import NumberedRows, time_of

WTR = (
    "month, day, rain, hour of the minimum and of the maximum temperature, minimum and maximum "
    "temperature, maximum and minimum humidity, elevation, and optionally begin and end of rain"
)
WND = "month, day, hour, wind speed, wind direction, cloud cover"
SKY = ("wind_from_deg", "cloud_pct")  # the same in both units
COLUMNS = {
    "ENGLISH": ("temperature_f", "humidity_pct", "rain_in", "wind_speed_mph", *SKY),
    "METRIC": ("temperature_c", "humidity_pct", "rain_mm", "wind_10m_kmh", *SKY),
}
RAIN_IN = {"ENGLISH": 0.01, "METRIC": 1.0}  # unit of rain: 1/100 inch, or mm
HOUR = timedelta(hours=1)
MAX_WIND = 360.0  # in mph or km/h; corresponds to at least 100 m/s


class Extreme(NamedTuple):
    """A daily temperature extreme in the file's unit, and the humidity at that hour."""

    at: datetime
    temperature: float
    humidity_pct: float


class Wind(NamedTuple):
    """A wind in a .wnd file, in the file's units."""

    at: datetime
    line: int
    speed: str
    from_deg: str
    cloud_pct: str


class Rain(NamedTuple):
    """A period of rain, and its amount in the records' unit."""

    begin: datetime
    end: datetime
    amount: float

    def between(self, begin: datetime, end: datetime) -> float:
        """Return the part of the amount that falls between two times."""
        common = max(min(self.end, end) - max(self.begin, begin), timedelta(0))
        return self.amount * (common / (self.end - self.begin))


def units_in(path: Path, rows: NumberedRows, default: str = "ENGLISH") -> tuple[str, NumberedRows]:
    """Return the units in a table's first row, and the other rows.

    Raises FireModelError for a word that is not ENGLISH or METRIC.
    """
    if rows and not rows[0][1][0][0].isdigit():
        line, (word, *_) = rows[0]
        if word.upper() not in COLUMNS:
            raise FireModelError(f"{path} line {line}: {word!r} must be ENGLISH or METRIC")
        return word.upper(), rows[1:]
    return default, rows


def daily_records(
    wtr: tuple[Path, NumberedRows], wnd: tuple[Path, NumberedRows], year: int, units: Sequence[str]
) -> tuple[str, list[tuple[int, list[str]]]]:
    """Compute hourly weather records from the rows of a .wtr file and a .wnd file.

    Args:
        wtr: The .wtr file and its rows.
        wnd: The .wnd file and its rows.
        year: The year of the first row; the files do not contain years.
        units: Two words, ENGLISH or METRIC: the units of the .wtr and of the .wnd file. A word is
            used only if the file itself has no line with units.

    Returns:
        The units of both files, and a record for each full hour and for each change of wind or
        rain. A record consists of the line number of its wind in the .wnd file, and a list of
        texts: the time, then the value of each of ``COLUMNS``. The rain is the amount until the
        next record.

    Raises:
        FireModelError: A row cannot be used, the units of the files differ, or no wind in the .wnd
            file falls on a day in the .wtr file.
    """
    unit, days = units_in(*wtr, units[0])
    wind_unit, wind_rows = units_in(*wnd, units[1])
    if unit != wind_unit:
        raise FireModelError(f"{wtr[0]} is {unit}, {wnd[0]} is {wind_unit}; use the same units")
    extremes, rains = _weather(wtr[0], days, year, RAIN_IN[unit])
    begin = extremes[0].at.replace(hour=0, minute=0)
    end = extremes[-1].at.replace(hour=0, minute=0) + 24 * HOUR
    winds = _winds_between(begin, end, wnd[0], wind_rows)
    if not winds:
        raise FireModelError(
            f"{wnd[0]}: contains no wind on the days of {wtr[0]}; use files of the same period"
        )
    before, after = extremes[:2], extremes[-2:]  # the first and the last day are repeated
    extremes = [
        *(each._replace(at=each.at - 24 * HOUR) for each in before),
        *extremes,
        *(each._replace(at=each.at + 24 * HOUR) for each in after),
    ]
    found = []
    times = _times(winds, rains, begin, end)
    for at, until in pairwise([*times, times[-1]]):
        index = max(0, bisect_right(winds, at, key=itemgetter(0)) - 1)
        _, line, *wind = winds[index]
        temperature, humidity = _between(extremes, at)
        wet = sum(rain.between(at, until) for rain in rains)
        texts = (f"{temperature:.2f}", f"{humidity:.2f}", f"{wet:.6f}", *wind)
        found.append((line, [at.isoformat(), *texts]))
    return unit, found


def _winds_between(begin: datetime, end: datetime, path: Path, rows: NumberedRows) -> list[Wind]:
    """Return the winds of a .wnd file, dated in the first year with an overlap; [] if none."""
    for year in (begin.year, begin.year + 1, begin.year - 1):  # a period may begin in December
        winds = winds_in(path, rows, year)
        if winds[0].at <= end and winds[-1].at >= begin:
            return winds
    return []


def _times(winds: list[Wind], rains: list[Rain], begin: datetime, end: datetime) -> list[datetime]:
    """Return the full hours and times of wind and rain, from the first wind until ``end``."""
    first = max(winds[0][0], begin)
    hour = first.replace(minute=0)
    hours = [hour + number * HOUR for number in range(int((end - hour) / HOUR) + 1)]
    changes = {wind.at for wind in winds} | {at for rain in rains for at in (rain.begin, rain.end)}
    return sorted(at for at in changes.union(hours) if first <= at <= end)


def _weather(
    path: Path, rows: NumberedRows, year: int, rain_in: float
) -> tuple[list[Extreme], list[Rain]]:
    if not rows:
        raise FireModelError(f"{path}: contains no weather; add at least one day ({WTR})")
    extremes: list[Extreme] = []
    rains: list[Rain] = []
    for line, fields in rows:
        where = f"{path} line {line}"
        if len(fields) not in (10, 12):
            raise FireModelError(f"{where}: {len(fields)} fields; required are {WTR}")
        if extremes and number(where, "month", fields[0], 1, 12) < extremes[-1].at.month:
            year += 1
        low, high = (time_of(where, year, [*fields[:2], clock]) for clock in fields[3:5])
        t_low, t_high = (number(where, "temperature", text, -76.0, 158.0) for text in fields[5:7])
        wet, dry = (number(where, "humidity", text, 0.0, 100.0) for text in fields[7:9])
        pair = sorted([Extreme(low, t_low, wet), Extreme(high, t_high, dry)])
        if pair[0].at == pair[1].at or (extremes and pair[0].at <= extremes[-1].at):
            raise FireModelError(f"{where}: not later than the previous time; sort the days")
        if t_low > t_high or dry > wet:
            raise FireModelError(
                f"{where}: the minimum temperature {t_low:g} and the maximum {t_high:g} or the "
                f"humidities {wet:g} and {dry:g} are interchanged; correct the line"
            )
        extremes += pair
        rain = _rain(where, fields, low, rain_in)
        rains += [rain] if rain.amount > 0.0 else []
    return extremes, rains


def _rain(where: str, fields: list[str], day: datetime, rain_in: float) -> Rain:
    """Return the rain of a day; rain without hours is spread over the whole day."""
    amount = number(where, "rain", fields[2], 0.0, 5000.0) * rain_in
    midnight = day.replace(hour=0, minute=0)
    texts = fields[10:] or ("0", "2400")
    clocks = [number(where, "hour of rain", text, 0.0, 2400.0) for text in texts]
    begin, end = (midnight + (clock // 100 + clock % 100 / 60.0) * HOUR for clock in clocks)
    return Rain(begin, end if end > begin else end + 24 * HOUR, amount)


def winds_in(path: Path, rows: NumberedRows, year: int) -> list[Wind]:
    """Return the winds in a .wnd file; a row without cloud cover has a clear sky.

    ``year`` is the year of the first row. Raises FireModelError for a row that cannot be used and
    for a file without rows; the message names file and line.
    """
    found: list[Wind] = []
    for line, fields in rows:
        where = f"{path} line {line}"
        if not 5 <= len(fields) <= 6:
            raise FireModelError(f"{where}: {len(fields)} fields; required are {WND}")
        if found and number(where, "month", fields[0], 1, 12) < found[-1][0].month:
            year += 1
        at = time_of(where, year, fields[:3])
        if found and at <= found[-1][0]:
            raise FireModelError(f"{where}: not later than the previous wind; sort the lines")
        number(where, "wind speed", fields[3], 0.0, MAX_WIND)
        number(where, "wind direction", fields[4], 0.0, 360.0)
        cloud = fields[5] if len(fields) > 5 else "0"
        number(where, "cloud cover", cloud, 0.0, 100.0)
        found.append(Wind(at, line, fields[3], fields[4], cloud))
    if not found:
        raise FireModelError(f"{path}: contains no wind; add at least one line ({WND})")
    return found


def _between(extremes: list[Extreme], at: datetime) -> tuple[float, float]:
    """Return the temperature and humidity at a time between the first and the last extreme."""
    after = min(bisect_left(extremes, at, key=attrgetter("at")), len(extremes) - 1)
    left, right = extremes[max(after - 1, 0)], extremes[after]
    span_s = (right.at - left.at).total_seconds()
    part = (at - left.at).total_seconds() / span_s if span_s else 0.0
    weight = 0.5 - 0.5 * math.cos(math.pi * float(np.clip(part, 0.0, 1.0)))
    return (
        left.temperature + weight * (right.temperature - left.temperature),
        left.humidity_pct + weight * (right.humidity_pct - left.humidity_pct),
    )


def wind_file_of(path: Path) -> Path:
    """Return the .wnd file named like a .wtr file. Raises FireModelError if there is none."""
    found = [
        each for each in (path.with_suffix(".wnd"), path.with_suffix(".WND")) if each.is_file()
    ]
    if not found:
        raise FireModelError(
            f"{path}: contains no wind, and its folder contains no {path.stem}.wnd; set "
            "weather_file.wind"
        )
    return found[0]


def table_in(path: Path) -> tuple[Path, NumberedRows]:
    """Return a file and its rows (``rows_of``)."""
    return path, list(rows_of(path))
