"""Received Cursor on Target events: framing, XML and protobuf, shapes, and damaged bytes."""

import math
from random import Random
from xml.sax.saxutils import escape

import pytest
import takproto
from hypothesis import given, settings
from hypothesis import strategies as st

from mission_service.ground_distance import distance_m
from mission_service.interfaces.cot.event_framing import MAX_EVENT_BYTES, EventFramer
from mission_service.interfaces.cot.fire_reports import FireReport, reports_in, state_in
from mission_service.interfaces.cot.received_events import (
    CotEvent,
    CotEventError,
    drawings_in,
    parse_event,
)
from tests.feeds.tak_events import (
    HERE,
    HOPE,
    NOW_US,
    RING,
    circle,
    deletion,
    event_text,
    marker,
    shape,
    telestration,
    user,
)

SENT = (user(), marker(), shape(), circle([(120.0, 120.0)]), deletion(), telestration(shape()))


def event(data: bytes) -> CotEvent:
    found = parse_event(data)
    assert found is not None
    return found


def report(data: bytes) -> FireReport:
    (found,) = reports_in(event(data))
    return found


@given(
    st.lists(st.sampled_from(SENT), max_size=6),
    st.lists(st.integers(1, 400), min_size=1),
    st.sampled_from((b"", b"\n", b"\x00\xff", b"<event/>", b"<events>", b"</events>")),
)
@settings(max_examples=60, deadline=None)
def test_events_of_a_stream_are_found_in_reads_of_any_size(
    sent: list[bytes], sizes: list[int], between: bytes
) -> None:
    data = between + between.join(sent)
    framer, found, position, number = EventFramer(), [], 0, 0
    while position < len(data):
        size = sizes[number % len(sizes)]
        found += framer.receive(data[position : position + size])
        position, number = position + size, number + 1
    assert [event(each).uid for each in found] == [event(each).uid for each in sent]
    assert framer.too_long == 0


@pytest.mark.parametrize("size", [1000, 65_536, 10 * MAX_EVENT_BYTES])
def test_an_event_that_is_too_long_is_dropped_and_the_next_one_is_found(size: int) -> None:
    long_ = event_text("long", "a-u-G", HERE, "x" * (3 * MAX_EVENT_BYTES), NOW_US)
    data = user() + long_ + marker()
    framer = EventFramer()
    found = [
        each
        for start in range(0, len(data), size)
        for each in framer.receive(data[start : start + size])
    ]
    uids = [event(each).uid for each in found if len(each) <= MAX_EVENT_BYTES]
    assert uids == [HOPE, "marker-1"]
    for each in found:
        if len(each) > MAX_EVENT_BYTES:  # it arrived in one read
            with pytest.raises(CotEventError, match="more than"):
                parse_event(each)


@pytest.mark.parametrize("missing", range(len("</event>") + 1))
def test_the_end_of_an_event_that_is_too_long_may_be_split(missing: int) -> None:
    long_ = event_text("long", "a-u-G", HERE, "x" * MAX_EVENT_BYTES, NOW_US)
    framer = EventFramer()
    cut = len(long_) - missing
    found = framer.receive(long_[:cut]) + framer.receive(long_[cut:] + marker())
    assert [event(each).uid for each in found if len(each) <= MAX_EVENT_BYTES] == ["marker-1"]


def test_a_user_and_a_marker_are_read() -> None:
    found = event(user())
    assert (found.uid, found.title, found.group, found.role) == (
        HOPE,
        "HOPE",
        "Cyan",
        "Team Member",
    )
    assert (found.sent_unix_us, found.error_m, found.is_user) == (NOW_US, 4.7, True)
    assert reports_in(found) == []
    spot = report(marker(created_us=NOW_US - 5_000_000))
    assert (spot.state, spot.shape, spot.points) == ("burning", "points", (HERE,))
    assert (spot.creator.uid, spot.creator.callsign) == (HOPE, "HOPE")
    assert spot.creator.created_unix_us == NOW_US - 5_000_000
    assert spot.error_m is None  # 9999999
    assert report(marker(ce=12.5)).error_m == 12.5


