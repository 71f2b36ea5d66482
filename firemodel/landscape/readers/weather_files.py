"""Read weather streams from FARSITE's weather files and from CSV files with named columns."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.landscape.readers.weather_records import Rows, records_in, time_in
from firemodel.physics.moisture import dead_moistures_pct
from firemodel.physics.rothermel import M_S_PER_MPH, Moisture
from firemodel.physics.weather import (
    DEAD_PCT,
    DeadMoistures,
    Weather,
    WeatherSource,
    WeatherStream,
    wind_20ft_from_10m,
)

if TYPE_CHECKING:
    from firemodel.landscape.zone_moistures import ZoneConditions


@dataclass(frozen=True, slots=True)
class Column:
    """A column in a file; its values become the field ``gives``.

    The field is ``value * scale + offset``.

    Values in the file must be from ``low`` to ``high``.
    """

    gives: str
    low: float
    high: float
    scale: float = 1.0
    offset: float = 0.0


MOISTURES = (*DEAD_PCT, "live_herb_pct", "live_woody_pct")
SPEEDS_M_S = {"m_s": 1.0, "mph": M_S_PER_MPH, "kmh": 1.0 / 3.6}
TIMES = ("at_s", "time")
COLUMNS = (
    {
        f"wind_speed_{unit}": Column("wind_speed_m_s", 0.0, 100.0 / m_s, m_s)
        for unit, m_s in SPEEDS_M_S.items()
    }
    | {
        f"wind_10m_{unit}": Column(
            "wind_speed_m_s", 0.0, 100.0 / m_s, float(wind_20ft_from_10m(m_s))
        )
        for unit, m_s in SPEEDS_M_S.items()
    }
    | {
        "wind_from_deg": Column("wind_from_deg", 0.0, 360.0),
        "wind_toward_deg": Column("wind_from_deg", 0.0, 360.0, offset=180.0),
        "temperature_c": Column("temperature_c", -60.0, 70.0),
        "temperature_f": Column("temperature_c", -76.0, 158.0, 5.0 / 9.0, -160.0 / 9.0),
        "humidity_pct": Column("humidity_pct", 0.0, 100.0),
        "rain_mm": Column("rain_mm", 0.0, 500.0),
        "rain_in": Column("rain_mm", 0.0, 20.0, 25.4),
        "cloud_pct": Column("cloud_pct", 0.0, 100.0),
        "sun_w_m2": Column("sun_w_m2", 0.0, 1500.0),
    }
    | {name: Column(name, 0.0, 500.0) for name in MOISTURES}
)


def read_weather(
    path: Path,
    *,
    start: datetime | None = None,
    moisture: Moisture | None = None,
    conditioned: bool = False,
    zones: "ZoneConditions | None" = None,
    wind: Path | None = None,
    fuel_moistures: Mapping[int, Moisture] | None = None,
) -> WeatherStream:
    """Read a .raws, .wxs, .wtr or .csv file; each record is used from its time until the next.

    A .raws or .wxs file has times without a UTC offset, and a RAWS_UNITS line with ENGLISH or
    METRIC. ENGLISH means °F, inches and wind in mph 20 ft above the vegetation; METRIC means °C, mm
    and wind in km/h at 10 m.

    A .wtr file contains the extremes of each day, from which hourly records are computed
    (``stream_files``); a .wnd file contains the wind. An inputs file of FARSITE or FlamMap
    (``inputs_files``) contains the weather records, or names the files that contain them. The
    moistures and the start in an inputs file are used if ``fuel_moistures`` and ``start`` are not
    given.

    A CSV file has one header line with the column names, in any order. The time column is ``time``
    (ISO 8601), or ``at_s`` if ``start`` is not given. The name of the wind speed column is
    ``wind_speed_`` (at 20 ft) or ``wind_10m_`` (at 10 m), followed by ``m_s``, ``mph`` or ``kmh``.
    The wind direction column is ``wind_from_deg`` or ``wind_toward_deg``, clockwise from north. The
    other ``COLUMNS`` are optional. A record's rain falls between its time and that of the next
    record.

    Args:
        path: The file.
        start: The calendar time of the stream's 0 s, by default the time of the first record or the
            start in an inputs file. The start must be within the file's times; records that end
            before the start are ignored. The start must not have a UTC offset, unless the file is a
            .csv file.
        moisture: Fuel moistures (fractions) for the classes that have no column in the file.
        conditioned: True to compute the dead moistures from temperature, humidity and rain
            (``physics/moisture.py``), starting with ``moisture`` at the first record of the file.
            These moistures are the same across the whole landscape.
        zones: If given and ``conditioned``, the moistures of a landscape's zones are computed too,
            from sun, air and rain (``zone_moistures``); fires use these.
        wind: The .wnd file of a .wtr file, by default the one with the same name.
        fuel_moistures: Moistures (fractions) of individual fuel codes, instead of ``moisture``;
            code 0 means all other codes (``inputs_files.read_fuel_moistures``).

    Returns:
        The weather, with the wind at 20 ft in m/s.

    Raises:
        FireModelError: The file cannot be used; the message names file, line, field and value.
    """
    rows, start, of_file = records_in(path, wind, start)
    own = dict(of_file if fuel_moistures is None else fuel_moistures)
    moisture = own.pop(0, moisture)
    _check_columns(path, rows[0][1])
    at_s = _times_s(path, rows, start)
    values = {
        COLUMNS[name].gives: np.array([_number(path, line, name, row[name]) for line, row in rows])
        for name in rows[0][1]
        if name in COLUMNS
    }
    values["wind_from_deg"] %= 360.0
    _check_moistures(path, values, moisture, own, conditioned)
    moistures_pct = _moistures_pct(at_s, values, moisture, conditioned)
    own_pct = {code: _moistures_pct(at_s, values, wet, conditioned) for code, wet in own.items()}
    begin = _begin(path, rows, start)
    of_zones: list[tuple[DeadMoistures, ...]] = [()] * at_s.size
    if conditioned and zones is not None:
        of_zones = _zone_moistures(path, at_s, values, moisture, begin, zones)
    first = np.searchsorted(at_s, 0.0, side="right") - 1
    humid = values.get("humidity_pct")
    return WeatherStream(
        [
            Weather(
                float(at_s[number]),
                float(values["wind_speed_m_s"][number]),
                float(values["wind_from_deg"][number]),
                *map(float, moistures_pct[number]),
                of_fuels=tuple((code, _fractions(pct[number])) for code, pct in own_pct.items()),
                of_zones=of_zones[number],
            )
            for number in range(first, at_s.size)
        ],
        WeatherSource(str(path), begin, None if humid is None else tuple(humid[first:].tolist())),
    )


def _begin(path: Path, rows: Rows, start: datetime | None) -> datetime | None:
    """Return the calendar time of 0 s, or None if the file has no calendar times."""
    line, row = rows[0]
    return time_in(path, line, row["time"]) if start is None and "time" in row else start


def _zone_moistures(
    path: Path,
    at_s: Floats,
    values: Mapping[str, Floats],
    moisture: Moisture | None,
    begin: datetime | None,
    zones: "ZoneConditions",
) -> list[tuple[DeadMoistures, ...]]:
    """Return the dead fuel moistures of the zones at each record of a file."""
    from firemodel.landscape.zone_moistures import AirRecords, zone_moistures

    assert moisture is not None  # because dead moistures are not in the file (_check_moistures)
    if begin is None:
        raise FireModelError(
            f"{path}: has no calendar times, which the position of the sun requires; use a column "
            '`time` instead of `at_s`, or set dead_fuel_model = "time_lag"'
        )
    none = np.zeros(at_s.size)
    air = AirRecords(
        begin,
        at_s,
        values["temperature_c"],
        values["humidity_pct"],
        values.get("rain_mm", none),
        values.get("cloud_pct", none),
        values.get("sun_w_m2"),
        (moisture.dead_1h, moisture.dead_10h, moisture.dead_100h),
    )
    return zone_moistures(air, zones)


def _fractions(pct: Floats) -> Moisture:
    return Moisture(*(float(value) / 100.0 for value in pct))


def _check_columns(path: Path, names: Iterable[str]) -> None:
    """Reject unknown columns, two columns for one quantity, and a missing time or wind."""
    given: dict[str, str] = {}
    for name in names:
        if name not in COLUMNS and name not in TIMES:
            raise FireModelError(
                f"{path}: column {name!r} is unknown; columns are {', '.join([*TIMES, *COLUMNS])}"
            )
        gives = COLUMNS[name].gives if name in COLUMNS else "time"
        if gives in given:
            raise FireModelError(
                f"{path}: the columns {given[gives]} and {name} have the same meaning; remove one"
            )
        given[gives] = name
    for gives, columns in (
        ("time", "time or at_s"),
        ("wind_speed_m_s", "wind speed, such as wind_speed_m_s"),
        ("wind_from_deg", "wind_from_deg or wind_toward_deg"),
    ):
        if gives not in given:
            raise FireModelError(f"{path}: has no column for {columns}; add one")


def _number(path: Path, line: int, name: str, text: str) -> float:
    """Return one value of a column, in the unit of the column's field."""
    column = COLUMNS[name]
    value = _float(path, line, name, text)
    if not column.low <= value <= column.high:
        raise FireModelError(
            f"{path} line {line}: {name} = {text} must be {column.low:.5g} to {column.high:.5g}; "
            "correct or remove the line"
        )
    return value * column.scale + column.offset


