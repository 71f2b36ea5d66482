"""Read satellite fire detections from FIRMS CSV files (VIIRS, MODIS and GOES). Pure.

Each line describes a pixel in which the satellite detected fire: the latitude and longitude of the
centre, the size along scan and track in km, the time of the overpass (UTC) and the confidence. The
fire may burn anywhere in the pixel. Format: NASA FIRMS, "Attribute fields" of the products
VNP14IMGT and MCD14DL. A pixel of GOES without a size is a cell of the imager's fixed grid, whose
width is 56 microradians, or 2 km on the ground directly below the satellite (GOES-R Product
Definition and Users' Guide, volume 3, 5.1.2).
"""

import csv
import math
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, date, datetime
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from mission_service.errors import MissionServiceError
from mission_service.ground_distance import M_PER_DEG, distance_m

PLACE, SIZE = ("latitude", "longitude"), ("scan", "track")
COLUMNS = (*PLACE, "acq_date", "acq_time", "confidence")
MAX_FILE_BYTES = 64_000_000
MAX_PIXELS = 100_000  # per file, on the landscape
MAX_POINTS = 1000  # per request
MAX_SOURCE, MAX_MESSAGE = 80, 200  # characters
AHEAD_S = 300.0  # tolerated difference between the clocks of the satellite and the service
MIN_KM, MAX_KM = 0.05, 20.0  # limits for a pixel's side
# Assumed fractions of false alarms for the confidence classes of VIIRS. If the fraction is above
# zero, positions far from the estimated fire require a second report.
FALSE_ALARMS_PCT = {"low": 50.0, "nominal": 10.0, "high": 0.0}
CLASSES = {name[0]: name for name in FALSE_ALARMS_PCT}
# The same for the last digits of the codes 10 to 15 and 30 to 35 of the GOES fire mask: processed,
# saturated, cloudy, and high, medium and low probability. The codes from 30 on are confirmed by
# earlier or later detections. No code is certain.
GOES_FALSE_ALARMS_PCT = {0: 10.0, 1: 10.0, 2: 30.0, 3: 30.0, 4: 50.0, 5: 70.0}
GOES_LON_DEG = {"16": -75.2, "17": -137.2, "18": -137.2, "19": -75.2}
GOES_HEIGHT_M, GOES_CELL_RAD = 35_786_023.0, 56e-6
World = tuple[float, float, float, float]  # south, west, north, east
WORLD: World = (-90.0, -180.0, 90.0, 180.0)


class SatellitePixel(NamedTuple):
    """A pixel in which a satellite detected fire."""

    lat_deg: float  # of the centre
    lon_deg: float
    scan_km: float  # side across the track
    track_km: float  # side along the track
    seen: datetime
    false_alarms_pct: float
    source: str
    grid_lon_deg: float | None = None  # of the satellite, if the pixel is in its fixed grid

    @property
    def position_sd_m(self) -> float:
        """The standard deviation, along each axis, of a fire's position anywhere in the pixel."""
        return 1000.0 * math.sqrt((self.scan_km**2 + self.track_km**2) / 24.0)

    def corners(self) -> list[tuple[float, float]]:
        """Return latitude and longitude of the corners, for a track from south to north."""
        if self.grid_lon_deg is not None:
            return _grid_corners(self.lat_deg, self.lon_deg, self.grid_lon_deg)
        north = 500.0 * self.track_km / M_PER_DEG
        east = 500.0 * self.scan_km / M_PER_DEG / math.cos(math.radians(self.lat_deg))
        signs = ((-1, -1), (-1, 1), (1, 1), (1, -1))
        return [(self.lat_deg + n * north, self.lon_deg + e * east) for n, e in signs]


class SatelliteFile(NamedTuple):
    """The pixels of a file within a box, and the number of lines of the file after its header."""

    pixels: list[SatellitePixel]
    lines: int


