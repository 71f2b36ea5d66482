"""Images of one pass, registered to each other; ``benchmarks.registered_frames`` has the table."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from benchmarks.registered_frames import IMAGES, SMALL, errors_of, image_of, texture
from benchmarks.thermal_frames import ERRORS, pose_above, pose_error, steep_landscape
from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import ThermalFramesSection
from mission_service.sensors.thermal.camera_geometry import CameraPose, moved, pixels_of
from mission_service.sensors.thermal.frame_cells import frame_cells
from mission_service.sensors.thermal.frame_matching import Frame, Match, Ties, reduced, ties_between
from mission_service.sensors.thermal.frame_registration import FrameRegistration
from mission_service.sensors.thermal.ground_points import ground_points, offsets_m
from mission_service.sensors.thermal.pose_adjustment import adjusted
from mission_service.sensors.thermal.telemetry_poses import TelemetryPose
from mission_service.sensors.thermal.thermal_image import read_thermal_image
from mission_service.simulation.thermal_images import write_frame

APART_CELLS = 3.0  # 30 m
STEADY = np.ones((SMALL.height, SMALL.width), dtype=bool)
NO_VALUES = np.zeros((2, 2), np.float32)
TAKEN = datetime(2026, 7, 4, 13, 5, tzinfo=UTC)


@pytest.fixture(scope="module")
def land() -> Landscape:
    return steep_landscape(10.0)


def poses_of(land: Landscape, count: int = IMAGES, pitch_deg: float = -75.0) -> list[CameraPose]:
    """Return true poses on a line to the north."""
    rows = 300.0 - APART_CELLS * np.arange(count)
    return [pose_above(land, float(row), 250.0, 0.0, pitch_deg) for row in rows]


@pytest.fixture(scope="module")
def images(land: Landscape) -> list[Floats]:
    """Return three images of textured ground."""
    rng = np.random.default_rng(3)
    warmth_c = texture(rng)
    return [image_of(land, warmth_c, pose, 0.0 * STEADY, rng) for pose in poses_of(land, 3)]


def frame_of(celsius: Floats, pose: CameraPose, taken_s: float = 0.0) -> Frame:
    return reduced(celsius.astype(np.float32), STEADY, SMALL, pose, ERRORS, taken_s)


def test_matches_are_the_same_ground(land: Landscape, images: list[Floats]) -> None:
    true = poses_of(land, 2)
    rng = np.random.default_rng(5)
    one, other = (
        frame_of(celsius, moved(pose, pose_error(rng)))
        for celsius, pose in zip(images, true, strict=False)
    )
    ties = ties_between(land, one, other)
    assert ties is not None
    assert ties.match_sd_m.size >= 4
    first_m, second_m = (
        ground_points(land, SMALL, pose, *pixels.T) * land.cell_size_m
        for pose, pixels in zip(true, (ties.earlier, ties.later), strict=True)
    )
    assert np.linalg.norm(first_m - second_m, axis=1) == pytest.approx(0.0, abs=0.5)
    by_pose_m = ground_points(land, SMALL, one.pose, *ties.earlier.T) * land.cell_size_m
    assert np.linalg.norm(by_pose_m - first_m, axis=1).min() > 0.7, "the poses are wrong by more"


def test_nothing_matches_without_texture_or_steady_ground_or_overlap(
    land: Landscape, images: list[Floats]
) -> None:
    rng = np.random.default_rng(6)
    one, other, far = (
        frame_of(celsius, pose) for celsius, pose in zip(images, poses_of(land, 3), strict=True)
    )
    assert ties_between(land, one, other) is not None
    for bare_c in (0.0, 0.1):
        bare, noise = (
            frame_of(rng.normal(25.0, bare_c, STEADY.shape), each.pose) for each in (one, other)
        )
        assert ties_between(land, bare, noise) is None
    assert ties_between(land, one, other._replace(steady=~STEADY)) is None
    assert ties_between(land, one, one) is None, "a fixed pattern would match"
    away = far._replace(pose=far.pose._replace(x_m=far.pose.x_m + 500.0))
    assert ties_between(land, one, away) is None


def test_images_that_match_nothing_keep_their_pose(land: Landscape) -> None:
    registration = FrameRegistration(land)
    rng = np.random.default_rng(7)
    for number, pose in enumerate(poses_of(land, 3)):
        frame = frame_of(rng.normal(25.0, 0.1, STEADY.shape), pose, float(number))
        found = registration.registered(frame)
        assert found.matches == 0
        assert found.covariance == pytest.approx(ERRORS.covariance())
        assert offset(found.pose, pose) == pytest.approx(0.0, abs=1e-9)


def offset(one: CameraPose, other: CameraPose) -> float:
    return float(np.linalg.norm(np.subtract(one[:3], other[:3])))


def matched(
    land: Landscape, true: list[CameraPose], errors: Floats, rng: np.random.Generator
) -> tuple[list[Frame], list[Match]]:
    """Return images without values, and what their true poses make them share."""
    frames = [
        Frame(NO_VALUES, NO_VALUES > 0.0, SMALL, moved(pose, error), ERRORS, 0.0)
        for pose, error in zip(true, errors, strict=True)
    ]
    col, row = (
        each.ravel() for each in np.meshgrid([16.0, 80.0, 144.0], [16.0, 50.0, 80.0, 110.0])
    )
    matches = []
    for later in range(1, len(true)):
        places = ground_points(land, SMALL, true[later], col, row)
        for earlier in range(max(0, later - 2), later):
            seen = np.column_stack(
                pixels_of(SMALL, true[earlier], offsets_m(land, true[earlier], places))
            )
            here = (np.abs(seen / [159.0, 127.0] - 0.5) < 0.5).all(axis=1)
            pixels = np.column_stack([col, row])[here] + rng.normal(0.0, 0.1, (here.sum(), 2))
            ties = Ties(seen[here], pixels, np.full(pixels.shape[0], 0.2))
            matches.append(Match(frames[earlier], frames[later], ties))
    return frames, matches


@pytest.mark.parametrize("own", [1.0, 0.0])
def test_the_adjustment_averages_errors_and_states_what_remains(
    land: Landscape, own: float
) -> None:
    """Independent errors become smaller; of constant ones, no smaller error is stated than true."""
    rng = np.random.default_rng(8)
    true = poses_of(land, 4)
    squares, measured_m, adjusted_m = [], [], []
    for _ in range(7):
        errors = errors_of(own, rng)[:4]
        found, covariance = adjusted(land, *matched(land, true, errors, rng))
        off = errors[-1] - found
        squares.append(off @ np.linalg.solve(covariance, off))
        measured_m.append(np.hypot(*errors[-1, :2]))
        adjusted_m.append(np.hypot(*off[:2]))
    assert np.mean(adjusted_m) < (0.75 if own else 1.05) * np.mean(measured_m)
    # The mean of chi square of six degrees of freedom is 6, its standard deviation here 1.3.
    assert np.mean(squares) < 10.0


def test_wrong_matches_change_little(land: Landscape) -> None:
    rng = np.random.default_rng(9)
    true, errors = poses_of(land, 4), errors_of(1.0, rng)[:4]
    frames, matches = matched(land, true, errors, rng)
    right, _ = adjusted(land, frames, matches)
    for number, (_, _, ties) in enumerate(matches):
        wrong = ties.earlier.copy()
        wrong[number % wrong.shape[0]] += [12.0, -9.0]  # 10 m
        matches[number] = matches[number]._replace(ties=ties._replace(earlier=wrong))
    found, _ = adjusted(land, frames, matches)
    assert np.hypot(*(found - right)[:2]) < 0.5
    all_wrong = [
        match._replace(ties=match.ties._replace(earlier=match.ties.earlier + 60.0))
        for match in matches
    ]
    found, covariance = adjusted(land, frames, all_wrong)
    assert np.abs(found).max() < 0.01, "improbable by the stated errors"
    assert covariance == pytest.approx(ERRORS.covariance(), rel=0.01, abs=2e-6)


def test_images_of_other_times_and_old_images_are_not_used(
    land: Landscape, images: list[Floats]
) -> None:
    one, other, _ = (
        frame_of(celsius, pose) for celsius, pose in zip(images, poses_of(land, 3), strict=True)
    )
    registration = FrameRegistration(land)
    assert registration.registered(one).matches == 0
    found = registration.registered(other._replace(taken_s=1.5))
    assert found.matches >= 4
    assert (np.diag(found.covariance) < np.diag(ERRORS.covariance())).all()
    assert registration.registered(other._replace(taken_s=1000.0)).matches == 0


def pose_from_telemetry(land: Landscape, pose: CameraPose, position_sd_m: float) -> TelemetryPose:
    lat_deg, lon_deg = land.lat_lon_of(pose.x_m, pose.y_m)
    direction = (float(land.true_deg(pose.yaw_deg)), pose.pitch_deg, pose.roll_deg)
    view_deg = float(np.rad2deg(2.0 * np.arctan(SMALL.width / 2.0 / SMALL.focal_px)))
    place = (float(lat_deg), float(lon_deg), pose.altitude_amsl_m)
    return TelemetryPose(TAKEN, *place, direction, view_deg, position_sd_m, 0.0)


@pytest.mark.parametrize("telemetry", [False, True])
def test_cells_of_files_are_registered(
    land: Landscape, images: list[Floats], tmp_path: Path, telemetry: bool
) -> None:
    """The pose of the last image is wrong by 3 m; it is in the file, or comes from telemetry."""
    section = ThermalFramesSection(distortion=SMALL.distortion)
    registration = FrameRegistration(land)
    true = poses_of(land, 3)
    wrong = [true[0], true[1], true[2]._replace(x_m=true[2].x_m + 3.0)]
    found, alone = [], []
    for number, (celsius, pose) in enumerate(zip(images, wrong, strict=True)):
        path, taken = tmp_path / f"{number}.tif", TAKEN.replace(second=number)
        write_frame(path, land, None if telemetry else pose, celsius, taken, SMALL)
        reported = pose_from_telemetry(land, pose, 1.0)._replace(taken=taken)
        image = read_thermal_image(path, lambda *_, reported=reported: reported)
        found.append(frame_cells(image, land, section, registration))
        alone.append(frame_cells(image, land, section))
    assert [each.matches > 0 for each in found] == [False, True, True]
    assert found[2].position_sd_m < 0.9 * alone[2].position_sd_m
    write_frame(path, land, true[2], images[2], TAKEN, SMALL)
    centre = frame_cells(read_thermal_image(path), land, section).centre
    off_m = [
        float(np.hypot(*np.subtract(each[2].centre, centre))) * land.cell_size_m
        for each in (found, alone)
    ]
    assert off_m[0] < off_m[1] - 0.3


def test_the_less_exact_pose_is_corrected_more(land: Landscape) -> None:
    """The poses of two images disagree by 4 m; one of them is stated to be exact."""
    rng = np.random.default_rng(10)
    errors = np.zeros((2, 6))
    errors[1, 0] = 4.0
    exact = ERRORS._replace(position_sd_m=0.3)
    found_m = []
    for stated in ((exact, ERRORS), (ERRORS, exact)):
        frames, matches = matched(land, poses_of(land, 2), errors, rng)
        frames = [each._replace(errors=one) for each, one in zip(frames, stated, strict=True)]
        found, _ = adjusted(land, frames, [Match(frames[0], frames[1], matches[0].ties)])
        found_m.append(found[0])
    assert found_m[0] > 1.0 > 4.0 * found_m[1]
