"""Events as TAK clients send them: positions of users, markers, and drawn shapes."""

from collections.abc import Sequence
from xml.sax.saxutils import quoteattr

from mission_service.interfaces.cot.cot_events import zulu

NOW_US = 1_795_304_000_000_000  # 2026-11-21T23:33:20Z
HERE = (36.3642, -84.1409)
RING = ((36.36, -84.15), (36.37, -84.15), (36.37, -84.14), (36.36, -84.15))
HOPE = "ANDROID-0123456789abcdef"
UNKNOWN = "9999999.0"


def event_text(
    uid: str, kind: str, place: tuple[object, object], detail: str, at_us: int, ce: object = UNKNOWN
) -> bytes:
    """Return an event with the XML header that clients and servers send."""
    now, stale = zulu(at_us), zulu(at_us + 86_400_000_000)
    return (
        "<?xml version='1.0' encoding='UTF-8' standalone='yes'?>\n"
        f"<event version='2.0' uid={quoteattr(uid)} type='{kind}' time='{now}' start='{now}' "
        f"stale='{stale}' how='h-e'>\n\t<point lat='{place[0]}' lon='{place[1]}' hae='{UNKNOWN}' "
        f"ce='{ce}' le='{UNKNOWN}' />\n\t<detail>{detail}</detail>\n</event>"
    ).encode()


def user(
    uid: str = HOPE,
    callsign: str = "HOPE",
    group: str = "Cyan",
    role: str = "Team Member",
    at_us: int = NOW_US,
) -> bytes:
    """Return the position of a user."""
    detail = (
        f"<takv device='PHONE' platform='ATAK-CIV' os='34' version='5.2.0'/>"
        f"<contact endpoint='*:-1:stcp' callsign={quoteattr(callsign)}/>"
        f"<uid Droid={quoteattr(callsign)}/>"
        f"<precisionlocation altsrc='GPS' geopointsrc='GPS'/>"
        f"<__group role='{role}' name='{group}'/><status battery='88'/>"
        f"<track course='187.4' speed='0.4'/>"
    )
    return event_text(uid, "a-f-G-U-C", HERE, detail, at_us, ce=4.7)


def marker(
    title: str = "burning 1",
    uid: str = "marker-1",
    place: tuple[object, object] = HERE,
    creator: str = HOPE,
    at_us: int = NOW_US,
    created_us: int | None = None,
    ce: object = UNKNOWN,
) -> bytes:
    """Return a spot map marker."""
    created = zulu(at_us if created_us is None else created_us)
    detail = (
        f"<status readiness='true'/><archive/>"
        f"<link uid='{creator}' production_time='{created}' type='a-f-G-U-C' "
        f"parent_callsign='HOPE' relation='p-p'/>"
        f"<contact callsign={quoteattr(title)}/><remarks></remarks><color argb='-65536'/>"
        f"<precisionlocation altsrc='???'/>"
        f"<usericon iconsetpath='COT_MAPPING_SPOTMAP/b-m-p-s-m/-65536'/>"
    )
    return event_text(uid, "b-m-p-s-m", place, detail, at_us, ce)


def shape(
    points: Sequence[tuple[object, object]] = RING,
    title: str = "burned 2",
    kind: str = "u-d-f",
    uid: str = "shape-1",
    at_us: int = NOW_US,
    created_us: int | None = None,
) -> bytes:
    """Return a line, polygon or rectangle."""
    links = "".join(f"<link point='{lat},{lon}'/>" for lat, lon in points)
    return event_text(uid, kind, HERE, links + _drawn_by(title, at_us, created_us), at_us)


def circle(radii_m: Sequence[tuple[object, object]], angle: object = 360) -> bytes:
    """Return a circle with rings of these radii (major, minor)."""
    rings = "".join(
        f"<ellipse major='{major}' minor='{minor}' angle='{angle}'/>" for major, minor in radii_m
    )
    style = (
        "<link uid='circle-1.Style' type='b-x-KmlStyle' relation='p-c'><Style><LineStyle>"
        "<color>ffff0000</color><width>4.0</width></LineStyle></Style></link>"
    )
    detail = f"<shape>{rings}{style}</shape>" + _drawn_by("burned", NOW_US, None)
    return event_text("circle-1", "u-d-c-c", HERE, detail, NOW_US)


def telestration(*strokes: bytes) -> bytes:
    """Return a freehand drawing, which contains the text of an event for each stroke."""
    links = "".join(f"<link line={quoteattr(each.decode())}/>" for each in strokes)
    detail = links + _drawn_by("burned", NOW_US, None)
    return event_text("sketch-1", "u-d-f-m", (0.0, 0.0), detail, NOW_US)


def deletion(uid: str = "marker-1") -> bytes:
    """Return the deletion of a marker or shape."""
    detail = f"<link uid='{uid}' relation='p-p' type='b-m-p-s-m'/><__forcedelete/>"
    return event_text(f"{uid}-deleted", "t-x-d-d", (0.0, 0.0), detail, NOW_US)


def _drawn_by(title: str, at_us: int, created_us: int | None) -> str:
    created = zulu(at_us if created_us is None else created_us)
    return (
        f"<strokeColor value='-65536'/><strokeWeight value='4.0'/><fillColor value='1090453504'/>"
        f"<contact callsign={quoteattr(title)}/><remarks/><archive/><labels_on value='true'/>"
        f"<creator uid='{HOPE}' callsign='HOPE' time='{created}' type='a-f-G-U-C'/>"
    )
