"""Images from transport streams: places, gaps, damage, and the reasons why parts are not used."""

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.klv_video import TEMPERATURES_C, VideoWriter, grey, packet, pose_values
from benchmarks.thermal_frames import pose_above, steep_landscape
from benchmarks.video_fuzz import fuzz, original
from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import ThermalVideoSection
from mission_service.fire.observed_window import states_in
from mission_service.sensors.thermal.camera_geometry import Lens
from mission_service.sensors.thermal.frame_cells import FrameCells, frame_cells
from mission_service.sensors.thermal.ground_points import ground_points
from mission_service.sensors.thermal.thermal_image import ThermalImage
from mission_service.sensors.video.video_decoder import VideoDecoder, VideoDecoderError
from mission_service.sensors.video.video_problem import video_problem
from mission_service.sensors.video.video_stream import VideoStream
from mission_service.simulation.thermal_images import rendered

TAKEN = datetime(2026, 7, 4, 13, tzinfo=UTC)
LENS = Lens(160, 128, 200.0)
TS_BYTES = 188
Values = dict[int, float | bytes | None]


@pytest.fixture(scope="module")
def land() -> Landscape:
    return steep_landscape(10.0)


@pytest.fixture(scope="module")
def values(land: Landscape) -> Values:
    return pose_values(land, pose_above(land, 300.0, 300.0, 40.0, -90.0), LENS)


@pytest.fixture(scope="module")
def picture(land: Landscape) -> NDArray[np.uint8]:
    """Return a picture of ground whose western half has burned for an hour."""
    pose = pose_above(land, 300.0, 300.0, 40.0, -90.0)
    arrival_s = np.tile(3600.0 + 10.0 * (np.arange(land.shape[1]) - 300.0), (land.shape[0], 1))
    return grey(rendered(land, arrival_s, 3600.0, pose, np.random.default_rng(1), LENS))


def stream_of(
    picture: NDArray[np.uint8],
    values: Mapping[int, float | bytes | None] | None,
    count: int = 3,
    codec: str = "libx264",
) -> bytes:
    """Return a stream with ``count`` pictures; the metadata are a second apart."""
    height, width = picture.shape[:2]
    writer = VideoWriter(width, height, codec, values is not None)
    for number in range(count):
        taken = TAKEN + timedelta(seconds=number)
        writer.add(number / 30.0, picture, [] if values is None else [packet(taken, values)])
    return writer.close()


def read(data: bytes, **settings: object) -> tuple[list[ThermalImage], str]:
    """Return the images of a stream, and the problem that is reported."""
    if "hot_level" not in settings:
        settings["grey_level_range_c"] = TEMPERATURES_C
    stream = VideoStream("video", ThermalVideoSection(**settings))  # type: ignore[arg-type]
    images = stream.feed(data) + stream.end()
    return images, video_problem(stream.counts, "source", "", 10.0)


def cells_of(image: ThermalImage, land: Landscape) -> FrameCells:
    return frame_cells(image, land, ThermalVideoSection(grey_level_range_c=TEMPERATURES_C))


def test_each_image_has_the_time_and_the_place_of_its_metadata(
    picture: NDArray[np.uint8], values: Values, land: Landscape
) -> None:
    images, problem = read(stream_of(picture, values))
    assert problem == ""
    assert [image.taken for image in images] == [TAKEN + timedelta(seconds=n) for n in range(3)]
    pose = pose_above(land, 300.0, 300.0, 40.0, -90.0)
    assert land.xy_of_lat_lon(images[0].lat_deg, images[0].lon_deg) == pytest.approx(
        (pose.x_m, pose.y_m), abs=0.05
    )
    assert images[0].focal_px == pytest.approx(LENS.focal_px, rel=1e-3)
    low_c, high_c = TEMPERATURES_C
    seen_c = low_c + picture * (high_c - low_c) / 255.0
    assert np.abs(images[0].values - seen_c).mean() < 3.0
    state = states_in(cells_of(images[0], land).window.cells)
    assert (state == 2).any()
    assert (state == 0).any()


def test_a_video_with_hot_level_shows_burning_pixels_only(
    picture: NDArray[np.uint8], values: Values, land: Landscape
) -> None:
    (image, *_), _ = read(stream_of(picture, values), hot_level=150.0)
    assert image.kind == "levels"
    cells = frame_cells(image, land, ThermalVideoSection(hot_level=150.0)).window.cells
    assert "u" not in "".join(cells)


@pytest.mark.parametrize("codec", ["mpeg2video", "mpeg4"])
def test_other_codecs_are_decoded(codec: str, picture: NDArray[np.uint8], values: Values) -> None:
    images, problem = read(stream_of(picture, values, codec=codec))
    assert len(images) == 3
    assert problem == ""


def test_corner_points_and_pose_place_an_image_alike(
    picture: NDArray[np.uint8], values: Values, land: Landscape
) -> None:
    pose = pose_above(land, 300.0, 300.0, 40.0, -90.0)
    col, row = np.array([-0.5, 159.5, 159.5, -0.5]), np.array([-0.5, -0.5, 127.5, 127.5])
    places = ground_points(land, LENS, pose, col, row)
    corners = np.column_stack(land.lat_lon_of(*land.xy_of(places[:, 0], places[:, 1]))).ravel()
    tags = dict(zip(range(82, 90), corners.tolist(), strict=True))
    without_pose = {13: values[13], 14: values[14], **tags}
    (by_corners, *_), problem = read(stream_of(picture, without_pose))
    assert problem == ""
    (chosen, *_), _ = read(stream_of(picture, values | tags), use_corner_points=True)
    (by_pose, *_), _ = read(stream_of(picture, values | tags))
    assert by_pose.corners is None
    assert chosen.corners == by_corners.corners
    found, expected = cells_of(by_corners, land), cells_of(by_pose, land)
    assert found.position_sd_m == pytest.approx(15.0)
    distance = np.subtract(found.centre, expected.centre) * land.cell_size_m
    assert np.hypot(*distance) < 15.0