def test_shapes_are_read() -> None:
    assert report(shape()).shape == "polygon"
    assert report(shape()).points == RING
    line = report(shape(RING[:3]))
    assert (line.shape, line.points) == ("line", RING[:3])
    back = report(shape((RING[0], RING[1], RING[0])))  # there and back is no area
    assert back.shape == "line"
    assert report(shape(RING[:3], kind="u-d-r")).shape == "polygon"
    with_heights = shape().replace(b",-84.15'", b",-84.15,82,737'")  # a comma as decimal point
    assert report(with_heights).points == RING
    wintak = shape(created_us=NOW_US).replace(
        b"23:33:20.000Z' type='a-f", b"23:33:20:000Z' type='a-f"
    )
    assert wintak != shape(created_us=NOW_US)
    assert report(wintak).creator.created_unix_us == NOW_US


def test_each_stroke_of_a_telestration_is_a_line() -> None:
    sketch = event(telestration(shape(RING[:2]), shape(RING)))
    found = reports_in(sketch)
    assert [(each.uid, each.shape, each.points) for each in found] == [
        ("sketch-1", "line", RING[:2]),
        ("sketch-1/1", "line", RING),
    ]


def test_a_circle_is_its_largest_ring() -> None:
    found = report(circle([(50.0, 50.0), (200.0, 200.0), (100.0, 100.0)]))
    assert found.shape == "polygon"
    assert all(math.isclose(distance_m(HERE, each), 200.0, rel_tol=1e-3) for each in found.points)
    long_ = report(circle([(300.0, 100.0)], angle=90))  # the long axis points east
    east = max(long_.points, key=lambda place: place[1])
    assert math.isclose(east[0], HERE[0], abs_tol=1e-6)
    assert math.isclose(distance_m(HERE, east), 300.0, rel_tol=1e-3)


@pytest.mark.parametrize(
    ("title", "state"),
    [
        ("burned", "burned"),
        ("Burned 12", "burned"),
        ("BURNT-3", "burned"),
        ("burning1", "burning"),
        ("unburned_2", "unburned"),
        ("Unburnt", "unburned"),
    ],
)
def test_titles_that_are_reports(title: str, state: str) -> None:
    assert state_in(title) == state
    assert report(marker(title)).state == state


@pytest.mark.parametrize(
    "title",
    [
        *("Fire 1", "Fire Station 3", "burned truck", "not burned", "burn", "R 1", "", "burning?"),
        *("burned 1234567", "burnıng", "burned\n", "unburned area", "burned 1.5", "HOPE"),
    ],
)
def test_titles_of_other_markers(title: str) -> None:
    assert state_in(title) is None
    assert reports_in(event(marker(title.strip()))) == [] or title == "burned\n"


def test_other_events_are_no_reports() -> None:
    assert reports_in(event(deletion())) == []
    assert reports_in(event(user(callsign="burned 1"))) == []  # a user of this name
    chat = event_text("GeoChat.1", "b-t-f", HERE, "<remarks>burned</remarks>", NOW_US)
    assert reports_in(event(chat)) == []


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (marker(place=("nan", -84.1)), "nan, -84.1 is not a latitude and longitude"),
        (marker(place=("inf", -84.1)), "is not a latitude"),
        (marker(place=(90.5, -84.1)), "is not a latitude"),
        (marker(place=("", "")), "is not a latitude"),
        (shape((HERE, ("x", 1))), "is not a latitude"),
        (shape(((1, 2), (1,) * 2))[:-20] + b"</event>", "not valid XML"),
        (shape((HERE,)), "needs at least 2 points but has 1"),
        (shape().replace(b"<creator", b"<creature"), "does not name its creator"),
        (shape(kind="u-rb-a"), "the type u-rb-a is not supported"),
        (telestration(b"<event><detail></detail></event>"), "needs at least 2 points but has 0"),
        (telestration(*[shape()] * 21), "it has 21 strokes; the limit is 20"),
        (telestration(b"<!DOCTYPE x><event/>"), "DOCTYPE"),
        (circle([]), "has no radius"),
        (circle([("nan", 5)]), "major = nan is not a number"),
        (circle([(1e9, 1e9)]), "has the radii 1e"),
        (circle([(-5, -5)]), "has the radii -5 and -5 m"),
        (marker().replace(b"time='2026", b"time='xx26"), "unknown time format"),
        (marker(title="x" * 300), "callsign has 300 characters"),
        (b"<event uid='' type='a-u-G'></event>", "no uid"),
        (b"<other></other>", "root element is not <event>"),
        (b"", "not valid XML"),
        (b"\xff\xfe<\x00e\x00", "not valid XML"),
    ],
)
def test_events_that_cannot_be_used_have_a_reason_in_one_line(data: bytes, reason: str) -> None:
    with pytest.raises(CotEventError, match=reason) as caught:
        reports_in(event(data))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


