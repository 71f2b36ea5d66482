"""Encodes vehicles and the fire as Cursor on Target events for TAK. Pure.

TAK stands for ATAK, WinTAK or TAK Server. The format is that of MITRE, *Cursor-on-Target Message
Router User's Guide* (base event 2.0), and of the drawn shapes of ATAK (``u-d-f``: a closed line of
``link`` points).

``hae`` is the height above the ellipsoid, but autopilots report heights above mean sea level. The
difference, up to 100 m, is not available, so ``hae`` is sent as unknown and the remarks contain the
heights.
"""

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from typing import Any
from xml.etree import ElementTree

from shapely import get_parts
from shapely.geometry import Polygon, shape

from mission_service.runtime.published_states import TelemetryState

# Friendly drones: fixed wing (also VTOLs), rotary wing.
TYPES = {"plane": "a-f-A-M-F-Q", "vtol": "a-f-A-M-F-Q", "copter": "a-f-A-M-H-Q"}
DRAWN = "u-d-f"
MACHINE_GPS, MADE_UP = "m-g", "m-s"  # source of a position: measured; simulated or computed
UNKNOWN_M = "9999999.0"
POSITION_ERROR_M = "10.0"
MAX_CORNERS = 250  # an event must fit into one datagram
MAX_AREAS = 20
RED, FAINT_RED = "-65536", "1090453504"  # ARGB as a signed integer
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def zulu(unix_us: int) -> str:
    """Return a time in the format of Cursor on Target: 2026-11-22T00:30:00.000Z."""
    when = _EPOCH + timedelta(microseconds=unix_us)
    return f"{when:%Y-%m-%dT%H:%M:%S}.{when.microsecond // 1000:03d}Z"


def vehicle_event(fix: TelemetryState, kind: str, site: str, unix_us: int, stale_us: int) -> bytes:
    """Return the event for a vehicle's position at ``unix_us``, valid for ``stale_us``."""
    event = _event(f"{site}.{fix.vehicle}", TYPES[kind], MACHINE_GPS, unix_us, stale_us)
    _point(event, fix.lat_deg, fix.lon_deg)
    detail = ElementTree.SubElement(event, "detail")
    ElementTree.SubElement(detail, "contact", callsign=fix.vehicle)
    ElementTree.SubElement(
        detail, "track", course=f"{fix.track_deg:.1f}", speed=f"{fix.ground_speed_m_s:.2f}"
    )
    heights = f"{fix.altitude_amsl_m:.0f} m above the sea"
    if fix.height_agl_m is not None:
        heights += f", {fix.height_agl_m:.0f} m above ground"
    ElementTree.SubElement(detail, "remarks").text = heights
    return ElementTree.tostring(event)


def fire_events(front: dict[str, Any], site: str, unix_us: int, stale_us: int) -> Iterator[bytes]:
    """Yield the burned area (a GeoJSON Feature) as drawn shapes, one for each of its largest parts.

    The shapes omit unburned islands. Outlines with more than ``MAX_CORNERS`` corners are
    simplified.
    """
    areas = sorted(get_parts(shape(front["geometry"])), key=lambda area: -area.area)
    area_ha = front["properties"]["area_ha"]
    for number, area in enumerate(areas[:MAX_AREAS], start=1):
        event = _event(f"{site}.fire.{number}", DRAWN, MADE_UP, unix_us, stale_us)
        middle = area.representative_point()
        _point(event, middle.y, middle.x)
        detail = ElementTree.SubElement(event, "detail")
        for lon_deg, lat_deg in _few_corners(area):
            ElementTree.SubElement(detail, "link", point=f"{lat_deg:.6f},{lon_deg:.6f}")
        ElementTree.SubElement(detail, "strokeColor", value=RED)
        ElementTree.SubElement(detail, "strokeWeight", value="3.0")
        ElementTree.SubElement(detail, "fillColor", value=FAINT_RED)
        ElementTree.SubElement(detail, "contact", callsign=f"Fire {number}")
        remarks = f"{area_ha:.1f} ha burned in {len(areas)} areas, by the model"
        ElementTree.SubElement(detail, "remarks").text = remarks
        yield ElementTree.tostring(event)


def _event(uid: str, kind: str, how: str, unix_us: int, stale_us: int) -> ElementTree.Element:
    now, end = zulu(unix_us), zulu(unix_us + stale_us)
    attributes = {"version": "2.0", "uid": uid, "type": kind, "how": how}
    return ElementTree.Element("event", attributes | {"time": now, "start": now, "stale": end})


def _point(event: ElementTree.Element, lat_deg: float, lon_deg: float) -> None:
    position = {"lat": f"{lat_deg:.7f}", "lon": f"{lon_deg:.7f}"}
    errors = {"hae": UNKNOWN_M, "ce": POSITION_ERROR_M, "le": UNKNOWN_M}
    ElementTree.SubElement(event, "point", position | errors)


def _few_corners(area: Polygon) -> list[tuple[float, float]]:
    """Return the closed outer ring, (lon, lat), simplified to at most ``MAX_CORNERS`` corners."""
    corners, tolerance_deg = area.exterior.coords, 1e-6
    while len(corners) > MAX_CORNERS:
        corners = area.exterior.simplify(tolerance_deg).coords
        tolerance_deg *= 2.0
    return [(x, y) for x, y, *_ in corners]
