"""Thermal images as files: values, metadata, damage; and the cells that they show."""

import contextlib
import os
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from benchmarks.thermal_frames import LENS, pose_above, rendered, steep_landscape, write_frame
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import ThermalFramesSection
from mission_service.sensors.frame_cells import Burned, FrameCells, frame_cells
from mission_service.sensors.thermal_image import ThermalImageError, read_thermal_image

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


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("text.tif", "is not a TIFF, JPEG or PNG image"),
        ("no_position.tif", "EXIF has no GPS latitude, longitude and altitude"),
        ("no_direction.tif", "XMP has no GimbalYawDegree"),
        ("no_time.tif", "EXIF has neither GPS date and time nor"),
        ("missing.tif", "No such file"),
        ("large.tif", "4000 MB; images up to 64 MB are read"),
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
