"""Encodes vehicles, missions, the fire and alarms as Cursor on Target events for TAK. Pure.

TAK stands for ATAK, WinTAK or TAK Server. The format follows MITRE, *Cursor-on-Target Message
Router User's Guide* (base event 2.0), and ATAK's drawn shapes (``u-d-f``: a closed line of ``link``
points).

``hae`` is the height above the ellipsoid, but autopilots report heights above mean sea level. The
difference, up to 100 m, is not available, so ``hae`` is sent as unknown and the remarks contain the
heights.
"""

import re
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any, NamedTuple
from xml.etree import ElementTree

from shapely import get_parts
from shapely.geometry import LineString, Point, Polygon, shape

from mission_service.runtime.published_states import MissionState, TelemetryState

# Friendly drones: fixed wing (including VTOLs), rotary wing.
TYPES = {"plane": "a-f-A-M-F-Q", "vtol": "a-f-A-M-F-Q", "copter": "a-f-A-M-H-Q"}
DRAWN, CHAT, PING = "u-d-f", "b-t-f", "t-x-c-t"
PONG = re.compile(rb"type=[\"']t-x-c-t-r[\"']")  # an answer to a ping
# Source of a position: measured; simulated or computed; typed by a person.
MACHINE_GPS, MADE_UP, TYPED = "m-g", "m-s", "h-g-i-g-o"
UNKNOWN_M = "9999999.0"
POSITION_ERROR_M = "10.0"
MAX_CORNERS = 250  # an event must fit into one datagram
MAX_AREAS, MAX_FORECAST_AREAS = 20, 5
CHAT_STALE_US, PING_STALE_US = 86_400_000_000, 20_000_000
RED, FAINT_RED = "-65536", "1090453504"  # ARGB as a signed integer
ORANGE, BLUE = "-29696", "-16744193"
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def zulu(unix_us: int) -> str:
    """Return a time in Cursor on Target format: 2026-11-22T00:30:00.000Z."""
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
    heights = f"{fix.altitude_amsl_m:.0f} m above sea level"
    if fix.height_agl_m is not None:
        heights += f", {fix.height_agl_m:.0f} m above ground"
    ElementTree.SubElement(detail, "remarks").text = heights
    return ElementTree.tostring(event)


def fire_events(front: dict[str, Any], site: str, unix_us: int, stale_us: int) -> Iterator[bytes]:
    """Yield the burned area (a GeoJSON Feature) as drawn shapes, one for each of its largest parts.

    The shapes omit unburned islands. Outlines with more than ``MAX_CORNERS`` corners are
    simplified.
    """
    areas = _largest_first(front)
    remarks = (
        f"{front['properties']['area_ha']:.1f} ha burned in {len(areas)} areas, from the model"
    )
    for number, area in enumerate(areas[:MAX_AREAS], start=1):
        line = CotLine(f"fire.{number}", f"Fire {number}", area.exterior, RED, FAINT_RED, remarks)
        yield _line_event(line, site, unix_us, stale_us)


def forecast_events(
    fronts: Sequence[dict[str, Any]], site: str, unix_us: int, stale_us: int
) -> Iterator[bytes]:
    """Yield expected fronts (GeoJSON Features with ``in_s``) as outlines of their largest parts."""
    for front in fronts:
        minutes = round(front["properties"]["in_s"] / 60.0)
        remarks = f"expected front in {minutes} min, {front['properties']['area_ha']:.1f} ha"
        for number, area in enumerate(_largest_first(front)[:MAX_FORECAST_AREAS], start=1):
            uid = f"forecast.{minutes}.{number}"
            title = f"Fire in {minutes} min"
            line = CotLine(uid, title, area.exterior, ORANGE, "", remarks)
            yield _line_event(line, site, unix_us, stale_us)


def mission_event(state: MissionState, site: str, unix_us: int, stale_us: int) -> bytes | None:
    """Return the mission on board a vehicle as a line, or None for fewer than two places."""
    items = () if state.on_board is None else state.on_board.items
    places = [
        (each.lon_deg, each.lat_deg)
        for each in items
        if each.lon_deg is not None and each.lat_deg is not None
    ]
    if len(set(places)) < 2:
        return None
    name = state.vehicle
    line = CotLine(f"{name}.mission", f"{name} mission", LineString(places), BLUE, "", "on board")
    return _line_event(line, site, unix_us, stale_us)


