"""Read fire detections of satellites from CSV files of FIRMS (VIIRS and MODIS). Pure.

Each line is a pixel in which the satellite detected fire: the latitude and longitude of its centre,
its size along scan and track in km, the time of the overpass (UTC) and the confidence. The fire may
burn anywhere in the pixel. Format: NASA FIRMS, "Attribute fields" of the products VNP14IMGT and
MCD14DL.
"""

import csv
import math
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from mission_service.errors import MissionServiceError
from mission_service.ground_distance import M_PER_DEG

COLUMNS = ("latitude", "longitude", "scan", "track", "acq_date", "acq_time", "confidence")
MAX_FILE_BYTES = 64_000_000
MAX_POINTS = 1000  # of one request
MAX_SOURCE, MAX_MESSAGE = 80, 200  # characters
AHEAD_S = 300.0  # tolerated difference between the clocks of satellite and service
MIN_KM, MAX_KM = 0.05, 20.0  # of a pixel's side
# Shares of false alarms that are assumed for the classes of confidence of VIIRS. With a share above
# zero a second report must confirm the place.
FALSE_ALARMS_PCT = {"low": 50.0, "nominal": 10.0, "high": 0.0}
CLASSES = {name[0]: name for name in FALSE_ALARMS_PCT}


class SatellitePixel(NamedTuple):
    """A pixel in which a satellite detected fire."""

    lat_deg: float  # of the centre
    lon_deg: float
    scan_km: float  # side across the track
    track_km: float  # side along the track
    seen: datetime
    false_alarms_pct: float
    source: str

    @property
    def position_sd_m(self) -> float:
        """The standard deviation of each axis of the fire's place, which may be anywhere inside."""
        return 1000.0 * math.sqrt((self.scan_km**2 + self.track_km**2) / 24.0)

    def corners(self) -> list[tuple[float, float]]:
        """Return latitude and longitude of the corners, for a track from south to north."""
        north = 500.0 * self.track_km / M_PER_DEG
        east = 500.0 * self.scan_km / M_PER_DEG / math.cos(math.radians(self.lat_deg))
        signs = ((-1, -1), (-1, 1), (1, 1), (1, -1))
        return [(self.lat_deg + n * north, self.lon_deg + e * east) for n, e in signs]


def read_satellite_pixels(path: Path) -> list[SatellitePixel]:
    """Read a CSV file of FIRMS.

    Raises MissionServiceError, which names the line, for a file that is not such a file.
    """
    try:
        if path.exists() and not path.is_file():
            raise MissionServiceError(f"{path}: is not a file")
        if path.stat().st_size > MAX_FILE_BYTES:
            raise MissionServiceError(f"{path}: is larger than {MAX_FILE_BYTES / 1e6:.0f} MB")
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv.DictReader(file)
            names = [name.strip().lower() for name in rows.fieldnames or ()]
            rows.fieldnames = names
            if missing := [name for name in COLUMNS if name not in names]:
                raise MissionServiceError(
                    f"{path}: has no column {', '.join(missing)}; give a CSV file of FIRMS"
                )
            return [_pixel(path, rows.line_num, row) for row in rows if not _is_blank(row)]
    except OSError as error:
        raise MissionServiceError(f"{path}: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise MissionServiceError(f"{path}: is not a CSV file: {error}") from None


def _is_blank(row: dict[str, Any]) -> bool:
    return not any(isinstance(each, str) and each.strip() for each in row.values())


def _pixel(path: Path, line: int, row: dict[str, Any]) -> SatellitePixel:
    try:
        lat_deg, lon_deg, scan_km, track_km = (float(row[name]) for name in COLUMNS[:4])
        clock = f"{row['acq_date'].strip()} {row['acq_time'].strip().replace(':', ''):0>4}"
        seen = datetime.strptime(clock, "%Y-%m-%d %H%M").replace(tzinfo=UTC)
        false_alarms_pct = _false_alarms_pct(row["confidence"].strip().lower())
    except (ValueError, TypeError, AttributeError) as error:
        raise MissionServiceError(f"{path}: line {line}: {str(error)[:MAX_MESSAGE]}") from None
    if not (abs(lat_deg) < 90.0 and abs(lon_deg) <= 180.0):
        raise MissionServiceError(f"{path}: line {line}: the place is {lat_deg}, {lon_deg}")
    if not all(MIN_KM <= side <= MAX_KM for side in (scan_km, track_km)):
        raise MissionServiceError(
            f"{path}: line {line}: the pixel is {scan_km:g} x {track_km:g} km; it must be "
            f"{MIN_KM:g} to {MAX_KM:g} km"
        )
    words = (row.get("instrument"), row.get("satellite"))
    source = " ".join(word.strip() for word in words if word and word.strip()) or "satellite"
    source = "".join(each for each in source if each.isprintable())[:MAX_SOURCE]
    return SatellitePixel(lat_deg, lon_deg, scan_km, track_km, seen, false_alarms_pct, source)


def _false_alarms_pct(confidence: str) -> float:
    """Return the share of false alarms of VIIRS' classes, or of MODIS' percentages."""
    name = CLASSES.get(confidence, confidence)
    if name in FALSE_ALARMS_PCT:
        return FALSE_ALARMS_PCT[name]
    percent = float(confidence)
    if not 0.0 <= percent <= 100.0:
        raise ValueError(f"the confidence is {confidence}")
    return min(100.0 - percent, 99.0)


def reports_of(pixels: Iterable[SatellitePixel], now: datetime) -> list[dict[str, Any]]:
    """Return the requests ``observe``, without their user, that report pixels.

    Pixels of one source, time, size and confidence are one request, or more if there are many. The
    oldest come first.

    Raises MissionServiceError for an overpass in the future.
    """
    groups: dict[tuple[Any, ...], list[SatellitePixel]] = {}
    for each in pixels:
        if (each.seen - now).total_seconds() > AHEAD_S:
            raise MissionServiceError(
                f"an overpass of {each.source} is in the future ({each.seen:%Y-%m-%d %H:%M} UTC); "
                "acq_date and acq_time must be UTC, and the clock of this computer right"
            )
        key = (each.seen, each.source, round(each.position_sd_m, 1), each.false_alarms_pct)
        groups.setdefault(key, []).append(each)
    return [
        {
            "do": "observe",
            "state": "burning",
            "shape": "points",
            "points": [(each.lat_deg, each.lon_deg) for each in group[first : first + MAX_POINTS]],
            "age_s": max((now - seen).total_seconds(), 0.0),
            "position_sd_m": sd_m,
            "false_alarms_pct": false_alarms_pct,
            "source": source,
        }
        for (seen, source, sd_m, false_alarms_pct), group in sorted(groups.items())
        for first in range(0, len(group), MAX_POINTS)
    ]


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