def _float(path: Path, line: int, name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise FireModelError(
            f"{path} line {line}: {name} = {text!r} is not a number; correct or remove the line"
        ) from None


def _times_s(path: Path, rows: Rows, start: datetime | None) -> Floats:
    """Return the times of the records in seconds after the start.

    The times must increase, and 0 must lie between the first and the last time.
    """
    name = "at_s" if "at_s" in rows[0][1] else "time"
    if name == "at_s":
        if start is not None:
            raise FireModelError(
                f"{path}: has the column at_s, in which 0 s is the start; omit the start {start}"
            )
        at_s = [_float(path, line, name, row[name]) for line, row in rows]
    else:
        times = [time_in(path, line, row[name]) for line, row in rows]
        origin = times[0] if start is None else start
        for (line, row), time in zip(rows, times, strict=True):
            if (time.utcoffset() is None) != (origin.utcoffset() is None):
                raise FireModelError(
                    f"{path} line {line}: time = {row[name]} and {origin.isoformat()}: one has a "
                    "UTC offset, the other has none; add one to both or to neither"
                )
        at_s = [(time - origin).total_seconds() for time in times]
    for number, (line, row) in enumerate(rows):
        if not np.isfinite(at_s[number]):
            raise FireModelError(
                f"{path} line {line}: {name} = {row[name]} is not a number of seconds; correct it"
            )
        if number and not at_s[number] > at_s[number - 1]:
            raise FireModelError(
                f"{path} line {line}: {name} = {row[name]} is not later than the previous record "
                f"({rows[number - 1][1][name]}); sort the records and remove duplicates (local "
                "times repeat an hour when clocks go back: add a UTC offset)"
            )
    if at_s[0] > 0.0 or at_s[-1] < 0.0:
        raise FireModelError(
            f"{path}: its weather covers {name} = {rows[0][1][name]} to {rows[-1][1][name]}; the "
            f"start {start or '0 s'} is outside this period; use another start or file"
        )
    return np.array(at_s)


def _check_moistures(
    path: Path,
    values: Mapping[str, Floats],
    moisture: Moisture | None,
    own: Mapping[int, Moisture],
    conditioned: bool,
) -> None:
    """Raise FireModelError if moistures are missing or are given in two ways."""
    missing = [name for name in MOISTURES if name not in values]
    if missing and moisture is None:
        raise FireModelError(f"{path}: has no column {missing[0]}; add it, or specify the moisture")
    if own and len(missing) < len(MOISTURES):
        raise FireModelError(
            f"{path}: has columns of moistures, which cannot be combined with moistures of single "
            "fuels; remove the columns or the moistures of single fuels"
        )
    if not conditioned:
        return
    for name in DEAD_PCT:
        if name in values:
            raise FireModelError(
                f"{path}: has a column {name}, so dead moistures cannot be conditioned; "
                "remove it, or read with conditioned=False"
            )
    for name in ("temperature_c", "humidity_pct"):
        if name not in values:
            raise FireModelError(
                f"{path}: has no column {name}, which conditioning requires; add it"
            )


def _moistures_pct(
    at_s: Floats, values: Mapping[str, Floats], moisture: Moisture | None, conditioned: bool
) -> Floats:
    """Return the moistures (n, 5) of the five classes in percent, conditioned if required."""
    held = [100.0 * part for part in moisture.classes] if moisture else [0.0] * 5
    found = np.column_stack(
        [
            values.get(name, np.full(at_s.size, pct))
            for name, pct in zip(MOISTURES, held, strict=True)
        ]
    )
    if conditioned:
        found[:, :3] = dead_moistures_pct(
            at_s,
            values["temperature_c"],
            values["humidity_pct"],
            values.get("rain_mm", np.zeros(at_s.size)),
            (held[0], held[1], held[2]),
        )
    return found
