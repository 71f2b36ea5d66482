"""Read wind grids from WindNinja, FARSITE (.atm), GeoTIFF, NetCDF or GRIB files.

WindNinja's speed and direction grids (``NAME_vel`` and ``NAME_ang``, .asc or .tif) give the
direction from which the wind blows, clockwise from their own grid north: WindNinja converts between
this direction and that from true north using the convergence of its elevation file
(``COORD_TRANSFORM_ANGLES`` in its ``ninja.cpp``).

An .atm file begins with ``WINDS`` or ``WINDS_AND_CLOUDS``. The next line may contain ENGLISH (mph
at 20 ft, the default) or METRIC (km/h at 10 m). Each remaining line contains month, day, HHMM, and
the names of the speed and the direction grid, relative to the folder of the .atm file; cloud grids
are not used. The files contain no year (FARSITE's reference guide, "Gridded Weather File";
WindNinja's ``farsiteAtm.cpp``).
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from firemodel.errors import FireModelError
from firemodel.landscape.gridded_wind import WindStack
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.readers.fuel_files import number, rows_of
from firemodel.landscape.readers.inputs_files import began_year_before, time_of
from firemodel.landscape.readers.weather_records import YEAR
from firemodel.landscape.readers.wind_layers import Time, WindLayer, wind_layers
from firemodel.landscape.readers.wind_placement import (
    Placement,
    WindGrid,
    grid_of_wind,
    placement_of,
    vectors_at,
)
from firemodel.landscape.wind_options import Height, North, Unit
from firemodel.physics.wind_field import WindGrids

ATM = ("WINDS", "WINDS_AND_CLOUDS")
ATM_UNITS: dict[str, tuple[Unit, Height]] = {"ENGLISH": ("mph", "20ft"), "METRIC": ("kmh", "10m")}
PAIRS = (("speed", "direction"), ("u", "v"))


class WindPair(NamedTuple):
    """The wind at one time: bands of speed and direction, or of u (east) and v (north)."""

    one: WindLayer
    other: WindLayer
    time: Time


@dataclass(frozen=True, slots=True)
class WindFiles:
    """Wind files, and what the files do not state themselves.

    Attributes:
        path: A file with all grids: .atm, GeoTIFF, NetCDF or GRIB.
        pairs: Instead of ``path``, for each time the speed file, the direction file and the time.
        at_s: The times of the grids in ``path``, in file order, if the file has no times.
        unit: The unit of speeds and components; an .atm file or a file with units needs none.
        height: The height above the vegetation, 20 ft or 10 m; .atm and GRIB files need none.
        north: Whether directions and components are relative to grid north or to true north. By
            default grid north, or as in the ``standard_name`` of a NetCDF file.
        crs: The CRS of files without one.
    """

    path: Path | None = None
    pairs: tuple[tuple[Path, Path, Time], ...] = ()
    at_s: tuple[float, ...] = ()
    unit: Unit | None = None
    height: Height | None = None
    north: North | None = None
    crs: str | None = None


def read_wind(
    files: WindFiles,
    landscape: Landscape,
    starts: Sequence[datetime] = (),
    until_s: float = math.inf,
) -> WindStack:
    """Read wind grids and resample them to a landscape.

    The components are interpolated bilinearly and rotated to the landscape's grid north. A grid may
    end at most one of its cells short of the landscape's edge.

    Args:
        files: The files.
        landscape: The landscape; the wind is resampled to its grid.
        starts: Calendar times of 0 s. If the times in the files have a UTC offset, the first start
            with an offset is used, otherwise the first without. Without starts, the first grid is
            at 0 s.
        until_s: The end of the period for which the wind is needed; later grids are not read.

    Returns:
        The wind at 20 ft in m/s, starting with the last grid at 0 s or earlier.

    Raises:
        FireModelError: A file cannot be used; the message names file, band or line, and value.
    """
    if files.path is not None and is_atm(files.path):
        pairs, unit, height = _atm(files, starts)
        files = WindFiles(unit=unit, height=height, north=files.north, crs=files.crs)
    elif files.path is not None:
        pairs = _timed(files.path, pairs_in(files.path), files.at_s)
    else:
        pairs = [pair_of(speed, direction, time) for speed, direction, time in files.pairs]
    at_s = _seconds(pairs, starts)
    first = sum(time_s <= 0.0 for time_s in at_s) - 1
    if first < 0:
        raise FireModelError(
            f"{pairs[0].one.path}: the first wind is at {at_s[0]:g} s, so the wind before it is "
            "missing; specify a wind at 0 s or earlier, or another start"
        )
    last = min(sum(time_s < until_s for time_s in at_s), len(at_s) - 1)
    used = range(first, max(last, first) + 1)
    found = np.empty((len(used), 2, *landscape.shape), dtype=np.float32)
    places: dict[WindGrid, Placement] = {}
    for count, each in enumerate(used):
        one, other, _ = pairs[each]
        scale, grid = scale_of(one, files), grid_of_wind(one, files.crs, files.north)
        if grid not in places:
            places = {grid: placement_of(landscape, grid, one.path)}
        wind = vectors_at(places[grid], one, other, scale)
        found[count] = wind.real, wind.imag
    return WindStack(tuple(at_s[each] for each in used), WindGrids(found))


def is_atm(path: Path) -> bool:
    """Return True for a file with the suffix .atm."""
    return path.suffix.lower() == ".atm"


def listed_grids(path: Path) -> list[Path]:
    """Return the files named in an .atm file; none for any other kind of file."""
    if not is_atm(path):
        return []
    return [each for _, *both in read_atm(path, YEAR)[0] for each in both]


def _atm(files: WindFiles, starts: Sequence[datetime]) -> tuple[list[WindPair], Unit, Height]:
    assert files.path is not None
    if files.unit or files.height or files.at_s:
        raise FireModelError(
            f"{files.path}: an .atm file contains unit, height and times; remove `unit`, `height` "
            "and `at_s`"
        )
    start = _start_for([datetime.min], starts) if starts else None  # noqa: DTZ901
    year = YEAR if start is None else start.year
    lines, unit, height = read_atm(files.path, year)
    if start is not None and began_year_before(lines[0][0], lines[-1][0], start):
        lines, _, _ = read_atm(files.path, year - 1)
    return [pair_of(speed, direction, at) for at, speed, direction in lines], unit, height


def read_atm(path: Path, year: int) -> tuple[list[tuple[datetime, Path, Path]], Unit, Height]:
    """Return the times, speed and direction files listed in an .atm file, with unit and height.

    ``year`` is the year of the first line. Raises FireModelError for a line that cannot be used;
    the message names the line.
    """
    rows = list(rows_of(path))
    if not rows or rows[0][1][0].upper() not in ATM:
        raise FireModelError(f"{path}: does not begin with WINDS or WINDS_AND_CLOUDS")
    unit, height = ATM_UNITS["ENGLISH"]
    found: list[tuple[datetime, Path, Path]] = []
    for line, fields in rows[1:]:
        where = f"{path} line {line}"
        if fields[0].upper() in ATM_UNITS and not found:
            unit, height = ATM_UNITS[fields[0].upper()]
            continue
        if not 5 <= len(fields) <= 6:
            raise FireModelError(
                f"{where}: {len(fields)} fields; required are month, day, HHMM, the speed and the "
                "direction grid, and optionally the cloud grid, with names without spaces"
            )
        if found and number(where, "month", fields[0], 1, 12) < found[-1][0].month:
            year += 1
        at = time_of(where, year, fields[:3])
        found.append((at, path.parent / fields[3], path.parent / fields[4]))
    if not found:
        raise FireModelError(f"{path}: contains no wind; add at least one line")
    return found, unit, height


def pair_of(speed: Path, direction: Path, time: Time) -> WindPair:
    """Return the pair from two files with one band each. Raises FireModelError for other files."""
    found = []
    for path, kind in ((speed, "speed"), (direction, "direction")):
        layers = wind_layers(path)
        if len(layers) != 1:
            raise FireModelError(f"{path}: has {len(layers)} bands; use a file with one band")
        if layers[0].kind not in ("", kind):
            raise FireModelError(
                f"{path}: contains wind {layers[0].kind}, but is specified as {kind}; interchange "
                "the files, or correct the name of the band"
            )
        found.append(layers[0])
    return WindPair(found[0], found[1], time)


def pairs_in(path: Path) -> list[WindPair]:
    """Return the winds in one file, in order. Raises FireModelError unless all bands are paired."""
    layers = wind_layers(path)
    for kinds in PAIRS:
        ones, others = ([each for each in layers if each.kind == kind] for kind in kinds)
        if not ones and not others:
            continue
        if [each.time for each in ones] != [each.time for each in others]:
            raise FireModelError(
                f"{path}: has {len(ones)} bands of {kinds[0]} and {len(others)} of {kinds[1]}, or "
                "their times differ; each time needs both"
            )
        pairs = zip(ones, others, strict=True)
        return [WindPair(one, other, one.time) for one, other in pairs]
    raise FireModelError(
        f"{path}: contains no wind bands; name them speed and direction, or u and v (in the band "
        "description; in NetCDF, as the variable)"
    )


def _timed(path: Path, pairs: list[WindPair], at_s: tuple[float, ...]) -> list[WindPair]:
    """Return the pairs with the given times if the file has none."""
    if not at_s:
        return pairs
    if any(pair.time is not None for pair in pairs):
        raise FireModelError(f"{path}: contains times; remove at_s")
    if len(at_s) != len(pairs):
        raise FireModelError(
            f"{path}: has {len(pairs)} winds, but at_s has {len(at_s)} times; specify one time "
            "for each wind"
        )
    return [pair._replace(time=time_s) for pair, time_s in zip(pairs, at_s, strict=True)]


def _seconds(pairs: Sequence[WindPair], starts: Sequence[datetime]) -> list[float]:
    """Return the pairs' times in s. Raises FireModelError unless they increase."""
    if len(pairs) == 1 and pairs[0].time is None:
        return [0.0]
    start = _start_for([pair.time for pair in pairs], starts)
    found: list[float] = []
    for pair in pairs:
        time = pair.time
        if time is None:
            raise FireModelError(
                f"{pair.one.label}: has no time; add it after the name of the band, or specify at_s"
            )
        if isinstance(time, datetime):
            assert start is not None  # because there are calendar times
            if (time.tzinfo is None) != (start.tzinfo is None):
                raise FireModelError(
                    f"{pair.one.path}: time {time.isoformat()} and start {start.isoformat()}: one "
                    "has a UTC offset, the other has none; add one to both or to neither"
                )
            time = (time - start).total_seconds()
        found.append(time)
    for pair, (before_s, after_s) in zip(pairs[1:], pairwise(found), strict=True):
        if not after_s > before_s:
            raise FireModelError(
                f"{pair.one.label}: its time, {after_s:g} s, is not later than the previous, "
                f"{before_s:g} s; sort the winds by time, and use only one height"
            )
    return found


