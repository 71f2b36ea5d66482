"""Packets of MISB ST 0601: published values, poses, corner points, and errors in them."""

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from benchmarks.klv_video import KEY, packet, signed
from benchmarks.thermal_frames import steep_landscape
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import ThermalVideoSection
from mission_service.sensors.thermal.camera_geometry import CameraPose, axes_of, mounted_direction
from mission_service.sensors.thermal.image_corners import (
    CornerPoints,
    corner_places,
    homography,
    quadrilateral,
)
from mission_service.sensors.video.video_metadata import (
    VideoMetadata,
    VideoMetadataError,
    read_metadata,
)

# The examples in MISB ST 0902, with the values that the tests of klvdata expect.
TAKEN = datetime(2009, 1, 12, 22, 8, 22, tzinfo=UTC)
DYNAMIC = {
    5: 159.974365,
    6: -0.431531724,
    7: 3.40586566,
    13: 60.1768229669783,
    14: 128.426759042045,
    15: 14190.72,
    16: 144.571298,
    17: 152.643626,
    18: 160.71921147,
    19: -168.79232483394085,
    20: 0.0,
    21: 68590.983298744770,
    22: 722.819867,
    23: -10.542388633146132,
    24: 29.157890122923018,
    25: 3216.0372,
    65: 6.0,
}
SETTINGS = ThermalVideoSection()
LEVEL = {5: 90.0, 6: 0.0, 7: 0.0, 13: 36.36, 14: -84.15, 15: 900.0, 18: 0.0, 19: -90.0, 20: 0.0}
SQUARE = (36.361, -84.151, 36.361, -84.149, 36.359, -84.149, 36.359, -84.151)


def read(values: Mapping[int, float | bytes | None], **settings: object) -> VideoMetadata:
    return read_metadata(packet(TAKEN, values), ThermalVideoSection(**settings))  # type: ignore[arg-type]


def test_the_dynamic_packet_of_the_standard_is_read() -> None:
    """Its published bytes are those that the encoding rules give for the published values."""
    whole = packet(TAKEN, DYNAMIC)
    assert whole.startswith(KEY + bytes.fromhex("61020800046050584e0180050271c20602fd3d070208b8"))
    assert whole.endswith(bytes.fromhex("4101060102c850"))
    found = read_metadata(whole, SETTINGS)
    assert found.taken == TAKEN
    assert found.field_of_view_deg == pytest.approx(144.5713, abs=1e-4)
    assert found.vertical_field_of_view_deg == pytest.approx(152.6436, abs=1e-4)
    assert found.pose is not None
    assert found.pose.lat_deg == pytest.approx(60.176822966978335, abs=1e-9)
    assert found.pose.lon_deg == pytest.approx(128.42675904204452, abs=1e-9)
    assert found.pose.altitude_amsl_m == pytest.approx(14190.7195, abs=1e-3)
    expected = mounted_direction(
        (DYNAMIC[5], DYNAMIC[6], DYNAMIC[7]), (DYNAMIC[18], DYNAMIC[19], 0.0)
    )
    assert found.pose[3:] == pytest.approx(expected, abs=0.01)
    assert found.corners is None


