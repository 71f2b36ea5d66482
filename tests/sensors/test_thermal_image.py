"""Thermal images as files: values, metadata, damage; and the cells that they show."""

import contextlib
import os
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from benchmarks.thermal_frames import pose_above, steep_landscape
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import ThermalFramesSection
from mission_service.sensors.thermal.frame_cells import (
    COOL,
    HOT,
    Burned,
    FrameCells,
    _window_of,
    frame_cells,
)
from mission_service.sensors.thermal.thermal_image import (
    GPS_IFD,
    ORIENTATION,
    XMP_TAG,
    ThermalImageError,
    read_thermal_image,
)
from mission_service.simulation.thermal_images import LENS, rendered, write_frame

TAKEN = datetime(2026, 7, 4, 13, 5, 6, 250_000, tzinfo=UTC)
AT_S = 3600.0


@pytest.fixture(scope="module")
def land() -> Landscape:
    return steep_landscape(10.0)


@pytest.fixture(scope="module")
def whole(land: Landscape, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return a file of an image whose western half has burned for an hour."""
    path = tmp_path_factory.mktemp("frame") / "frame.tif"
    pose = pose_above(land, 300.0, 300.0, 0.0, -90.0)
    celsius = rendered(land, arrivals(land), AT_S, pose, np.random.default_rng(1))
    write_frame(path, land, pose, celsius, TAKEN)
    return path.read_bytes()


def arrivals(land: Landscape) -> np.ndarray:
    """Return arrival times: the fire runs from west to east and is at column 300 at ``AT_S``."""
    return np.tile(AT_S + 10.0 * (np.arange(land.shape[1]) - 300.0), (land.shape[0], 1))


def written(folder: Path, data: bytes, name: str = "frame.tif") -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def cells_of(path: Path, land: Landscape, **keys: object) -> FrameCells:
    section = ThermalFramesSection(distortion=LENS.distortion, **keys)  # type: ignore[arg-type]
    return frame_cells(read_thermal_image(path), land, section)


def test_a_file_has_its_time_place_and_direction(
    whole: bytes, land: Landscape, tmp_path: Path
) -> None:
    image = read_thermal_image(written(tmp_path, whole))
    pose = pose_above(land, 300.0, 300.0, 0.0, -90.0)
    assert image.kind == "celsius"
    assert image.taken == TAKEN
    x_m, y_m = land.xy_of_lat_lon(image.lat_deg, image.lon_deg)
    assert (x_m, y_m) == pytest.approx((pose.x_m, pose.y_m), abs=0.01)
    assert image.altitude_amsl_m == pytest.approx(pose.altitude_amsl_m, abs=0.01)
    assert land.grid_deg(image.yaw_deg) == pytest.approx(0.0, abs=1e-3)
    assert (image.pitch_deg, image.roll_deg) == (-90.0, 0.0)
    assert image.focal_px == pytest.approx(LENS.focal_px, abs=1e-3)


def test_the_cells_are_those_of_the_fire(whole: bytes, land: Landscape, tmp_path: Path) -> None:
    found = cells_of(written(tmp_path, whole), land)
    burned = arrivals(land) <= AT_S
    rows, cols = len(found.window.cells), len(found.window.cells[0])
    true = burned[found.window.row :, found.window.col :][:rows, :cols]
    letters = np.array([list(row) for row in found.window.cells])
    assert (letters == "b").sum() > 20
    assert (letters == "u").sum() > 20
    assert true[letters == "b"].all()
    assert not true[letters == "u"].any()
    assert 1.5 < found.position_sd_m < 4.0


@pytest.mark.parametrize(
    ("until", "hot_share", "expected"),
    [
        (1.0, 1.0, "bb"),
        (0.8, 1.0, "bb"),  # nearly the whole second cell is in the image
        (0.6, 1.0, "b."),
        (0.2, 1.0, "b."),  # the strip may be ground of the first cell, by the error of the place
        (0.2, 0.0, "b."),
        (1.0, 0.4, "b."),
        (1.0, 0.3, "bu"),  # the front passes through the second cell
        (1.0, 0.0, "bu"),
    ],
)
def test_only_cells_that_are_whole_in_the_image_are_observed(
    until: float, hot_share: float, expected: str
) -> None:
    """The first cell burns. The image ends at a share of the second cell, whose west is hot."""
    row, col = (each.ravel() for each in np.mgrid[-0.475:0.5:0.05, -0.475:1.5:0.05])
    seen = col < 0.5 + until
    kinds = np.where(col < 0.5 + hot_share, HOT, COOL).astype(np.int8)
    window = _window_of(np.column_stack([row, col])[seen], kinds[seen], (9, 9))
    assert window.cells == (expected,)


def test_a_few_hot_pixels_away_from_a_front_are_not_unburned_ground() -> None:
    row, col = (each.ravel() for each in np.mgrid[-0.475:0.5:0.05, -0.475:1.5:0.05])
    kinds = np.where((col > 1.3) & (row > 0.0), HOT, COOL).astype(np.int8)
    assert _window_of(np.column_stack([row, col]), kinds, (9, 9)).cells == ("u.",)


def test_warm_ground_that_touches_no_fire_is_unknown(land: Landscape, tmp_path: Path) -> None:
    pose = pose_above(land, 300.0, 300.0, 0.0, -90.0)
    celsius = np.full((LENS.height, LENS.width), 25.0)
    celsius[:, :200] = 55.0  # rocks in the sun
    path = tmp_path / "frame.tif"
    write_frame(path, land, pose, celsius, TAKEN)
    letters = "".join(cells_of(path, land).window.cells)
    assert "b" not in letters
    assert letters.count("u") > 20
    assert letters.count(".") > 20


def test_burned_ground_that_has_cooled_stays_burned(
    whole: bytes, land: Landscape, tmp_path: Path
) -> None:
    burned = Burned(land.shape)
    first = burned.added(cells_of(written(tmp_path, whole), land), 10.0)
    pose = pose_above(land, 300.0, 300.0, 0.0, -90.0)
    write_frame(tmp_path / "cold.tif", land, pose, np.full((512, 640), 25.0), TAKEN)
    cold = cells_of(tmp_path / "cold.tif", land)
    assert "b" not in "".join(cold.window.cells)
    again = "".join(burned.added(cold, 20.0).window.cells)
    assert again.count("b") == "".join(first.window.cells).count("b")


def test_counts_are_converted_and_grey_levels_need_a_level(land: Landscape, tmp_path: Path) -> None:
    pose = pose_above(land, 300.0, 300.0, 0.0, -90.0)
    celsius = rendered(land, arrivals(land), AT_S, pose, np.random.default_rng(1))
    path = tmp_path / "frame.tif"
    write_frame(path, land, pose, celsius, TAKEN)
    of_celsius = cells_of(path, land)
    counts = np.clip((celsius + 273.15) / 0.04, 0, 65_535).astype(np.uint16)
    write_frame(path, land, pose, counts, TAKEN)
    assert read_thermal_image(path).kind == "counts"
    assert cells_of(path, land, kelvin_per_count=0.04).window == of_celsius.window
    write_frame(path, land, pose, np.clip(celsius / 3.0, 0, 255).astype(np.uint8), TAKEN)
    with pytest.raises(FireModelError, match=r"estimate\.thermal_frames\.hot_level"):
        cells_of(path, land)
    levels = "".join(cells_of(path, land, hot_level=150).window.cells)
    assert set(levels) <= set(".b"), "grey levels do not show unburned ground"
    assert "b" in levels


def test_the_focal_length_is_that_of_the_scenario_if_given(
    whole: bytes, land: Landscape, tmp_path: Path
) -> None:
    path = written(tmp_path, whole)
    wide = cells_of(path, land, field_of_view_deg=90)
    assert len(wide.window.cells) > 1.8 * len(cells_of(path, land).window.cells)


def test_an_older_image_that_arrives_later_is_not_changed(
    whole: bytes, land: Landscape, tmp_path: Path
) -> None:
    burned = Burned(land.shape)
    burned.added(cells_of(written(tmp_path, whole), land), 20.0)
    pose = pose_above(land, 300.0, 300.0, 0.0, -90.0)
    write_frame(tmp_path / "before.tif", land, pose, np.full((512, 640), 25.0), TAKEN)
    before = cells_of(tmp_path / "before.tif", land)
    assert burned.added(before, 10.0) == before


@pytest.mark.parametrize(
    ("scale", "words"),
    [(1.0, "floats must be in °C"), (25.0, "kelvin_per_count")],
)
def test_values_of_another_unit_are_refused(
    scale: float, words: str, land: Landscape, tmp_path: Path
) -> None:
    pose = pose_above(land, 300.0, 300.0, 0.0, -90.0)
    kelvin = np.full((512, 640), 298.15)
    path = tmp_path / "frame.tif"
    write_frame(path, land, pose, kelvin if scale == 1.0 else (kelvin * scale).astype("u2"), TAKEN)
    with pytest.raises(FireModelError, match=words):
        cells_of(path, land)


def test_an_image_in_which_everything_is_hot_is_refused(land: Landscape, tmp_path: Path) -> None:
    pose = pose_above(land, 300.0, 300.0, 0.0, -90.0)
    path = tmp_path / "frame.tif"
    write_frame(path, land, pose, np.full((512, 640), 255, dtype=np.uint8), TAKEN)
    with pytest.raises(FireModelError, match=r"frame\.tif: nearly all grey levels are hot"):
        cells_of(path, land, hot_level=200)


def test_a_camera_at_the_edge_of_the_landscape_has_no_error_of_zero(
    land: Landscape, tmp_path: Path
) -> None:
    path = tmp_path / "frame.tif"
    write_frame(path, land, pose_above(land, 0, 300, 0.0, -90.0), np.full((512, 640), 25.0), TAKEN)
    found = frame_cells(read_thermal_image(path), land, ThermalFramesSection(field_of_view_deg=1))
    assert found.position_sd_m > 1.5


def test_pixels_with_a_large_error_of_their_place_are_not_seen(
    land: Landscape, tmp_path: Path
) -> None:
    path = tmp_path / "frame.tif"
    pose = pose_above(land, 300.0, 300.0, 0.0, -40.0)
    write_frame(path, land, pose, np.full((512, 640), 25.0), TAKEN)
    every = cells_of(path, land, max_position_sd_m=1000.0)
    limit_m = every.position_sd_m
    some = cells_of(path, land, max_position_sd_m=limit_m)
    assert every.inexact == 0.0
    assert 0.05 < some.inexact < 0.95
    seen, fewer = ("".join(each.window.cells).count("u") for each in (every, some))
    assert 0 < fewer < seen
    assert some.position_sd_m < limit_m
    with pytest.raises(FireModelError, match=r"max_position_sd_m = 1$"):
        cells_of(path, land, max_position_sd_m=1.0)


def test_a_small_file_with_many_pixels_is_cheap(land: Landscape, tmp_path: Path) -> None:
    image = read_thermal_image(tiff_with(tmp_path, land))
    large = image._replace(values=np.zeros((4000, 5000), np.float32), focal_px=6000.0)
    began_s = time.process_time()
    frame_cells(large, land, ThermalFramesSection(hot_level=100))
    assert time.process_time() - began_s < 5.0


def tiff_with(
    folder: Path,
    land: Landscape,
    xmp: tuple[bytes, bytes] = (b"", b""),
    gps: dict[int, Any] | None = None,
    orientation: int = 1,
    colour: tuple[int, int, int] = (20, 20, 20),
) -> Path:
    """Write an image of grey levels or colours with changes in its metadata."""
    pose = pose_above(land, 300.0, 300.0, 0.0, -90.0)
    write_frame(folder / "whole.tif", land, pose, np.zeros((8, 8), np.uint8), TAKEN)
    with Image.open(folder / "whole.tif") as image:
        exif = image.getexif()
        exif.get_ifd(GPS_IFD).update(gps or {})
        for tag in (256, 257, 258, 259, 262, 273, 277, 278, 279):  # of the pixels
            exif.pop(tag, None)
        exif[XMP_TAG] = exif[XMP_TAG].replace(*xmp)
        exif[ORIENTATION] = orientation
        path = folder / "frame.tif"
        Image.new("RGB", (8, 8), colour).save(path, exif=exif)
    return path


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"xmp": (b'PitchDegree="-90.0000"', b'PitchDegree="-90,0000"')}, "float: '-90,0000'"),
        ({"xmp": (b'PitchDegree="-90.0000"', b'PitchDegree=""')}, "no GimbalPitchDegree$"),
        ({"xmp": (b"drone-dji:Cal", b'drone-dji:ImageSource="WideCamera" drone-dji:Cal')}, "Wide"),
        ({"gps": {1: ""}}, "no GPS latitude"),
        ({"gps": {6: 30_000.0}}, r"30000\.0 m"),
        ({"orientation": 6}, "EXIF orientation is 6"),
        ({"colour": (250, 120, 20)}, "is a colour picture"),
    ],
)
def test_odd_metadata_are_refused(
    keys: dict[str, Any], words: str, land: Landscape, tmp_path: Path
) -> None:
    with pytest.raises(ThermalImageError, match=words):
        read_thermal_image(tiff_with(tmp_path, land, **keys))


def test_hemispheres_times_and_packets_of_other_writers_are_read(
    land: Landscape, tmp_path: Path
) -> None:
    plain = read_thermal_image(tiff_with(tmp_path, land))
    end = b"</x:xmpmeta>"
    gps = {1: "North", 3: b"W", 5: b"\x03", 7: (1.0, 2.0, 3.9999999)}
    image = read_thermal_image(tiff_with(tmp_path, land, (end, end + b"<x:xmpmeta>" + end), gps))
    assert image[4:6] == plain[4:6]
    assert image.altitude_amsl_m == -plain.altitude_amsl_m
    assert image.taken.second == 4


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("text.tif", "is not a TIFF, JPEG or PNG image"),
        ("no_position.tif", "EXIF has no GPS latitude, longitude and altitude"),
        ("no_direction.tif", "XMP has no GimbalYawDegree"),
        ("no_time.tif", "EXIF has neither GPS date and time nor"),
        ("missing.tif", "No such file"),
        ("large.tif", "4000 MB; the maximum is 64 MB"),
    ],
)
def test_a_file_that_cannot_be_used_is_named_with_the_reason(
    name: str, words: str, whole: bytes, tmp_path: Path
) -> None:
    path = tmp_path / name
    if name == "text.tif":
        path.write_text("no image")
    elif name == "no_position.tif":
        Image.fromarray(np.zeros((4, 4), dtype=np.float32)).save(path)
    elif name == "no_direction.tif":
        path.write_bytes(whole.replace(b"GimbalYawDegree", b"GimbalYawRadian"))
    elif name == "no_time.tif":
        path.write_bytes(whole.replace(TAKEN.strftime("%Y:%m:%d").encode(), b"0000:00:00"))
    elif name == "large.tif":
        path.touch()
        os.truncate(path, 4_000_000_000)
    with pytest.raises(ThermalImageError, match=words) as raised:
        read_thermal_image(path)
    assert str(path) in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.long
@settings(max_examples=300, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_damaged_files_are_refused_or_read(
    data: st.DataObject, whole: bytes, land: Landscape, tmp_path: Path
) -> None:
    changed = bytearray(whole)
    # The metadata are at both ends of the file.
    places = st.one_of(st.integers(0, 1500), st.integers(len(whole) - 1500, len(whole) - 1))
    for _ in range(data.draw(st.integers(1, 8))):
        changed[data.draw(places)] = data.draw(st.integers(0, 255))
    cut = data.draw(st.one_of(st.just(len(changed)), st.integers(0, len(changed))))
    path = written(tmp_path, bytes(changed[:cut]))
    with contextlib.suppress(ThermalImageError, FireModelError):  # no other errors
        image = read_thermal_image(path)
        assert np.isfinite(image.values).all()
        frame_cells(image, land, ThermalFramesSection(hot_level=100))
