"""Places of pixels on the ground, and their errors; ``benchmarks.thermal_frames`` has the table."""

import math

import numpy as np
import pytest

from benchmarks.thermal_frames import georeferenced, pose_above, steep_landscape
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.sensors.thermal.camera_geometry import (
    CameraPose,
    Lens,
    PoseErrors,
    axes_of,
    focal_px_of,
    moved,
    pixels_of,
    undistorted,
)
from mission_service.sensors.thermal.ground_points import (
    covariances,
    elevation_sds_m,
    ellipse_of,
    ground_points,
    offsets_m,
    pose_effects,
)
from mission_service.simulation.thermal_images import LENS

MIDDLE = (np.array([319.5]), np.array([255.5]))
STRAIGHT = Lens(640, 512, focal_px_of(45.0, 640))


@pytest.fixture(scope="module")
def flat() -> Landscape:
    fuel = np.full((200, 200), 1, dtype=np.int16)
    level = np.full((200, 200), 300.0, dtype=np.float32)
    return Landscape("EPSG:32616", 747_000.0, 4_030_000.0, 10.0, fuel, level)


def east_north_m(
    land: Landscape, pose: CameraPose, lens: Lens, col: float, row: float
) -> list[float]:
    (place,) = ground_points(land, lens, pose, np.array([col]), np.array([row]))
    x_m, y_m = land.xy_of(*place)
    return [float(x_m) - pose.x_m, float(y_m) - pose.y_m]


def test_pixels_over_flat_ground_are_where_trigonometry_places_them(flat: Landscape) -> None:
    x_m, y_m = flat.xy_of(100.0, 100.0)
    down = CameraPose(x_m, y_m, 400.0, 0.0, -90.0)
    half_m = 100.0 * math.tan(math.radians(22.5))
    assert east_north_m(flat, down, STRAIGHT, 319.5, 255.5) == pytest.approx([0.0, 0.0], abs=0.01)
    right = east_north_m(flat, down, STRAIGHT, 639.5, 255.5)
    assert right == pytest.approx([half_m, 0.0], abs=0.01)
    top = east_north_m(flat, down, STRAIGHT, 319.5, -0.5)
    assert top == pytest.approx([0.0, half_m * 0.8], abs=0.01)
    ahead = down._replace(yaw_deg=90.0, pitch_deg=-45.0)
    assert east_north_m(flat, ahead, STRAIGHT, 319.5, 255.5) == pytest.approx(
        [100.0, 0.0], abs=0.01
    )
    turned = down._replace(yaw_deg=90.0)
    assert east_north_m(flat, turned, STRAIGHT, 319.5, -0.5) == pytest.approx(
        [half_m * 0.8, 0.0], abs=0.01
    )
    rolled = down._replace(pitch_deg=-45.0, roll_deg=90.0)  # the image's right side points down
    assert east_north_m(flat, rolled, STRAIGHT, 639.5, 255.5)[1] < 100.0


def test_axes_are_perpendicular_and_of_unit_length() -> None:
    axes = axes_of(CameraPose(0.0, 0.0, 0.0, 33.0, -52.0, 12.0))
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(axes) == pytest.approx(-1.0)  # right, up, forward


def test_the_inverse_of_the_distortion_is_exact() -> None:
    k1, k2, p1, p2, k3 = LENS.distortion
    col, row = (
        each.ravel() for each in np.meshgrid(np.linspace(0, 639, 9), np.linspace(0, 511, 9))
    )
    x, y = undistorted(LENS, col, row)
    r2 = x * x + y * y
    radial = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    right = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    down = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    assert right * LENS.focal_px + 319.5 == pytest.approx(col, abs=1e-3)
    assert down * LENS.focal_px + 255.5 == pytest.approx(row, abs=1e-3)