def test_a_gap_ends_with_the_next_key_frame(picture: NDArray[np.uint8], values: Values) -> None:
    """Key frames are 30 pictures apart. Without its first packet, picture 3 continues picture 2."""
    whole = stream_of(picture, values, 35)
    parts = [whole[start : start + TS_BYTES] for start in range(0, len(whole), TS_BYTES)]
    of_video = [n for n, part in enumerate(parts) if part[1] & 0x1F == 1 and part[2] == 0]
    begins = [n for n in of_video if parts[n][1] & 0x40]
    del parts[begins[3]]
    images, _ = read(b"".join(parts))
    numbers = [round((image.taken - TAKEN).total_seconds()) for image in images]
    assert numbers == [0, 1, 30, 31, 32, 33, 34]


def test_a_stream_may_begin_again_with_an_earlier_time(
    picture: NDArray[np.uint8], values: Values
) -> None:
    """At the seam, pictures are left out until the second key frame of the new stream."""
    once = stream_of(picture, values, 35)
    images, _ = read(once + once)
    numbers = [round((image.taken - TAKEN).total_seconds()) for image in images]
    assert numbers[:34] == list(range(34))
    assert numbers[-5:] == [30, 31, 32, 33, 34]
    images, _ = read(once[len(once) // 3 // TS_BYTES * TS_BYTES :] + once)
    numbers = [round((image.taken - TAKEN).total_seconds()) for image in images]
    assert numbers[-5:] == [30, 31, 32, 33, 34], "a stream may begin in its middle"


def test_damaged_metadata_are_counted_with_the_reason(
    picture: NDArray[np.uint8], values: Values
) -> None:
    writer = VideoWriter(LENS.width, LENS.height)
    for number in range(3):
        whole = bytearray(packet(TAKEN + timedelta(seconds=number), values))
        whole[24] ^= number  # a byte of the time stamp
        writer.add(number, picture, [bytes(whole)])
    images, problem = read(writer.close())
    assert [image.taken for image in images] == [TAKEN]
    assert problem.startswith("source: 2 of 3 metadata packets are not used: checksum mismatch")


def test_a_packet_that_differs_from_its_neighbours_is_not_used(
    picture: NDArray[np.uint8], values: Values
) -> None:
    """As a damaged packet does that has the right checksum by chance."""
    changes: list[Values] = [{13: -12.0}, {15: 2000.0}, {5: 90.0}, {}]
    for change in changes:
        writer = VideoWriter(LENS.width, LENS.height)
        for number in range(5):
            taken = TAKEN + timedelta(seconds=number / 30.0)
            kept = values | (change if number == 2 else {})
            writer.add(number / 30.0, picture, [packet(taken, kept)])
        stream = VideoStream("video", ThermalVideoSection(hot_level=150.0), 0.01)
        images = stream.feed(writer.close()) + stream.end()
        assert len({image[4:10] for image in images}) == 1
        assert len(images) + stream.counts.refused == 5
        assert stream.counts.refused in ((1, 2) if change else (0,)), "perhaps the next one, too"
    assert "differ from the metadata before and after them" in reason_of_jump(picture, values)


def reason_of_jump(picture: NDArray[np.uint8], values: Values) -> str:
    """Return the reported problem of a stream whose third packet is from an hour later."""
    writer = VideoWriter(LENS.width, LENS.height)
    for number in range(5):
        taken = TAKEN + timedelta(seconds=3600.0 if number == 2 else number / 30.0)
        writer.add(number / 30.0, picture, [packet(taken, values)])
    return read(writer.close())[1]


def late_metadata(picture: NDArray[np.uint8], values: Values) -> bytes:
    """Return a stream whose metadata are half a second later than its pictures."""
    writer = VideoWriter(LENS.width, LENS.height)
    for at_s in (0.0, 0.1):
        writer.add(at_s, picture)
    writer.add_metadata(0.6, packet(TAKEN, values))
    return writer.close()


def test_reasons_why_no_image_is_used(picture: NDArray[np.uint8], values: Values) -> None:
    def reason(data: bytes, **settings: object) -> str:
        images, problem = read(data, **settings)
        assert images == []
        return problem

    assert "nothing has arrived for 10 s" in reason(b"")
    garbage = np.random.default_rng(1).bytes(50_000)
    assert "no video of a known codec" in reason(garbage)
    assert "no metadata in the stream" in reason(stream_of(picture, None))
    colours = np.zeros((*picture.shape, 3), dtype=np.uint8)
    colours[..., 0] = picture
    assert "is a colour picture" in reason(stream_of(colours, values))
    no_pose = reason(stream_of(picture, {tag: values[tag] for tag in (13, 14)}))
    assert "no corner points and no pose: tags missing or out of range: 5, 6, 7, 18" in no_pose
    assert "do not fit 160 x 128 square pixels" in reason(stream_of(picture, values | {17: 90.0}))
    assert "remove estimate.thermal_video.use_corner_points" in reason(
        stream_of(picture, values), use_corner_points=True
    )
    assert "no picture has metadata within 0.1 s of it" in reason(late_metadata(picture, values))
    with pytest.raises(VideoDecoderError, match="the codec none cannot be decoded"):
        VideoDecoder("none")


def test_damage_changes_nothing_but_what_is_left_out() -> None:
    outcomes = fuzz(original(), 60, np.random.default_rng(5))
    assert outcomes["metadata refused"] > 10
    assert outcomes["images"] > 20
