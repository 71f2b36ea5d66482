"""Find the bands of wind speed and direction, or of wind components, in a raster file.

The formats are ESRI ASCII grid, GeoTIFF (a file may have one or many bands), NetCDF and GRIB. A
band of a GeoTIFF is named by its description (``NAMES``), which may be followed by a time: seconds
after mission time 0, or ISO 8601. In NetCDF the variable's name, its ``standard_name`` (CF) and the
time axis are used; in GRIB, the element and the valid time.
"""

import math
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

from firemodel.errors import FireModelError
from firemodel.landscape.readers.bands import check_file, opened
from firemodel.landscape.readers.formats import wind_driver

Time = float | datetime | None  # seconds after mission time 0, a calendar time, or not in the file

NAMES = {
    "speed": ("speed", "wind_speed", "ws", "vel", "wind", "wspd", "si10", "ws10"),
    "direction": ("direction", "wind_direction", "wind_from_direction", "wd", "ang", "wdir"),
    "u": ("u", "u10", "ugrd", "x_wind", "eastward_wind", "u-component"),
    "v": ("v", "v10", "vgrd", "y_wind", "northward_wind", "v-component"),
}
TRUE_NORTH = ("eastward_wind", "northward_wind", "wind_from_direction")  # CF standard names
UNITS = {
    "m_s": ("m/s", "m s-1", "m s**-1", "mps", "meters per second", "metre per second"),
    "mph": ("mph", "mi/h", "miles per hour"),
    "kmh": ("km/h", "kmh", "kph", "km h-1"),
    "kts": ("kts", "kt", "knot", "knots"),
}
SECONDS = {"second": 1.0, "minute": 60.0, "hour": 3600.0, "day": 86400.0}
SINCE = re.compile(r"(second|minute|hour|day)s? since (.+)", re.IGNORECASE)
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
TEN_METRES = ("10-HTGL",)  # the level of 10 m wind in GRIB


class WindLayer(NamedTuple):
    """The header of one wind band."""

    path: Path
    dataset: str  # the name under which GDAL opens the file or a variable in it
    driver: str
    number: int  # band number, from 1
    kind: str  # key of ``NAMES``, or empty
    time: Time
    unit: str  # key of ``UNITS``, or the unknown unit in the file, or empty
    height: str  # "10m", or empty
    true_north: bool  # True if the file states that directions are relative to true north
    crs: str | None
    transform: Any  # affine.Affine from (column, row) of cell corners to x, y
    shape: tuple[int, int]

    @property
    def label(self) -> str:
        """The band's name in error messages."""
        variable = self.dataset.rpartition(":")[2] if self.driver == "netCDF" else ""
        band = "" if self.driver == "AAIGrid" else f"band {self.number}"
        return " ".join(part for part in (str(self.path), variable, band) if part)


def wind_layers(path: Path) -> list[WindLayer]:
    """Return the wind bands of a file, in file order.

    If the file has only one band, its kind may be empty. Raises FireModelError for a file that
    cannot be read, and for a time or unit in the file that cannot be used.
    """
    check_file(path)
    driver = wind_driver(path)
    found: list[WindLayer] = []
    for dataset in _datasets(path, driver):
        with _quietly(path, driver, dataset) as file:
            found += _layers(path, dataset, file)
    named = [layer for layer in found if layer.kind]
    ten_metres = [layer for layer in named if layer.height == "10m"]
    if driver == "GRIB" and ten_metres:
        return ten_metres  # the file may have winds at other heights, which fires do not use
    return named if len(found) > 1 else found


def _datasets(path: Path, driver: str) -> list[str]:
    """Return the names of the datasets in a file: those of the variables if there are several."""
    with _quietly(path, driver, str(path)) as file:
        if file.count or driver != "netCDF":
            return [str(path)]
        return [str(name) for name in file.subdatasets]


@contextmanager
def _quietly(path: Path, driver: str, dataset: str) -> Iterator[Any]:
    """Open a file without the warning about a missing CRS, which later causes an error."""
    from rasterio.errors import NotGeoreferencedWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with opened(path, driver, dataset) as file:
            yield file