def read_satellite_pixels(path: Path, within: World = WORLD) -> SatelliteFile:
    """Read a FIRMS CSV file.

    For lines outside the box ``within`` (south, west, north, east, in degrees), only the position
    is read. Raises MissionServiceError, whose text names the file and the damaged line, if the file
    is not a valid FIRMS CSV file.
    """
    try:
        if path.exists() and not path.is_file():
            raise MissionServiceError(f"{path}: is not a file")
        if path.stat().st_size > MAX_FILE_BYTES:
            raise MissionServiceError(f"{path}: is larger than {MAX_FILE_BYTES / 1e6:.0f} MB")
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv.reader(file)
            names = [name.strip().lower() for name in next(rows, [])]
            if not is_satellite(names):
                missing = [name for name in COLUMNS if name not in names]
                raise MissionServiceError(
                    f"{path}: has no column {', '.join(missing)}; use a CSV file of FIRMS"
                )
            return _within(path, rows, names, within)
    except OSError as error:
        raise MissionServiceError(f"{path}: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise MissionServiceError(f"{path}: is not a CSV file: {error}") from None


def is_satellite(names: Iterable[str]) -> bool:
    """Return True if the lower-case column names include those of FIRMS."""
    return set(COLUMNS) <= set(names)


def _within(path: Path, rows: Any, names: list[str], within: World) -> SatelliteFile:
    """Return the pixels in the rows of a CSV file. For speed, only the position is read first."""
    south, west, north, east = within
    lat_column, lon_column = (names.index(name) for name in PLACE)
    pixels, lines = [], 0
    for row in rows:
        try:
            lat_deg, lon_deg = float(row[lat_column]), float(row[lon_column])
        except (ValueError, IndexError) as error:
            if not any(map(str.strip, row)):
                continue
            where = f"{path}: line {rows.line_num}"
            raise MissionServiceError(f"{where}: {str(error)[:MAX_MESSAGE]}") from None
        lines += 1
        elsewhere = lat_deg < south or lat_deg > north or lon_deg < west or lon_deg > east
        if not elsewhere or not (abs(lat_deg) < 90.0 and abs(lon_deg) <= 180.0):
            where = f"{path}: line {rows.line_num}"
            pixels.append(pixel_of(dict(zip(names, row, strict=False)), where))
        if len(pixels) > MAX_PIXELS:
            raise MissionServiceError(f"{path}: more than {MAX_PIXELS} pixels on the landscape")
    return SatelliteFile(pixels, lines)


def pixel_of(values: Mapping[str, Any], where: str) -> SatellitePixel:
    """Return the pixel of a line or a feature from its values by lower-case name.

    Raises MissionServiceError, whose text begins with ``where``.
    """
    words = (_word(values, name) for name in ("instrument", "satellite"))
    source = " ".join(word for word in words if word) or "satellite"
    source = "".join(each for each in source if each.isprintable())[:MAX_SOURCE]
    try:
        lat_deg, lon_deg = (float(values[name]) for name in PLACE)
        day, clock = _word(values, "acq_date"), _word(values, "acq_time").replace(":", "")
        seen = datetime.strptime(f"{day[:10]} {clock:0>4}", "%Y-%m-%d %H%M").replace(tzinfo=UTC)
        goes_lon_deg = _goes_lon_deg(_word(values, "satellite"))
        false_alarms_pct = _false_alarms_pct(
            _word(values, "confidence").lower(), goes_lon_deg is not None
        )
        if goes_lon_deg is not None and not _word(values, "scan"):
            scan_km, track_km = _grid_size_km(lat_deg, lon_deg, goes_lon_deg)
        else:
            goes_lon_deg = None
            scan_km, track_km = (float(values[name]) for name in SIZE)
    except KeyError as error:
        raise MissionServiceError(f"{where}: has no {error.args[0]}") from None
    except (ValueError, TypeError) as error:
        raise MissionServiceError(f"{where}: {str(error)[:MAX_MESSAGE]}") from None
    if not (abs(lat_deg) < 90.0 and abs(lon_deg) <= 180.0):
        raise MissionServiceError(f"{where}: the position is {lat_deg}, {lon_deg}")
    if not all(MIN_KM <= side <= MAX_KM for side in (scan_km, track_km)):
        raise MissionServiceError(
            f"{where}: the pixel is {scan_km:g} x {track_km:g} km; it must be "
            f"{MIN_KM:g} to {MAX_KM:g} km"
        )
    return SatellitePixel(
        lat_deg, lon_deg, scan_km, track_km, seen, false_alarms_pct, source, goes_lon_deg
    )


def _word(values: Mapping[str, Any], name: str) -> str:
    value = values.get(name)
    if isinstance(value, date):
        return value.isoformat()
    return "" if value is None else str(value).strip()


def _goes_lon_deg(satellite: str) -> float | None:
    """Return the longitude of a GOES satellite, such as G16 or GOES-16; None for others."""
    name = satellite.upper().replace("GOES", "G").replace("-", "").replace(" ", "")
    return GOES_LON_DEG.get(name[1:]) if name.startswith("G") else None


@lru_cache(maxsize=4)
def _fixed_grid(grid_lon_deg: float) -> Any:
    from pyproj import Transformer

    crs = f"+proj=geos +h={GOES_HEIGHT_M:.0f} +lon_0={grid_lon_deg} +sweep=x +ellps=GRS80"
    return Transformer.from_crs("EPSG:4326", crs, always_xy=True)


def _grid_corners(lat_deg: float, lon_deg: float, grid_lon_deg: float) -> list[tuple[float, float]]:
    """Return the corners of a fixed-grid cell as latitude and longitude.

    Raises ValueError for a position that is not visible from the satellite.
    """
    grid, half_m = _fixed_grid(grid_lon_deg), 0.5 * GOES_CELL_RAD * GOES_HEIGHT_M
    x_m, y_m = grid.transform(lon_deg, lat_deg)
    found = []
    for north, east in ((-1, -1), (-1, 1), (1, 1), (1, -1)):
        lon, lat = grid.transform(x_m + east * half_m, y_m + north * half_m, direction="INVERSE")
        found.append((float(lat), float(lon)))
    if not all(math.isfinite(each) for corner in found for each in corner):
        raise ValueError("this position is outside the satellite's field of view")
    return found


def _grid_size_km(lat_deg: float, lon_deg: float, grid_lon_deg: float) -> tuple[float, float]:
    south_west, south_east, north_east, _ = _grid_corners(lat_deg, lon_deg, grid_lon_deg)
    return (
        distance_m(south_west, south_east) / 1e3,
        distance_m(south_east, north_east) / 1e3,
    )


def _false_alarms_pct(confidence: str, goes: bool) -> float:
    """Return the fraction of false alarms for a class, a GOES code or a MODIS percentage."""
    name = CLASSES.get(confidence, confidence)
    if name in FALSE_ALARMS_PCT:
        return max(FALSE_ALARMS_PCT[name], GOES_FALSE_ALARMS_PCT[0] if goes else 0.0)
    if goes:
        tens, ones = divmod(int(confidence), 10)
        if tens not in (1, 3) or ones not in GOES_FALSE_ALARMS_PCT:
            raise ValueError(f"the confidence is {confidence}; use a class or a GOES fire code")
        return GOES_FALSE_ALARMS_PCT[ones]
    percent = float(confidence)
    if not 0.0 <= percent <= 100.0:
        raise ValueError(f"the confidence is {confidence}")
    return min(100.0 - percent, 99.0)


class PixelGroup(NamedTuple):
    """Pixels with equal time, source, size and confidence."""

    seen: datetime
    source: str
    position_sd_m: float
    false_alarms_pct: float
    points: list[tuple[float, float]]  # latitude and longitude, at most ``MAX_POINTS``


def groups_of(pixels: Iterable[SatellitePixel]) -> Iterator[PixelGroup]:
    """Yield groups of pixels; the oldest come first."""
    groups: dict[tuple[datetime, str, float, float], list[tuple[float, float]]] = {}
    for each in pixels:
        key = (each.seen, each.source, round(each.position_sd_m, 1), each.false_alarms_pct)
        groups.setdefault(key, []).append((each.lat_deg, each.lon_deg))
    for key, points in sorted(groups.items()):
        for first in range(0, len(points), MAX_POINTS):
            yield PixelGroup(*key, points[first : first + MAX_POINTS])


def reports_of(pixels: Iterable[SatellitePixel], now: datetime) -> list[dict[str, Any]]:
    """Return the ``observe`` requests that report pixels, without the user's name.

    There is one request for each group of pixels (``groups_of``). Raises MissionServiceError for an
    overpass in the future.
    """
    found = []
    for each in groups_of(pixels):
        if (each.seen - now).total_seconds() > AHEAD_S:
            raise MissionServiceError(
                f"an overpass of {each.source} is in the future ({each.seen:%Y-%m-%d %H:%M} UTC); "
                "acq_date and acq_time must be UTC; also check the clock of this computer"
            )
        found.append(
            {
                "do": "observe",
                "state": "burning",
                "shape": "points",
                "points": each.points,
                "age_s": max((now - each.seen).total_seconds(), 0.0),
                "position_sd_m": each.position_sd_m,
                "false_alarms_pct": each.false_alarms_pct,
                "source": each.source,
            }
        )
    return found


def footprints(pixels: Iterable[SatellitePixel]) -> dict[str, Any]:
    """Return the footprints of pixels as a GeoJSON FeatureCollection."""
    features = [
        {
            "type": "Feature",
            "geometry": {
                "type": "Polygon",
                "coordinates": [[[lon, lat] for lat, lon in (*each.corners(), each.corners()[0])]],
            },
            "properties": {
                "datetime": each.seen.isoformat(),
                "source": each.source,
                "false_alarms_pct": each.false_alarms_pct,
            },
        }
        for each in pixels
    ]
    return {"type": "FeatureCollection", "features": features}
