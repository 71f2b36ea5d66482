"""Radiometric JPEGs of FLIR cameras: temperatures by flyr, pose by EXIF and XMP, damage."""

import struct
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mission_service.errors import MissionServiceError
from mission_service.sensors import worker_process
from mission_service.sensors.thermal import flir_temperatures
from mission_service.sensors.thermal.flir_temperatures import Decoded, Undecoded, decoded
from mission_service.sensors.thermal.thermal_image import read_thermal_image
from mission_service.simulation.thermal_images import GPS_IFD, XMP
from tests.sensors.flir_file import DIRECTORY, ENTRIES, flir_jpeg

SHAPE = (128, 160)
TAKEN = datetime(2026, 7, 4, 13, 5, 6, tzinfo=UTC)


def celsius_of_fire() -> np.ndarray:
    found = np.random.default_rng(1).uniform(15.0, 35.0, SHAPE)
    found[40:60, 70:90] = 650.0
    return found


def count_of_records(count: int) -> bytes:
    return struct.pack(">II", DIRECTORY, count)


@pytest.fixture(scope="module")
def whole() -> bytes:
    exif = Image.Exif()
    exif[GPS_IFD] = {
        1: "N", 2: (36.0, 21.0, 36.0), 3: "W", 4: (84.0, 9.0, 0.0), 5: b"\0", 6: 600.5,
        7: (13.0, 5.0, 6.0), 29: "2026:07:04",
    }  # fmt: skip
    return flir_jpeg(celsius_of_fire(), exif, XMP.format(12.5, -88.0, 0.5, 140.0).encode())


def test_temperatures_and_pose_are_read(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "flir.jpg"
    path.write_bytes(whole)
    found = read_thermal_image(path)
    assert found.kind == "celsius"
    assert found.values.shape == SHAPE, "of the temperatures, not of the picture"
    assert found.values == pytest.approx(celsius_of_fire(), abs=0.2)
    assert found.lat_deg == pytest.approx(36.36)
    assert found.lon_deg == pytest.approx(-84.15)
    assert found.altitude_amsl_m == 600.5
    assert (found.yaw_deg, found.pitch_deg, found.roll_deg) == (12.5, -88.0, 0.5)
    assert found.focal_px == 140.0
    assert found.taken == TAKEN


def test_damaged_temperatures_are_refused_with_the_reason(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "flir.jpg"
    path.write_bytes(whole.replace(count_of_records(ENTRIES), count_of_records(2)))
    with pytest.raises(
        MissionServiceError, match=r"flir\.jpg: its FLIR temperature data are corrupt"
    ):
        read_thermal_image(path)


def test_any_damage_ends_in_temperatures_or_a_reason(whole: bytes) -> None:
    """The count of records is not changed here; see the next test."""
    rng = np.random.default_rng(2)
    kinds = set()
    first = whole.index(count_of_records(ENTRIES)) + 8
    for _ in range(60):
        data = bytearray(whole)
        for place in rng.integers(first, first + 1200, rng.integers(1, 6)):
            data[place] = rng.integers(0, 256)
        found = decoded(bytes(data[: int(rng.choice([len(data), int(rng.integers(len(data)))]))]))
        kinds.add(type(found))
        if isinstance(found, Decoded):
            values = np.frombuffer(found.celsius, dtype=np.float32)
            assert values.size == found.rows * found.cols
            assert np.isfinite(values).all()
        else:
            assert found.reason
            assert "\n" not in found.reason
    assert kinds == {Decoded, Undecoded}


def test_a_file_that_takes_too_long_is_refused(
    whole: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """flyr reads each of the four billion records that a damaged file states."""
    path = tmp_path / "flir.jpg"
    path.write_bytes(whole.replace(count_of_records(ENTRIES), count_of_records(2**32 - 1)))
    monkeypatch.setattr(worker_process, "WITHIN_S", 3.0)
    with pytest.raises(MissionServiceError, match=r"flir\.jpg: .* takes more than 3 s"):
        read_thermal_image(path)


def test_without_the_library_the_extra_is_named(
    whole: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "flir.jpg"
    path.write_bytes(whole)
    monkeypatch.setattr(flir_temperatures, "find_spec", lambda name: None)
    with pytest.raises(MissionServiceError, match=r"pip install 'mission-service\[flir\]'"):
        read_thermal_image(path)