def test_the_sky_and_ground_beyond_the_landscape_are_not_seen(flat: Landscape) -> None:
    x_m, y_m = flat.xy_of(100.0, 100.0)
    level = CameraPose(x_m, y_m, 400.0, 0.0, 0.0)
    col, row = np.array([319.5, 319.5, 319.5]), np.array([0.0, 255.5, 511.0])
    found = ground_points(flat, STRAIGHT, level, col, row)
    assert np.isnan(found[:2]).all()
    assert np.isfinite(found[2]).all()


def test_a_ridge_hides_the_ground_behind_it(flat: Landscape) -> None:
    elevation = np.full((200, 200), 300.0, dtype=np.float32)
    elevation[80:82] = 390.0
    ridge = Landscape("EPSG:32616", 747_000.0, 4_030_000.0, 10.0, flat.fuel_model, elevation)
    x_m, y_m = ridge.xy_of(100.0, 100.0)
    ahead = CameraPose(x_m, y_m, 400.0, 0.0, -15.0)
    (place,) = ground_points(ridge, STRAIGHT, ahead, *MIDDLE)
    assert 79.0 < place[0] < 83.0
    (behind,) = ground_points(flat, STRAIGHT, ahead, *MIDDLE)
    assert behind[0] < 70.0


@pytest.mark.parametrize("pitch_deg", [-90.0, -45.0, 10.0])
def test_a_pose_with_an_error_is_moved_and_turned_about_its_axes(pitch_deg: float) -> None:
    pose = CameraPose(100.0, 200.0, 300.0, 33.0, pitch_deg, 12.0)
    turn = 1e-3
    for number, (one, other) in enumerate([(1, 2), (2, 0), (0, 1)]):  # right, up, forward
        error = np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.0])
        error[3 + number] = turn
        found = moved(pose, error)
        assert found[:3] == pytest.approx((101.0, 202.0, 303.0))
        before, after = axes_of(pose), axes_of(found)
        assert after[number] == pytest.approx(before[number], abs=1e-5)
        assert after[one] @ before[other] == pytest.approx(-turn, rel=0.01)


def test_places_are_shown_by_the_pixels_that_show_them() -> None:
    landscape = steep_landscape(30.0)
    pose = pose_above(landscape, 100.0, 90.0, 60.0, -50.0)._replace(roll_deg=4.0)
    col, row = (each.ravel() for each in np.meshgrid(np.linspace(0, 639, 9), [0.0, 255.5, 511.0]))
    places = ground_points(landscape, LENS, pose, col, row)
    found = pixels_of(LENS, pose, offsets_m(landscape, pose, places))
    assert np.array(found) == pytest.approx(np.array([col, row]), abs=0.01)
    behind = np.array([[0.0, 0.0, 100.0]])
    assert np.isnan(pixels_of(LENS, pose, behind)).all()


def test_the_effects_of_errors_are_the_displacements_that_they_cause() -> None:
    landscape = steep_landscape(30.0)
    pose = pose_above(landscape, 100.0, 90.0, 60.0, -70.0)
    col, row = (each.ravel() for each in np.meshgrid([40.0, 300.0, 600.0], [30.0, 250.0, 500.0]))
    places = ground_points(landscape, LENS, pose, col, row)
    effects = pose_effects(landscape, pose, places)
    for number in range(6):
        error = np.zeros(6)
        error[number] = 0.01 if number < 3 else 1e-4
        shift = ground_points(landscape, LENS, moved(pose, error), col, row) - places
        east_north_m = np.column_stack([shift[:, 1], -shift[:, 0]]) * landscape.cell_size_m
        assert effects @ error == pytest.approx(east_north_m, abs=1e-3)