def test_the_dynamic_and_constant_packet_is_read_and_its_published_checksum_is_wrong() -> None:
    """The packet also contains texts, a set of security and an identifier.

    The published bytes have the sum 3e1e, and the published checksum is aa43.
    """
    security = b"\x01\x01\x01\x02\x01\x07\x03\x05//USA\x0c\x01\x07\r\x06\0U\0S\0A\x16\x02\0\n"
    identifier = "0170f592f02373364af8aa9162c00f2eb2da16b74341000841a0be365b5ab96a3645"
    names = {3: b"Mission 12", 10: b"Predator", 11: b"EO Nose", 12: b"Geodetic WGS84"}
    others: dict[int, float | bytes] = {
        20: 176.86543764939194,
        48: security,
        94: bytes.fromhex(identifier),
    }
    values: dict[int, float | bytes] = {**DYNAMIC, **names, **others}
    last = {tag: values.pop(tag) for tag in (48, 65, 94)}
    whole = packet(TAKEN, dict(sorted(values.items())) | last)
    assert whole[16:18] == b"\x81\xd2"
    assert whole.endswith(b"\x01\x02\x3e\x1e")
    found = read_metadata(whole, SETTINGS)
    assert found.taken == TAKEN
    assert found.pose is not None
    assert found.pose.lat_deg == pytest.approx(60.176822966978335, abs=1e-9)
    assert found.pose.lon_deg == pytest.approx(128.42675904204452, abs=1e-9)
    with pytest.raises(VideoMetadataError, match="checksum mismatch: declared 0xaa43"):
        read_metadata(whole[:-2] + b"\xaa\x43", SETTINGS)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (packet(TAKEN, DYNAMIC)[:-3], "truncated"),
        (packet(TAKEN, {6: 1.0}).replace(b"\x06\x02", b"\x06\x7f"), "truncated"),
        (KEY + b"\x84\xff\xff\xff\xff", "."),
        (packet(datetime(2101, 1, 1, tzinfo=UTC), DYNAMIC), "tag 2, the time stamp, is 413"),
        (signed(KEY + b"\x0e\x02\x08" + b"\xff" * 8 + b"\x01\x02"), "time stamp, is 18446744"),
        (signed(KEY + b"\x08\x06\x02\x00\x00\x01\x02"), "missing or damaged"),
    ],
)
def test_a_damaged_packet_is_refused_with_the_reason(data: bytes, words: str) -> None:
    with pytest.raises(VideoMetadataError, match=words) as raised:
        read_metadata(data, SETTINGS)
    assert str(raised.value)
    assert "\n" not in str(raised.value)