def test_entities_are_never_expanded() -> None:
    levels = "".join(f"<!ENTITY e{n + 1} '{f'&e{n};' * 10}'>" for n in range(9))
    bomb = (
        f"<!DOCTYPE event [<!ENTITY e0 'burned'>{levels}]>".encode() + marker().split(b"\n", 1)[1]
    )
    with pytest.raises(CotEventError, match="DOCTYPE"):
        parse_event(bomb.replace(b"burning 1", b"&e9;"))
    with pytest.raises(CotEventError, match="not valid XML"):  # without the declaration
        parse_event(marker().replace(b"burning 1", b"&e9;"))
    with pytest.raises(CotEventError, match="not valid XML"):  # an encoding that hides it
        parse_event(bomb.decode().encode("utf-16"))


def test_deeply_nested_elements_are_read_or_refused() -> None:
    depth = MAX_EVENT_BYTES // 10
    nested = "<a>" * depth + "</a>" * depth
    assert report(event_text_with(nested)).points == (HERE,)


def event_text_with(detail: str) -> bytes:
    return marker().replace(b"<remarks></remarks>", detail.encode())


@pytest.mark.parametrize("data", SENT)
def test_protobuf_of_a_mesh_network_has_the_same_content(data: bytes) -> None:
    found, same = event(data), event(bytes(takproto.xml2proto(data)))
    assert same._replace(root=found.root) == found
    assert reports_in(found) == reports_in(same)


def test_a_message_of_versions_is_no_event_and_damaged_protobuf_is_refused() -> None:
    message = takproto.proto.TakMessage()
    message.takControl.minProtoVersion = 1
    assert parse_event(b"\xbf\x01\xbf" + message.SerializeToString()) is None
    message.cotEvent.uid, message.cotEvent.type = "u", "a-u-G"
    message.cotEvent.sendTime = 2**64 - 1
    with pytest.raises(CotEventError, match="TAK protocol 1"):
        parse_event(b"\xbf\x01\xbf" + message.SerializeToString())
    message.cotEvent.sendTime = 0
    message.cotEvent.detail.xmlDetail = "<!DOCTYPE x></detail>"
    with pytest.raises(CotEventError, match="DOCTYPE"):
        parse_event(b"\xbf\x01\xbf" + message.SerializeToString())


PROTOBUF = tuple(bytes(takproto.xml2proto(each)) for each in SENT)


def test_damaged_events_are_read_or_refused() -> None:
    random = Random(7)
    refused = 0
    for number in range(3000):
        data = (SENT + PROTOBUF)[number % 12]
        for _ in range(random.randint(1, 4)):
            start, length = random.randrange(len(data)), random.randint(0, 12)
            data = data[:start] + random.randbytes(length) + data[start + random.randint(0, 20) :]
        refused += not check(data)
    assert 1500 < refused < 3000


@given(
    st.dictionaries(
        st.sampled_from(("lat", "lon", "ce", "major", "point", "callsign", "time", "uid", "type")),
        st.text(max_size=30),
    ),
    st.sampled_from(SENT),
)
@settings(max_examples=60, deadline=None)
def test_events_with_any_attributes_are_read_or_refused(
    values: dict[str, str], data: bytes
) -> None:
    text = data.decode()
    for key, value in values.items():
        head, found, rest = text.partition(f" {key}='")
        if found:
            text = head + found + escape(value, {"'": "&apos;"}) + "'" + rest.partition("'")[2]
    check(text.encode("utf-8", "surrogatepass"))


def check(data: bytes) -> bool:
    """Check that an event is read, or refused with one line; return whether it is read."""
    problem, found = "", None
    try:
        found = parse_event(data)
        reported = [] if found is None else reports_in(found)
    except CotEventError as error:
        problem, reported = str(error), []
    assert "\n" not in problem
    for each in reported:
        assert each.points
        assert all(abs(lat) <= 90.0 and abs(lon) <= 180.0 for lat, lon in each.points)
        assert found is not None
        assert each.points in [drawing.points for drawing in drawings_in(found)]
    return not problem