def _layers(path: Path, dataset: str, file: Any) -> Iterator[WindLayer]:
    common = file.tags()
    crs = file.crs.to_string() if file.crs else _implied_crs(common)
    for number in file.indexes:
        tags = common | file.tags(number)
        texts = _names(file.driver, file.descriptions[number - 1] or "", tags)
        kind = next((each for text in texts if (each := kind_of(text))), "")
        unit = unit_in(file.units[number - 1] or tags.get("GRIB_UNIT", ""))
        yield WindLayer(
            path,
            dataset,
            file.driver,
            number,
            kind,
            _time(path, file.driver, file.descriptions[number - 1] or "", tags),
            unit,
            "10m" if tags.get("GRIB_SHORT_NAME") in TEN_METRES else "",
            tags.get("standard_name") in TRUE_NORTH,
            crs,
            file.transform,
            file.shape,
        )


def _implied_crs(tags: dict[str, str]) -> str | None:
    """Return the longitude/latitude CRS for a NetCDF file with such axes and without a CRS."""
    degrees = any(key.endswith("#units") and text == "degrees_north" for key, text in tags.items())
    return "EPSG:4326" if degrees else None


def _names(driver: str, description: str, tags: dict[str, str]) -> list[str]:
    """Return the texts that may name a band's quantity."""
    if driver == "netCDF":
        return [tags.get("standard_name", ""), tags.get("NETCDF_VARNAME", "")]
    if driver == "GRIB":
        return [tags.get("GRIB_ELEMENT", "")]
    return [description, description.rpartition(" ")[0]]


def kind_of(text: str) -> str:
    """Return the key of ``NAMES`` that a name denotes, or an empty string."""
    plain = text.strip().lower().replace(" ", "_")
    return next((kind for kind, names in NAMES.items() if plain in names), "")


def unit_in(text: str) -> str:
    """Return the key of ``UNITS`` that a text denotes, or else the text itself."""
    plain = text.strip().strip("[]").lower()
    return next((unit for unit, names in UNITS.items() if plain in names), plain)


def _time(path: Path, driver: str, description: str, tags: dict[str, str]) -> Time:
    if driver == "GRIB":
        text = tags.get("GRIB_VALID_TIME", "").partition(" ")[0]
        return EPOCH + timedelta(seconds=int(text)) if text.lstrip("-").isdigit() else None
    if driver == "netCDF":
        return _time_on_axis(path, tags)
    name, _, text = description.rpartition(" ")
    return time_in(str(path), text) if kind_of(name) and not kind_of(description) else None


def time_in(where: str, text: str) -> float | datetime:
    """Return a time in a text: seconds after mission time 0, or ISO 8601.

    Raises FireModelError for other text; the message begins with ``where``.
    """
    try:
        seconds = float(text)
    except ValueError:
        pass
    else:
        if math.isfinite(seconds):
            return seconds
    try:
        return datetime.fromisoformat(text.strip())
    except ValueError:
        raise FireModelError(
            f"{where}: {text[:60]!r} is not a time; specify seconds after mission time 0, or a "
            "time as in 2026-08-01T12:00:00Z"
        ) from None


def _time_on_axis(path: Path, tags: dict[str, str]) -> Time:
    """Return the time of a NetCDF variable's band, from the variable's time axis (CF)."""
    for key, text in tags.items():
        found = SINCE.fullmatch(tags.get(f"{key.removeprefix('NETCDF_DIM_')}#units", "").strip())
        if key.startswith("NETCDF_DIM_") and found is not None:
            origin = time_in(f"{path}: time axis", found[2].replace(" UTC", "").strip())
            if isinstance(origin, float):
                raise FireModelError(f"{path}: time axis: {found[2][:60]!r} has no date")
            origin = origin if origin.tzinfo else origin.replace(tzinfo=UTC)
            return origin + timedelta(seconds=float(text) * SECONDS[found[1].lower()])
    return None
