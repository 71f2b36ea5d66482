"""Read FARSITE and FlamMap inputs files: fuel moistures, weather and wind.

An inputs file has lines of the form ``KEY: value``. The value of some keys is the number of rows of
numbers that follow. ``USED`` lists the keys that affect a run; ``Inputs.ignored`` returns all
others.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from firemodel.errors import FireModelError
from firemodel.landscape.readers.fuel_files import moistures_in, rows_of, text_of
from firemodel.physics.rothermel import Moisture

NumberedRows = list[tuple[int, list[str]]]  # line number, and the line's fields

KEY = re.compile(r"\s*([A-Z][A-Z0-9_]*)\s*:\s*(.*)")
HEADER = re.compile(r"\s*[a-z]*[\s-]*inputs[\s-]*file", re.IGNORECASE)
START, END = "FARSITE_START_TIME", "FARSITE_END_TIME"
MOISTURES = "FUEL_MOISTURES_DATA"
RAWS, WTR, WND = "RAWS", "WEATHER_DATA", "WIND_DATA"
# Keys whose value is a file name, and the key of the rows that this file contains.
FILES = {
    "RAWS_FILE": RAWS,
    "WEATHER_FILE": WTR,
    "WIND_FILE": WND,
    "FUEL_MOISTURE_FILE": MOISTURES,
    "FUEL_MOISTURES_FILE": MOISTURES,
}
UNITS = {RAWS: "RAWS_UNITS", WTR: "WEATHER_DATA_UNITS", WND: "WIND_DATA_UNITS"}
WIND = ("WIND_SPEED", "WIND_DIRECTION", "WIND_SPEED_UNITS")  # a constant wind, as in FlamMap
USED = {START, END, MOISTURES, RAWS, WTR, WND, *WIND, *FILES, *UNITS.values()}
# Ignored keys that have an equivalent in a scenario, with the remedy.
INSTEAD = {
    "CUSTOM_FUELS_FILE": "specify it as landscape.custom_fuels",
    "ROS_ADJUST_FILE": "specify it as landscape.rate_factors",
    "FARSITE_ROS_ADJUSTMENTS": "specify a file as landscape.rate_factors",
    "CONDITIONING_PERIOD_END": "set weather_file.conditioned = true",
}


@dataclass(frozen=True, slots=True)
class Inputs:
    """The contents of an inputs file: the value and the rows of each key."""

    path: Path
    values: dict[str, tuple[int, str]]  # line number, and the text
    rows: dict[str, NumberedRows]

    def ignored(self) -> list[str]:
        """Return the keys that a run ignores, in file order, some with a remedy."""
        return [
            f"{key} ({INSTEAD[key]})" if key in INSTEAD else key
            for key in self.values
            if key not in USED
        ]

    def fuel_moistures(self) -> dict[int, Moisture]:
        """Return the initial moistures (fractions) by fuel code; code 0 means all other fuels."""
        path, rows = self.table(MOISTURES)
        return moistures_in(path, iter(rows))

    def units(self, key: str) -> str:
        """Return the units of a key's rows: ENGLISH (default, as in FARSITE) or METRIC.

        Raises FireModelError for another word.
        """
        line, text = self.values.get(UNITS[key], (0, "ENGLISH"))
        if text.upper() not in ("ENGLISH", "METRIC"):
            raise FireModelError(
                f"{self.path} line {line}: {UNITS[key]} = {text} must be ENGLISH or METRIC"
            )
        return text.upper()

    def has(self, key: str) -> bool:
        """Return True if the file has a key's rows or names a file with these rows."""
        return key in self.rows or any(FILES.get(name) == key for name in self.values)

    def table(self, key: str) -> tuple[Path, NumberedRows]:
        """Return a key's rows and the file that contains them.

        Raises FireModelError if there are no rows, or if the file with the rows is missing.
        """
        if self.rows.get(key):
            return self.path, self.rows[key]
        for name, (line, text) in self.values.items():
            if FILES.get(name) == key and text:
                path = self._file(line, text)
                return path, list(rows_of(path))
        raise FireModelError(f"{self.path}: has no {key}; add this key with its rows")

    def file_of(self, key: str) -> Path | None:
        """Return the file that contains a key's rows; None if the inputs file contains them."""
        if self.rows.get(key):
            return None
        found = [value for name, value in self.values.items() if FILES.get(name) == key]
        return self._file(*found[0]) if found else None

    def _file(self, line: int, text: str) -> Path:
        """Return a file that this inputs file names.

        The file is found by its path relative to the inputs file's folder, or by its name in that
        folder.
        """
        folder, plain = self.path.parent, text.strip().strip('"').replace("\\", "/")
        for path in (folder / plain, folder / Path(plain).name):
            if path.is_file():
                return path
        raise FireModelError(
            f"{self.path} line {line}: no file {plain}, and no {Path(plain).name} in the folder "
            "of the inputs file; correct the path, or copy the file to this folder"
        )

    def time(self, key: str, year: int) -> datetime | None:
        """Return a key's time ``MM DD HHMM``; None if the file does not have the key.

        Raises FireModelError for an invalid time.
        """
        if key not in self.values:
            return None
        line, text = self.values[key]
        return time_of(f"{self.path} line {line}: {key}", year, text.split())


