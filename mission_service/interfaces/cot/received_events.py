"""Reads received Cursor on Target events: XML, and protobuf of TAK protocol version 1. Pure.

The parts of events are those that ATAK, WinTAK and iTAK send:

- ``a-…`` with ``__group``: the position of a user, with team colour and role;
- markers (``a-…``, ``b-m-p-…``) and drawn shapes: ``u-d-f`` (lines and polygons), ``u-d-r``
  (rectangles), ``u-d-c-c`` (circles), ``u-d-f-m`` (telestrations: the text of an event for each
  stroke);
- ``creator`` or ``link`` with the relation ``p-p``: the user who made a marker or shape, and the
  time of creation. A shape contains no group; the group of its creator applies.

``time`` is the time at which an event was sent. A client sends an unchanged shape again with a new
time.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from mission_service.errors import MissionServiceError
from mission_service.ground_distance import M_PER_DEG
from mission_service.interfaces.cot.cot_events import zulu
from mission_service.interfaces.cot.event_framing import MAX_EVENT_BYTES
from mission_service.surveillance.cot_tracks import unix_us_of

MESH_HEADER = b"\xbf\x01\xbf"  # begins a datagram of TAK protocol version 1
UNKNOWN_ERROR_M = 9_999_999.0  # ``ce`` of positions without a known error
MAX_TEXT = 200  # longer identifiers and titles are refused
ELLIPSE_CORNERS = 36
MAX_RADIUS_M = 100_000.0
MAX_STROKES = 20
LINES, CIRCLE, STROKES = ("u-d-f", "u-d-r"), "u-d-c-c", "u-d-f-m"

LatLon = tuple[float, float]  # degrees


class CotEventError(MissionServiceError):
    """An event cannot be read or used; the message states the reason."""


class Creator(NamedTuple):
    """The user who made a marker or a shape, and the time of creation, if known."""

    uid: str
    callsign: str
    created_unix_us: int | None


class CotEvent(NamedTuple):
    """A received event.

    ``group`` and ``role`` are empty if the event is not the position of a user. ``title`` is the
    name of a marker or shape, or the callsign of a user. ``error_m`` is the standard deviation of
    the position, or None.
    """

    uid: str
    kind: str  # such as "u-d-f"
    sent_unix_us: int
    title: str
    error_m: float | None
    group: str
    role: str
    creator: Creator | None
    root: Element

    @property
    def is_user(self) -> bool:
        """Whether the event is the position of a user."""
        return self.kind.startswith("a-") and self.group != ""


def parse_event(data: bytes) -> CotEvent | None:
    """Return the event in an XML text or in a datagram of TAK protocol version 1.

    Returns None for a datagram that only announces the protocol versions of a client. Raises
    CotEventError for other data that are not a readable event.
    """
    if len(data) > MAX_EVENT_BYTES:
        raise CotEventError(f"an event has more than {MAX_EVENT_BYTES} bytes")
    root = _from_protobuf(data) if data.startswith(MESH_HEADER) else _from_xml(data)
    if root is None:
        return None
    if root.tag != "event":
        raise CotEventError("an event cannot be read: its root element is not <event>")
    uid, kind = (_text(root, key) for key in ("uid", "type"))
    if not uid or not kind:
        raise CotEventError("an event has no uid or no type")
    detail, point = _child(root, "detail"), _child(root, "point")
    group = _child(detail, "__group")
    error_m = _number(point, "ce") if "ce" in point.attrib else UNKNOWN_ERROR_M
    return CotEvent(
        uid,
        kind,
        _unix_us(_text(root, "time"), uid),
        _text(_child(detail, "contact"), "callsign"),
        error_m if 0.0 < error_m < UNKNOWN_ERROR_M else None,
        _text(group, "name"),
        _text(group, "role"),
        _creator_in(detail, uid),
        root,
    )


class Drawing(NamedTuple):
    """One shape (``points``, ``line`` or ``polygon``) of an event, with its positions."""

    shape: str
    points: tuple[LatLon, ...]


def drawings_in(event: CotEvent) -> list[Drawing]:
    """Return the shapes of an event: one, or each stroke of a telestration as a line.

    A line that ends at its first position is a polygon. Of the rings of a circle, only the largest
    is used. Raises CotEventError for other drawings, and for positions that are not on the Earth.
    """
    detail = _child(event.root, "detail")
    if event.kind == CIRCLE:
        return [Drawing("polygon", _ellipse(place_of(event), detail))]
    if event.kind in LINES:
        places = _line_in(detail)
        is_closed = len(places) > 3 and places[0] == places[-1]
        return [Drawing("polygon" if event.kind == "u-d-r" or is_closed else "line", places)]
    if event.kind == STROKES:
        strokes = [link.get("line", "") for link in detail.findall("link") if "line" in link.attrib]
        if len(strokes) > MAX_STROKES:
            raise CotEventError(f"it has {len(strokes)} strokes; the limit is {MAX_STROKES}")
        inner = [_child(_from_xml(each.encode()), "detail") for each in strokes]
        return [Drawing("line", _line_in(each)) for each in inner]
    if event.kind.startswith(("a-", "b-m-p-")):
        return [Drawing("points", (place_of(event),))]
    raise CotEventError(
        f"the type {event.kind} is not supported; draw a marker, line, polygon, rectangle or circle"
    )


def _line_in(detail: Element) -> tuple[LatLon, ...]:
    places = tuple(
        _in_degrees(*link.get("point", "").split(",")[:2])
        for link in detail.findall("link")
        if "point" in link.attrib
    )
    if len(places) < 2:
        raise CotEventError(f"a drawn shape needs at least 2 points but has {len(places)}")
    return places


def _from_xml(data: bytes) -> Element:
    try:
        text = data.decode("utf-8").lstrip("\ufeff \t\r\n")
        if "<!DOCTYPE" in text:  # only this declaration can define entities
            raise CotEventError("an event contains a DOCTYPE, which is not allowed")
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, UnicodeDecodeError, ValueError) as error:
        raise CotEventError(f"an event is not valid XML: {error}") from None


def _from_protobuf(data: bytes) -> Element | None:
    """Return the XML event with the same content as a message of TAK protocol version 1."""
    import takproto  # takes 0.1 s; only mesh networks send protobuf
    from google.protobuf.message import DecodeError

    try:
        message = takproto.parse_proto(bytearray(data))
        if not message.HasField("cotEvent"):
            return None
        event = message.cotEvent
        sent = zulu(1000 * event.sendTime)
    except (DecodeError, OverflowError) as error:
        raise CotEventError(f"an event cannot be read as TAK protocol 1: {error}") from None
    root = Element("event", {"uid": event.uid, "type": event.type, "time": sent})
    place = {"lat": str(event.lat), "lon": str(event.lon), "ce": str(event.ce)}
    ElementTree.SubElement(root, "point", place)
    detail = _from_xml(f"<detail>{event.detail.xmlDetail}</detail>".encode())
    root.append(detail)
    callsign, group = event.detail.contact.callsign, event.detail.group
    if callsign:
        ElementTree.SubElement(detail, "contact", callsign=callsign)
    if group.name:
        ElementTree.SubElement(detail, "__group", name=group.name, role=group.role)
    return root


def _creator_in(detail: Element, uid: str) -> Creator | None:
    """Return the creator of a marker (``link``) or a shape (``creator``)."""
    for each, callsign, time in _creator_elements(detail):
        creator = _text(each, "uid")
        if creator:
            try:
                created_us: int | None = _unix_us(_text(each, time), uid)
            except CotEventError:
                created_us = None
            return Creator(creator, _text(each, callsign), created_us)
    return None


def _creator_elements(detail: Element) -> Iterator[tuple[Element, str, str]]:
    """Yield the elements that may name a creator, with the keys of their callsign and time."""
    for each in detail.findall("creator"):
        yield each, "callsign", "time"
    for each in detail.findall("link"):
        if each.get("relation") == "p-p" and each.get("type", "").startswith("a-"):
            yield each, "parent_callsign", "production_time"


def _ellipse(centre: LatLon, detail: Element) -> tuple[LatLon, ...]:
    rings = _child(detail, "shape").findall("ellipse")
    radii_m = [(_number(each, "major"), _number(each, "minor"), each) for each in rings]
    if not radii_m:
        raise CotEventError("a circle has no radius")
    major_m, minor_m, largest = max(radii_m, key=lambda found: found[0])
    if not (0.0 < major_m <= MAX_RADIUS_M and 0.0 < minor_m <= MAX_RADIUS_M):
        raise CotEventError(
            f"a circle has the radii {major_m:g} and {minor_m:g} m; "
            f"they must be above 0 and at most {MAX_RADIUS_M:g} m"
        )
    heading = math.radians(_number(largest, "angle") if "angle" in largest.attrib else 0.0)
    found = []
    for number in range(ELLIPSE_CORNERS):
        turn = 2.0 * math.pi * number / ELLIPSE_CORNERS
        along_m, across_m = major_m * math.cos(turn), minor_m * math.sin(turn)
        north_m = along_m * math.cos(heading) - across_m * math.sin(heading)
        east_m = along_m * math.sin(heading) + across_m * math.cos(heading)
        lat_deg = centre[0] + north_m / M_PER_DEG
        east_deg = east_m / (M_PER_DEG * math.cos(math.radians(centre[0])))
        found.append(_in_degrees(lat_deg, centre[1] + east_deg))
    return tuple(found)


def place_of(event: CotEvent) -> LatLon:
    """Return the position of an event. Raises CotEventError for a position not on the Earth."""
    point = _child(event.root, "point")
    return _in_degrees(point.get("lat", ""), point.get("lon", ""))


def _in_degrees(lat: str | float = "", lon: str | float = "") -> LatLon:
    """Return a position in degrees. Raises CotEventError for a position not on the Earth."""
    try:
        lat_deg, lon_deg = float(lat), float(lon)
    except ValueError:
        lat_deg = lon_deg = math.nan
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0):
        raise CotEventError(f"{_cut(str(lat))}, {_cut(str(lon))} is not a latitude and longitude")
    return lat_deg, lon_deg


def _child(element: Element, tag: str) -> Element:
    """Return the first child with this tag, or an empty element."""
    found = element.find(tag)
    return Element(tag) if found is None else found


def _text(element: Element, key: str) -> str:
    """Return an attribute as one line without surrounding whitespace; "" if it is missing."""
    text = "".join(each if each.isprintable() else " " for each in element.get(key, "")).strip()
    if len(text) > MAX_TEXT:
        raise CotEventError(f"{key} has {len(text)} characters; the limit is {MAX_TEXT}")
    return text


def _number(element: Element, key: str) -> float:
    try:
        found = float(element.get(key, ""))
    except ValueError:
        found = math.nan
    if not math.isfinite(found):
        raise CotEventError(f"{key} = {_cut(element.get(key, ''))} is not a number")
    return found


def _unix_us(text: str, uid: str) -> int:
    """Return a time such as 2026-11-22T00:30:00.000Z in microseconds since 1970."""
    try:
        return unix_us_of(text)
    except ValueError:
        raise CotEventError(f"unknown time format: {_cut(text)!r} in {_cut(uid)}") from None


def _cut(text: str) -> str:
    return text if len(text) <= 60 else text[:59] + "…"
