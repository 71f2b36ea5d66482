"""Reads closed volumes from files: GeoJSON, KML, KMZ, zipped Shapefiles and OpenAir."""

import io
import math
import re
from pathlib import Path
from typing import Any

import shapely
from pydantic import ValidationError

from firemodel.errors import FireModelError
from mission_service.config.airspace_section import ClosedVolume
from mission_service.errors import ScenarioError
from mission_service.ground_distance import M_PER_FT, M_PER_NMI, offset_m, place_at
from mission_service.uploaded_shapes import features_in

ARC_STEP_DEG = 5.0
LIMITS = ("floor_amsl_m", "floor_agl_m", "ceiling_amsl_m", "ceiling_agl_m", "from_s", "until_s")
ALTITUDE = re.compile(
    r"^(?:(FL)\s*(\d+)|(\d+(?:\.\d+)?)\s*(FT|F|M)?\s*(AGL|GND|ASFC|SFC|AMSL|MSL|ALT)?)$"
)
LatLon = tuple[float, float]


def volumes_in(path: Path) -> list[ClosedVolume]:
    """Return the closed volumes in a file; the format is detected.

    A GeoJSON feature may have the property ``name`` and those in ``LIMITS``, with the same meaning
    as in the scenario. KML has no limits: its volumes start at the ground and have no ceiling.
    Raises ScenarioError with the file and the reason.
    """
    try:
        data = path.read_bytes()
        text = data.decode("utf-8-sig", errors="replace")
        if re.search(r"^\s*AC\s", text, re.MULTILINE) and not text.lstrip().startswith(("{", "<")):
            return _from_openair(text, path)
        return _from_features(data, path)
    except (OSError, FireModelError) as error:
        raise ScenarioError(f"airspace: {error}") from None


def _from_features(data: bytes, path: Path) -> list[ClosedVolume]:
    found = []
    for number, drawn in enumerate(features_in(data, str(path)), start=1):
        name = str(drawn.attributes.get("name") or f"{path.stem} {number}")
        limits = {key: drawn.attributes[key] for key in LIMITS if key in drawn.attributes}
        polygons = [
            part for part in shapely.get_parts(drawn.shape) if isinstance(part, shapely.Polygon)
        ]
        if not polygons:
            raise ScenarioError(
                f"airspace: {path}: feature {number} ({name}) is not a polygon; draw it as a "
                "polygon"
            )
        for part_number, polygon in enumerate(polygons, start=1):
            own = name if len(polygons) == 1 else f"{name} ({part_number})"
            # Holes count as closed too, so that the volume is never too small.
            corners = [(lat, lon) for lon, lat in polygon.exterior.coords[:-1]]
            found.append(_volume(path, own, corners, limits))
    return found


def _volume(path: Path, name: str, corners: list[LatLon], limits: dict[str, Any]) -> ClosedVolume:
    try:
        return ClosedVolume(name=name, corners=tuple(corners), **limits)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "limits"
        problem = first["msg"].removeprefix("Value error, ")
        line = " ".join(name.split())
        raise ScenarioError(f"airspace: {path}: {line}: {where}: {problem}") from None


def _from_openair(text: str, path: Path) -> list[ClosedVolume]:
    """Return the airspaces in an OpenAir file, each with its class in the name."""
    from aerofiles.openair import Reader

    found: list[ClosedVolume] = []
    for record, error in Reader(io.StringIO(text)):
        if error:
            raise ScenarioError(f"airspace: {path}: {' '.join(str(error).split())}")
        if record["type"] != "airspace":
            continue
        name = f"{record['name'] or path.stem} ({record['class']})"
        names = {each.name for each in found}
        count = 2
        while name in names:
            name, count = f"{record['name']} ({record['class']}) {count}", count + 1
        limits: dict[str, Any] = {}
        _set_limit(limits, "floor", record["floor"], f"{path}: {name}")
        _set_limit(limits, "ceiling", record["ceiling"], f"{path}: {name}")
        found.append(_volume(path, name, _corners(record["elements"], f"{path}: {name}"), limits))
    if not found:
        raise ScenarioError(f"airspace: {path}: contains no airspace (no block begins with AC)")
    return found


def _set_limit(limits: dict[str, Any], side: str, text: str | None, where: str) -> None:
    """Set a limit from OpenAir text such as ``1500 ft AGL``, ``FL 65``, ``SFC`` or ``UNLIM``."""
    words = (text or "").strip().upper()
    if words in ("", "SFC", "GND", "0", "UNL", "UNLIM", "UNLIMITED"):
        unlimited = words.startswith("UNL")
        if (side == "floor") == unlimited and words:
            raise ScenarioError(f"airspace: {where}: {side} {text!r}: this leaves no volume")
        return
    match = ALTITUDE.match(words)
    if match is None:
        raise ScenarioError(
            f"airspace: {where}: {side} {text!r} is not an altitude; write it as 1500 ft AMSL, "
            "500 ft AGL or FL 65"
        )
    level, hundreds, number, unit, reference = match.groups()
    if level:
        limits[f"{side}_amsl_m"] = float(hundreds) * 100.0 * M_PER_FT
        return
    value_m = float(number) * (1.0 if unit == "M" else M_PER_FT)
    agl = reference in ("AGL", "GND", "ASFC", "SFC")
    limits[f"{side}_{'agl' if agl else 'amsl'}_m"] = value_m


def _corners(elements: list[dict[str, Any]], where: str) -> list[LatLon]:
    """Return the corners (lat, lon) of an outline of points, arcs and circles."""
    corners: list[LatLon] = []
    for element in elements:
        kind = element["type"]
        if kind == "point":
            corners.append((element["location"][0], element["location"][1]))
        elif kind == "circle":
            # The polygon encloses the circle.
            radius_m = element["radius"] * M_PER_NMI / math.cos(math.radians(ARC_STEP_DEG / 2))
            turns = range(int(360 / ARC_STEP_DEG))
            corners += [_ahead(element["center"], turn * ARC_STEP_DEG, radius_m) for turn in turns]
        elif kind == "arc":
            corners += _arc(element)
        else:
            raise ScenarioError(f"airspace: {where}: {kind} is not supported; draw it as points")
    return corners


def _arc(element: dict[str, Any]) -> list[LatLon]:
    """Return points on an arc (``DA``: angles, ``DB``: start and end), including both ends."""
    centre, clockwise = element["center"], element["clockwise"]
    if "radius" in element:
        begin_deg, end_deg = element["start"], element["end"]
        begin_m = end_m = element["radius"] * M_PER_NMI
    else:
        begin_deg, begin_m = _bearing(centre, element["start"])
        end_deg, end_m = _bearing(centre, element["end"])
    turn_deg = (end_deg - begin_deg) % 360.0 if clockwise else -((begin_deg - end_deg) % 360.0)
    steps = max(1, math.ceil(abs(turn_deg) / ARC_STEP_DEG))
    return [
        _ahead(
            centre,
            begin_deg + turn_deg * step / steps,
            begin_m + (end_m - begin_m) * step / steps,
        )
        for step in range(steps + 1)
    ]


def _ahead(centre: LatLon, bearing_deg: float, distance_m: float) -> LatLon:
    bearing_rad = math.radians(bearing_deg)
    return place_at(centre, distance_m * math.cos(bearing_rad), distance_m * math.sin(bearing_rad))


def _bearing(centre: LatLon, place: LatLon) -> tuple[float, float]:
    """Return the bearing (degrees) and distance (m) of a place from a centre."""
    north_m, east_m = offset_m(centre, place)
    return math.degrees(math.atan2(east_m, north_m)), math.hypot(east_m, north_m)