def time_of(where: str, year: int, fields: list[str]) -> datetime:
    """Return a time without a UTC offset from month, day and HHMM (0530 or 530).

    Raises FireModelError for an invalid time; the message begins with ``where``.
    """
    try:
        month, day, clock = (int(field) for field in fields)
        found = f"{year:04}-{month:02}-{day:02}T{clock // 100:02}:{clock % 100:02}"
        return datetime.fromisoformat(found)  # the files have no UTC offset
    except ValueError:
        raise FireModelError(
            f"{where}: {' '.join(fields)!r} is not a time; specify month, day and HHMM"
        ) from None


def began_year_before(first: datetime, last: datetime, start: datetime) -> bool:
    """Return True if records without years began in the year before that of the start.

    ``first`` and ``last`` are the times of the first and the last record if the first is dated with
    the year of the start. No time has a UTC offset.
    """
    last_before = (last.year - 1, *last.timetuple()[1:6])
    return first > start and last_before >= start.timetuple()[:6]


def is_inputs_file(path: Path) -> bool:
    """Return True for a file with the suffix .input or with an inputs file's first line."""
    if path.suffix.lower() == ".input":
        return True
    try:
        with path.open("rb") as file:
            return HEADER.match(file.read(200).decode("latin-1")) is not None
    except OSError:
        return False


def read_inputs(path: Path) -> Inputs:
    """Read an inputs file.

    Args:
        path: The file.

    Returns:
        The values and the rows of its keys.

    Raises:
        FireModelError: A line is neither a key nor a row, a key is given twice, or the number of
            rows differs from the number stated.
    """
    values: dict[str, tuple[int, str]] = {}
    rows: dict[str, NumberedRows] = {}
    key = ""
    for line, text in _lines(path):
        found = KEY.fullmatch(text)
        if found:
            key = found[1]
            if key in values:
                raise FireModelError(
                    f"{path} line {line}: {key} is given twice; remove one of the lines"
                )
            values[key] = line, found[2].strip()
        elif key and text.lstrip()[0].isdigit():
            rows.setdefault(key, []).append((line, text.replace(",", " ").split()))
        elif key or not HEADER.match(text):
            raise FireModelError(
                f"{path} line {line}: {text.strip()[:40]!r} is neither KEY: value nor a row of "
                "numbers; correct or remove the line"
            )
    for name in (MOISTURES, RAWS, WTR, WND):
        count = values[name][1] if name in values else ""
        if count.isdigit() and int(count) != len(rows.get(name, [])):
            raise FireModelError(
                f"{path} line {values[name][0]}: {name} = {count}, but {len(rows.get(name, []))} "
                "rows follow; correct the number"
            )
    if not values:
        raise FireModelError(f"{path}: contains no key; use a FARSITE or FlamMap inputs file")
    return Inputs(path, values, rows)


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    for line, text in enumerate(text_of(path).splitlines(), 1):
        plain = text.partition("#")[0].rstrip()
        if plain:
            yield line, plain


def read_fuel_moistures(path: Path) -> dict[int, Moisture]:
    """Read the initial moistures of fuel models from an .fms file.

    A line contains a fuel code and the moistures of 1-h, 10-h, 100-h, live herbaceous and live
    woody fuel in percent; a seventh number (1000 h) is ignored. Code 0 means all fuels without a
    line.

    Args:
        path: The file, or a FARSITE inputs file with such lines under FUEL_MOISTURES_DATA.

    Returns:
        The moistures of each code as fractions.

    Raises:
        FireModelError: The file cannot be used; the message names file, line, field and value.
    """
    if is_inputs_file(path):
        return read_inputs(path).fuel_moistures()
    return moistures_in(path, rows_of(path))