def chat_event(text: str, site: str, message_id: str, unix_us: int) -> bytes:
    """Return a chat message from the service to all chat rooms; ``message_id`` makes it unique."""
    sender, room = f"{site}.service", "All Chat Rooms"
    uid = f"GeoChat.{sender}.{room}.{message_id}"
    event = _event(uid, CHAT, TYPED, unix_us, CHAT_STALE_US)
    _point(event, 0.0, 0.0)
    detail = ElementTree.SubElement(event, "detail")
    about = {
        "parent": "RootContactGroup",
        "groupOwner": "false",
        "messageId": message_id,
        "chatroom": room,
        "id": room,
        "senderCallsign": site,
    }
    chat = ElementTree.SubElement(detail, "__chat", about)
    ElementTree.SubElement(chat, "chatgrp", uid0=sender, uid1=room, id=room)
    ElementTree.SubElement(detail, "link", uid=sender, type="a-f-G-I-U-T", relation="p-p")
    remarks = {"source": f"BAO.F.ATAK.{sender}", "to": room, "time": zulu(unix_us)}
    ElementTree.SubElement(detail, "remarks", remarks).text = text
    return ElementTree.tostring(event)


def ping_event(unix_us: int) -> bytes:
    """Return a ping, which TAK servers answer but do not forward."""
    event = _event("mission-service-ping", PING, MACHINE_GPS, unix_us, PING_STALE_US)
    _point(event, 0.0, 0.0)
    return ElementTree.tostring(event)


class CotLine(NamedTuple):
    """A line or an outline (longitude, latitude) with its colours; ``fill`` may be empty."""

    uid: str  # follows the site's name
    title: str
    line: LineString
    colour: str
    fill: str
    remarks: str


def _line_event(line: CotLine, site: str, unix_us: int, stale_us: int) -> bytes:
    event = _event(f"{site}.{line.uid}", DRAWN, MADE_UP, unix_us, stale_us)
    places = _few_corners(line.line)
    middle = Polygon(places).representative_point() if line.line.is_ring else Point(places[0])
    _point(event, middle.y, middle.x)
    detail = ElementTree.SubElement(event, "detail")
    for lon_deg, lat_deg in places:
        ElementTree.SubElement(detail, "link", point=f"{lat_deg:.6f},{lon_deg:.6f}")
    ElementTree.SubElement(detail, "strokeColor", value=line.colour)
    ElementTree.SubElement(detail, "strokeWeight", value="3.0")
    if line.fill:
        ElementTree.SubElement(detail, "fillColor", value=line.fill)
    ElementTree.SubElement(detail, "contact", callsign=line.title)
    ElementTree.SubElement(detail, "remarks").text = line.remarks
    return ElementTree.tostring(event)


def _largest_first(front: dict[str, Any]) -> list[Polygon]:
    return sorted(get_parts(shape(front["geometry"])), key=lambda area: -area.area)


def _event(uid: str, kind: str, how: str, unix_us: int, stale_us: int) -> ElementTree.Element:
    now, end = zulu(unix_us), zulu(unix_us + stale_us)
    attributes = {"version": "2.0", "uid": uid, "type": kind, "how": how}
    return ElementTree.Element("event", attributes | {"time": now, "start": now, "stale": end})


def _point(event: ElementTree.Element, lat_deg: float, lon_deg: float) -> None:
    position = {"lat": f"{lat_deg:.7f}", "lon": f"{lon_deg:.7f}"}
    errors = {"hae": UNKNOWN_M, "ce": POSITION_ERROR_M, "le": UNKNOWN_M}
    ElementTree.SubElement(event, "point", position | errors)


def _few_corners(line: LineString) -> list[tuple[float, float]]:
    """Return the vertices (lon, lat) of a line, simplified to at most ``MAX_CORNERS``."""
    corners, tolerance_deg = line.coords, 1e-6
    while len(corners) > MAX_CORNERS:
        corners = line.simplify(tolerance_deg).coords
        tolerance_deg *= 2.0
    return [(x, y) for x, y, *_ in corners]