def _start_for(times: Iterable[Time], starts: Sequence[datetime]) -> datetime | None:
    """Return the calendar time of 0 s, or None if no time is a calendar time.

    If the times have a UTC offset, the result is the first start with an offset, otherwise the
    first start without one. If there is no such start, it is the local time of the first start for
    times without an offset, and the first start for times with one. Without starts, it is the first
    of the times.
    """
    dates = [time for time in times if isinstance(time, datetime)]
    if not dates:
        return None
    aware = dates[0].tzinfo is not None
    alike = [start for start in starts if (start.tzinfo is not None) == aware]
    if alike or not starts:
        return alike[0] if alike else dates[0]
    return starts[0] if aware else starts[0].replace(tzinfo=None)


def scale_of(layer: WindLayer, files: WindFiles) -> tuple[Unit, Height]:
    """Return the unit and the height of a wind.

    Raises FireModelError if one of them is missing, or contradicts the file.
    """
    unit, height = files.unit, files.height
    if layer.unit in ("m_s", "mph", "kmh", "kts"):
        if unit not in (None, layer.unit):
            raise FireModelError(
                f"{layer.label}: its unit is {layer.unit}, not {unit}; correct the unit, or leave "
                "it out"
            )
        unit = layer.unit  # type: ignore[assignment]
    if layer.height and height not in (None, layer.height):
        raise FireModelError(f"{layer.label}: its height is {layer.height}, not {height}")
    height = layer.height or height  # type: ignore[assignment]
    if unit is None:
        raise FireModelError(f"{layer.label}: has no unit; specify m_s, mph, kmh or kts")
    if height is None:
        raise FireModelError(f'{layer.label}: has no height; specify "20ft" or "10m"')
    return unit, height
