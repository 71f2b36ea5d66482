"""Describe weather files, and FARSITE's inputs files and fuel files."""

from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

from firemodel.errors import FireModelError
from firemodel.landscape.readers.fuel_files import (
    read_fuels,
    rows_of,
    with_rate_factors,
)
from firemodel.landscape.readers.inputs_files import (
    END,
    START,
    is_inputs_file,
    read_fuel_moistures,
    read_inputs,
)
from firemodel.landscape.readers.stream_files import table_in, units_in, winds_in
from firemodel.landscape.readers.weather_files import MOISTURES, read_weather
from firemodel.landscape.readers.weather_records import YEAR, records_in
from firemodel.landscape.readers.wind_files import pair_of, read_atm
from firemodel.physics.fuels import FUEL_MODELS
from firemodel.physics.rothermel import Moisture

Described = tuple[list[str], list[str]]  # lines about the contents, and notes on ignored data

DRY = Moisture(0.06, 0.08, 0.10, 0.70, 1.00)  # used only to check files without moistures
WEATHER = (".raws", ".wxs", ".wtr", ".csv")


def describe_table(path: Path) -> dict[str, Any] | None:
    """Describe a weather file or a fuel file; return None for files of another kind.

    The keys of the result are ``file``, ``kind``, ``details`` (lines about the contents), ``notes``
    (lines about data that a run ignores) and ``problems``: the reason why the file would be
    rejected, if there is one.
    """
    kind, describe = _kind_of(path)
    if describe is None:
        return None
    found: dict[str, Any] = {"file": str(path), "kind": kind}
    try:
        details, notes = describe(path)
    except FireModelError as error:
        return {**found, "details": [], "notes": [], "problems": [str(error)]}
    return {**found, "details": details, "notes": notes, "problems": []}


def _kind_of(path: Path) -> tuple[str, Callable[[Path], Described] | None]:
    if is_inputs_file(path):
        return "inputs file", _inputs
    suffix = path.suffix.lower()
    if suffix in WEATHER:
        return "weather", _weather
    return {
        ".wnd": ("wind", _wind),
        ".atm": ("grids of wind", _grids),
        ".fmd": ("custom fuels", _fuels),
        ".fms": ("fuel moistures", _moistures),
        ".adj": ("rate factors", _factors),
    }.get(suffix, ("", None))


def _weather(path: Path) -> Described:
    rows, start, _ = records_in(path, None, None)
    entries = read_weather(path, moisture=DRY).entries
    speeds = [entry.wind_speed_m_s for entry in entries]
    names = [name for name in rows[0][1] if name not in ("time", "at_s")]
    first, last = rows[0][1], rows[-1][1]
    begin, end = (row.get("time") or f"{row['at_s']} s" for row in (first, last))
    lines = [
        f"{len(rows)} records from {begin} to {end}"
        + (f", run from {start.isoformat()}" if start else ""),
        f"columns {', '.join(names)}",
        f"wind at 20 ft from {min(speeds):.1f} to {max(speeds):.1f} m/s",
    ]
    lines += [f"{name} {_range(rows, name)}" for name in names if not name.startswith("wind")]
    used = [name for name in names if name.startswith(("temperature", "humidity", "rain"))]
    sky = [name for name in names if name.startswith(("cloud", "sun"))]
    notes = []
    if used and not any(name in MOISTURES for name in names):
        notes.append(f"a run ignores {', '.join(used)}, unless weather_file.conditioned = true")
    if sky:
        notes.append(
            f'a run ignores {", ".join(sky)}, unless weather_file.dead_fuel_model = "nelson"'
        )
    if path.suffix.lower() in (".raws", ".wxs", ".wtr"):
        notes.append("a run ignores the elevation of the station")
    return lines, notes


def _range(rows: list[tuple[int, dict[str, str]]], name: str) -> str:
    values = [float(row[name]) for _, row in rows]
    return f"{min(values):g} to {max(values):g}"


def _inputs(path: Path) -> Described:
    inputs = read_inputs(path)
    lines, notes = _weather(path)
    moistures = inputs.fuel_moistures() if inputs.has("FUEL_MOISTURES_DATA") else {}
    lines += _moisture_lines(moistures)
    start = records_in(path, None, None).start
    end = inputs.time(END, start.year) if start else None
    if start and end:
        end = end if end > start else end.replace(year=end.year + 1)
        hours = (end - start) / timedelta(hours=1)
        lines.append(f"{START} to {END}: duration_s = {hours * 3600.0:g} ({hours:g} h)")
    ignored = inputs.ignored()
    if ignored:
        notes.append(f"a run ignores {', '.join(ignored)}")
    return lines, notes


def _wind(path: Path) -> Described:
    _, rows = units_in(*table_in(path))
    winds_in(path, rows, YEAR)
    note = f"read with its daily weather: path = {path.stem}.wtr, wind = {path.name}"
    return [f"{len(rows)} winds"], [note]


def _grids(path: Path) -> Described:
    found, unit, height = read_atm(path, YEAR)
    for at, speed, direction in found:
        pair_of(speed, direction, at)
    times = (f"{at:%m-%d %H:%M}" for at, _, _ in (found[0], found[-1]))
    lines = [f"{len(found)} winds from {' to '.join(times)}, in {unit} at {height}"]
    return lines, [f'read as the wind of a landscape: wind_grids.path = "{path.name}"']


def _fuels(path: Path) -> Described:
    found = read_fuels(path)
    return [
        f"{code:>4} {'dynamic' if fuel.dynamic else 'static'} {fuel.name}, depth "
        f"{fuel.depth_ft:.2f} ft, 1-h load {fuel.load_1h:.3f} lb/ft2, extinction "
        f"{100.0 * fuel.extinction_moisture:g} %"
        for code, fuel in sorted(found.items())
    ], []


def _moistures(path: Path) -> Described:
    return _moisture_lines(read_fuel_moistures(path)), []


def _moisture_lines(found: dict[int, Moisture]) -> list[str]:
    return [
        f"moisture of {f'fuel {code}' if code else 'all other fuels'}: "
        + "/".join(f"{100.0 * part:g}" for part in moisture.classes)
        + " % (1 h, 10 h, 100 h, herbaceous, woody)"
        for code, moisture in sorted(found.items())
    ]


def _factors(path: Path) -> Described:
    codes = {int(fields[0]) for _, fields in rows_of(path) if fields[0].isdigit()}
    custom = sorted(codes - {*FUEL_MODELS})
    known = FUEL_MODELS | dict.fromkeys(custom, FUEL_MODELS[1])
    found = with_rate_factors(known, path)
    lines = [f"fuel {code}: factor {fuel.rate_factor:g}" for code, fuel in sorted(found.items())]
    notes = [f"fuel codes {custom} need landscape.custom_fuels"] if custom else []
    return lines, notes