def test_every_changed_bit_of_a_packet_is_noticed() -> None:
    """A sum of words misses no single changed bit of the values."""
    whole = packet(TAKEN, DYNAMIC)
    for bit in range(8 * len(KEY), 8 * len(whole)):
        changed = bytearray(whole)
        changed[bit // 8] ^= 1 << bit % 8
        with pytest.raises(VideoMetadataError):
            read_metadata(bytes(changed), SETTINGS)


def test_values_that_are_marked_as_errors_are_missing() -> None:
    found = read(LEVEL | {6: None})
    assert found.pose is None
    assert "tags missing or out of range: 6" in found.no_pose
    assert read(LEVEL | {19: None, 13: None}).no_pose.endswith("19, 13")
    assert read(LEVEL | {6: None, 90: 35.0}).pose is not None, "tag 90 has the full range"
    corners = dict(zip(range(82, 90), SQUARE, strict=True))
    assert read(corners | {85: None}).corners is None


def test_heights_above_the_ellipsoid_require_the_height_of_the_sea() -> None:
    above_ellipsoid = {tag: value for tag, value in LEVEL.items() if tag != 15} | {75: 870.0}
    assert "requires estimate.thermal_video.geoid_m" in read(above_ellipsoid).no_pose
    found = read(above_ellipsoid, geoid_m=-30.0).pose
    assert found is not None
    assert found.altitude_amsl_m == pytest.approx(900.0, abs=0.2)
    both = read(LEVEL | {75: 870.0}, geoid_m=-10.0).pose
    assert both is not None
    assert both.altitude_amsl_m == pytest.approx(900.0, abs=0.2), "tag 15 is used if it is present"


def test_leap_seconds_are_subtracted() -> None:
    assert read(LEVEL, leap_seconds=29).taken == TAKEN - timedelta(seconds=29)


@pytest.mark.parametrize(
    ("platform", "mount", "expected"),
    [
        ((90.0, 0.0, 0.0), (0.0, -30.0, 0.0), (90.0, -30.0, 0.0)),
        ((350.0, 0.0, 0.0), (20.0, -30.0, 5.0), (10.0, -30.0, 5.0)),
        ((0.0, 10.0, 0.0), (0.0, -30.0, 0.0), (0.0, -20.0, 0.0)),
        ((0.0, 0.0, 30.0), (0.0, 0.0, 0.0), (0.0, 0.0, 30.0)),
        ((0.0, 0.0, 30.0), (90.0, 0.0, 0.0), (90.0, -30.0, 0.0)),  # banked towards the camera
        ((0.0, 10.0, 0.0), (180.0, 0.0, 0.0), (180.0, -10.0, 0.0)),
    ],
)
def test_directions_of_aircraft_and_mount_add_up(
    platform: tuple[float, float, float],
    mount: tuple[float, float, float],
    expected: tuple[float, float, float],
) -> None:
    assert mounted_direction(platform, mount) == pytest.approx(expected, abs=1e-9)


def test_a_camera_that_looks_straight_down_keeps_its_upper_edge() -> None:
    yaw, pitch, roll = mounted_direction((40.0, 0.0, 0.0), (0.0, -90.0, 0.0))
    _, up, forward = axes_of(CameraPose(0.0, 0.0, 0.0, yaw, pitch, roll))
    assert forward == pytest.approx((0.0, 0.0, -1.0), abs=1e-9)
    north, east = np.cos(np.deg2rad(40.0)), np.sin(np.deg2rad(40.0))
    assert up == pytest.approx((east, north, 0.0), abs=1e-9)


@pytest.fixture(scope="module")
def land() -> Landscape:
    return steep_landscape(30.0)


def around(land: Landscape, cells: list[tuple[float, float]]) -> CornerPoints:
    places = [land.lat_lon_of(*land.xy_of(row, col)) for row, col in cells]
    return CornerPoints(tuple((float(lat), float(lon)) for lat, lon in places), 15.0)


def test_corner_points_place_every_pixel_of_a_plane(land: Landscape) -> None:
    """The upper edge is farther away, so that the middle of the image is not that of the area."""
    trapezoid = [(50.0, 50.0), (50.0, 90.0), (70.0, 80.0), (70.0, 60.0)]
    grid = quadrilateral(land, around(land, trapezoid))
    assert grid == pytest.approx(np.array(trapezoid), abs=1e-3)
    matrix = homography(640, 512, grid)
    col, row = np.array([-0.5, 639.5, 319.5]), np.array([-0.5, 511.5, 255.5])
    places = corner_places(land, matrix, col, row)
    assert places[:2] == pytest.approx(np.array([trapezoid[0], trapezoid[2]]), abs=1e-3)
    assert places[2] == pytest.approx((63.333, 70.0), abs=1e-2)


def test_offsets_and_full_corner_points_are_the_same_places() -> None:
    full = read(dict(zip(range(82, 90), SQUARE, strict=True))).corners
    offsets = [value - centre for value, centre in zip(SQUARE, (36.36, -84.15) * 4, strict=True)]
    found = read({23: 36.36, 24: -84.15, **dict(zip(range(26, 34), offsets, strict=True))}).corners
    assert full is not None
    assert found is not None
    assert np.array(found.lat_lon_deg) == pytest.approx(np.array(full.lat_lon_deg), abs=2e-6)
    assert np.array(full.lat_lon_deg).ravel() == pytest.approx(SQUARE, abs=1e-7)


@pytest.mark.parametrize(
    ("cells", "words"),
    [
        ([(50.0, 90.0), (50.0, 50.0), (70.0, 50.0), (70.0, 90.0)], "mirrored"),
        ([(50.0, 50.0), (70.0, 90.0), (50.0, 90.0), (70.0, 50.0)], "cross"),
        ([(50.0, 50.0)] * 4, "0 to 0 m apart"),
        ([(50.0, 50.0), (50.0, 900.0), (70.0, 900.0), (70.0, 50.0)], "to 25500 m apart"),
    ],
)
def test_implausible_corner_points_are_refused(
    cells: list[tuple[float, float]], words: str, land: Landscape
) -> None:
    with pytest.raises(FireModelError, match=words):
        quadrilateral(land, around(land, cells))


def test_pixels_off_the_landscape_are_not_seen(land: Landscape) -> None:
    grid = quadrilateral(
        land, around(land, [(-20.0, 50.0), (-20.0, 90.0), (20.0, 90.0), (20.0, 50.0)])
    )
    places = corner_places(
        land, homography(640, 512, grid), np.array([320.0, 320.0]), np.array([10.0, 500.0])
    )
    assert np.isnan(places[0]).all()
    assert np.isfinite(places[1]).all()