def test_the_error_of_the_elevation_includes_its_interpolation(flat: Landscape) -> None:
    x_m = np.arange(200) * 10.0
    bowl_m = np.tile(300.0 + 0.001 * x_m**2, (200, 1)).astype(np.float32)
    bowl = Landscape("EPSG:32616", 747_000.0, 4_030_000.0, 10.0, flat.fuel_model, bowl_m)
    places = np.array([[50.0, 20.5], [np.nan, np.nan]])
    assert elevation_sds_m(flat, places, 2.0)[0] == 2.0
    found = elevation_sds_m(bowl, places, 0.0)
    between = np.linspace(20.0, 21.0, 101)
    parabola_m = 300.0 + 0.001 * (between * 10.0) ** 2
    chord_m = np.interp(between, [20.0, 21.0], bowl_m[0, 20:22])
    assert found[0] == pytest.approx(np.sqrt(np.mean((parabola_m - chord_m) ** 2)), rel=0.15)
    assert np.isnan(found[1])


@pytest.mark.parametrize("cell_size_m", [30.0, 10.0])
def test_errors_over_steep_ground_are_small_and_as_stated(cell_size_m: float) -> None:
    """The mean slope is 35 degrees; the stated ellipses contain 90 % of the true places."""
    rng = np.random.default_rng(7)
    ground, landscape = steep_landscape(5.0), steep_landscape(cell_size_m)
    every = [
        georeferenced(ground, landscape, pitch, frames=40, rng=rng)
        for pitch in (-90.0, -60.0, -45.0)
    ]
    for found, flat_m in every:
        assert found.mean_error_m < 4.7
        assert flat_m > 2.0 * found.mean_error_m
        assert found.inexact < 0.1
    assert np.mean([found.mean_error_m for found, _ in every]) < 4.2
    assert 0.85 < np.mean([found.covered for found, _ in every]) < 0.95


def test_the_ellipse_of_a_tilted_camera_is_long_along_its_view(flat: Landscape) -> None:
    pose = pose_above(flat, 100.0, 100.0, 60.0, -35.0)
    errors = PoseErrors(0.1, 2.0, 0.5, 0.0)
    effects = pose_effects(flat, pose, ground_points(flat, STRAIGHT, pose, *MIDDLE))
    (covariance,) = covariances(effects, errors.covariance(), np.zeros(1))
    ellipse = ellipse_of(covariance)
    assert ellipse.major_m > 1.5 * ellipse.minor_m
    assert ellipse.major_from_grid_north_deg == pytest.approx(60.0, abs=2.0)
    # 2 m of altitude, and 0.5 degrees of pitch at a slant range of 120 m / sin(35 degrees).
    pitch_m = math.radians(0.5) * 120.0 / math.sin(math.radians(35.0)) ** 2
    expected_m = math.hypot(2.0 / math.tan(math.radians(35.0)), pitch_m, 0.1)
    assert ellipse.major_m == pytest.approx(expected_m, rel=0.02)
    (with_ground,) = covariances(effects, errors.covariance(), np.full(1, 2.0))
    expected_m = math.hypot(expected_m, 2.0 / math.tan(math.radians(35.0)))
    assert ellipse_of(with_ground).major_m == pytest.approx(expected_m, rel=0.02)


def test_the_ellipse_of_a_camera_that_looks_down_has_errors_to_all_sides(flat: Landscape) -> None:
    pose = pose_above(flat, 100.0, 100.0, 60.0, -90.0)
    effects = pose_effects(flat, pose, ground_points(flat, STRAIGHT, pose, *MIDDLE))
    turned = PoseErrors(0.0, 0.0, 0.5, 0.0).covariance()
    ellipse = ellipse_of(covariances(effects, turned, np.zeros(1))[0])
    expected_m = 120.0 * math.radians(0.5)
    assert (ellipse.major_m, ellipse.minor_m) == pytest.approx((expected_m, expected_m), rel=0.01)


def test_a_camera_below_the_ground_or_off_the_landscape_is_refused(flat: Landscape) -> None:
    pose = pose_above(flat, 100.0, 100.0, 0.0, -90.0)
    with pytest.raises(FireModelError, match="50 m below the ground"):
        ground_points(flat, STRAIGHT, pose._replace(altitude_amsl_m=250.0), *MIDDLE)
    with pytest.raises(FireModelError, match="not above the landscape"):
        ground_points(flat, STRAIGHT, pose._replace(x_m=0.0), *MIDDLE)
