"""Thermal images on the ground, as overlays of the map: places, colours, and what is not seen."""

import io
from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from benchmarks.thermal_frames import pose_above, steep_landscape
from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import ThermalFramesSection
from mission_service.events import Telemetry
from mission_service.fire.sensors import MAX_IMAGES, SensorImage, Sensors
from mission_service.interfaces.maps.draped_images import (
    SIDE_PX,
    ImagePictures,
    described,
    image_png,
    overlay_of,
)
from mission_service.interfaces.maps.mercator import lon_lat_of
from mission_service.sensors.thermal.arrived_images import IMAGE_EVERY_S, ArrivedImages
from mission_service.sensors.thermal.camera_geometry import CameraPose, Lens
from mission_service.sensors.thermal.draped_image import draped_image
from mission_service.sensors.thermal.frame_cells import frame_cells
from mission_service.sensors.thermal.ground_points import ground_points
from mission_service.sensors.thermal.image_corners import CornerPoints
from mission_service.sensors.thermal.thermal_image import ThermalImage
from mission_service.simulation.thermal_images import LENS

TAKEN = datetime(2026, 7, 4, tzinfo=UTC)
SETTINGS = ThermalFramesSection(distortion=LENS.distortion, max_position_sd_m=100.0)
HOT_C, COOL_C = 700.0, 20.0
# Columns and rows of the middles of hot spots of 4 x 4 pixels, which are whole blocks of 2 x 2.
SPOTS = [(3.5, 3.5), (635.5, 5.5), (5.5, 505.5), (635.5, 507.5), (319.5, 255.5), (201.5, 401.5)]


@pytest.fixture(scope="module")
def steep() -> Landscape:
    return steep_landscape(30.0)


def image_at(
    landscape: Landscape, pose: CameraPose, values: NDArray[Any], lens: Lens = LENS, **more: Any
) -> ThermalImage:
    """Return an image in °C, or of another ``kind``, with the true pose of its camera."""
    lat_deg, lon_deg = (float(each) for each in landscape.lat_lon_of(pose.x_m, pose.y_m))
    yaw_deg = float(landscape.true_deg(pose.yaw_deg))
    place = (lat_deg, lon_deg, pose.altitude_amsl_m, yaw_deg, pose.pitch_deg, pose.roll_deg)
    kind = more.pop("kind", "celsius")
    return ThermalImage(
        "a.tif", values.astype(np.float32), kind, TAKEN, *place, lens.focal_px, **more
    )


def sensor_image(
    landscape: Landscape, image: ThermalImage, settings: ThermalFramesSection = SETTINGS
) -> SensorImage:
    found = frame_cells(image, landscape, settings)
    draped = draped_image(image, found, settings)
    return SensorImage(
        *(1, 7_200_000_000, "hawk", image.name, draped.bounds, draped.colours),
        *(draped.scale, draped.unit, found.centre, *found.ellipse),
    )


class Overlay(NamedTuple):
    """A PNG of an image, and where it is."""

    rgba: NDArray[np.uint8]
    lon_deg: NDArray[np.float64]  # of the centres of columns
    lat_deg: NDArray[np.float64]  # of the centres of rows

    @property
    def seen(self) -> NDArray[np.bool_]:
        return self.rgba[:, :, 3] > 0

    @property
    def flaming(self) -> NDArray[np.bool_]:
        return self.seen & (self.rgba[:, :, 1] > 200)


def overlay(landscape: Landscape, image: SensorImage) -> Overlay:
    with Image.open(io.BytesIO(image_png(image, landscape))) as picture:
        rgba = np.asarray(picture)
    (west, south, east, north), width, height = overlay_of(image, landscape)
    assert rgba.shape == (height, width, 4)
    assert max(width, height) == SIDE_PX
    x_m = west + (np.arange(width) + 0.5) * (east - west) / width
    y_m = north - (np.arange(height) + 0.5) * (north - south) / height
    return Overlay(rgba, lon_lat_of(x_m, 0.0)[0], lon_lat_of(0.0, y_m)[1])


def with_spots(lens: Lens) -> NDArray[np.float32]:
    values = np.full((lens.height, lens.width), COOL_C, dtype=np.float32)
    for col, row in SPOTS:
        values[round(row - 1.5) : round(row + 2.5), round(col - 1.5) : round(col + 2.5)] = HOT_C
    return values


def off_px(landscape: Landscape, found: Overlay, row: float, col: float) -> float:
    """Return the distance of a grid position from the middle of the nearest spot, in pixels."""
    from scipy.ndimage import center_of_mass, label

    lat, lon = landscape.lat_lon_of(*landscape.xy_of(row, col))
    at_x = (lon - found.lon_deg[0]) / (found.lon_deg[1] - found.lon_deg[0])
    at_y = (lat - found.lat_deg[0]) / (found.lat_deg[1] - found.lat_deg[0])
    spots, count = label(found.flaming, structure=np.ones((3, 3)))
    assert count == len(SPOTS)
    middles = np.array(center_of_mass(found.flaming, spots, range(1, count + 1)))
    return float(np.hypot(middles[:, 0] - at_y, middles[:, 1] - at_x).min())


@pytest.mark.parametrize("pitch_deg", [-90.0, -65.0])
def test_hot_spots_are_where_their_pixels_are_placed(steep: Landscape, pitch_deg: float) -> None:
    pose = pose_above(steep, 100.0, 90.0, 60.0, pitch_deg)._replace(roll_deg=4.0)
    found = overlay(steep, sensor_image(steep, image_at(steep, pose, with_spots(LENS))))
    col, row = np.array(SPOTS, dtype=float).T
    for place in ground_points(steep, LENS, pose, col, row):
        assert off_px(steep, found, *place) < 1.0
    assert 0.2 < found.seen.mean() < 0.9


def test_hot_spots_are_where_corner_points_place_them(steep: Landscape) -> None:
    corner_cells = ((95.0, 90.0), (96.0, 97.0), (102.0, 98.0), (101.0, 89.0))
    lat_lon = [steep.lat_lon_of(*steep.xy_of(*each)) for each in corner_cells]
    corners = CornerPoints(tuple((float(lat), float(lon)) for lat, lon in lat_lon), 5.0)
    pose = pose_above(steep, 100.0, 90.0, 0.0, -90.0)
    image = image_at(steep, pose, with_spots(LENS), corners=corners)
    found = overlay(steep, sensor_image(steep, image))
    places = frame_cells(image, steep, SETTINGS).projection.places(*np.array(SPOTS, dtype=float).T)
    for place in places:
        assert off_px(steep, found, *place) < 1.0


def test_pixels_are_the_inverse_of_places(steep: Landscape) -> None:
    pose = pose_above(steep, 100.0, 90.0, 60.0, -60.0)
    projection = frame_cells(image_at(steep, pose, with_spots(LENS)), steep, SETTINGS).projection
    col, row = np.array(SPOTS, dtype=float).T
    assert np.array(projection.pixels(projection.places(col, row))) == pytest.approx(
        np.array([col, row]), abs=0.01
    )
    behind = np.array([steep.row_col_of(pose.x_m - 400.0, pose.y_m - 400.0)])
    assert np.isnan(projection.pixels(behind)).all()


def test_ground_behind_a_ridge_is_clear() -> None:
    elevation_m = np.full((200, 200), 300.0, dtype=np.float32)
    elevation_m[80:82] = 390.0
    fuel = np.full((200, 200), 1, dtype=np.int16)
    ridge = Landscape("EPSG:32616", 747_000.0, 4_030_000.0, 10.0, fuel, elevation_m)
    x_m, y_m = ridge.xy_of(100.0, 100.0)
    pose = CameraPose(x_m, y_m, 400.0, 0.0, -15.0)
    image = sensor_image(ridge, image_at(ridge, pose, np.full((512, 640), COOL_C)))
    places = np.array([[85.0, 100.0], [81.5, 100.0], [70.0, 100.0], [40.0, 100.0], [99.0, 100.0]])
    assert image.colours(places)[:, 3].tolist() == [255, 255, 0, 0, 0]


def test_inexact_pixels_and_the_sky_are_clear(steep: Landscape) -> None:
    pose = pose_above(steep, 100.0, 90.0, 60.0, -40.0)
    image = image_at(steep, pose, np.full((512, 640), COOL_C))
    near = SETTINGS.model_copy(update={"max_position_sd_m": 5.0})
    shares = [
        overlay(steep, sensor_image(steep, image, each)).seen.sum() for each in (SETTINGS, near)
    ]
    areas = [np.ptp(sensor_image(steep, image, each).bounds) for each in (SETTINGS, near)]
    assert areas[1] < areas[0]
    assert min(shares) > 1000
    found = frame_cells(image, steep, near)
    assert found.inexact > 0.1
    lost = np.argwhere(~found.seen)[:, ::-1].astype(float) * found.step
    places = found.projection.places(*lost.T)
    places = places[np.isfinite(places[:, 0])]
    clear = sensor_image(steep, image, near).colours(places)[:, 3] == 0
    assert clear.mean() > 0.95  # at the edge, a block is seen by its first pixel


def test_one_hot_pixel_of_a_large_image_is_shown(steep: Landscape) -> None:
    lens = Lens(1280, 1024, 2.0 * LENS.focal_px)
    values = np.full((1024, 1280), COOL_C)
    values[333, 777] = HOT_C
    pose = pose_above(steep, 100.0, 90.0, 60.0, -90.0)
    settings = ThermalFramesSection(max_position_sd_m=100.0)
    found = overlay(steep, sensor_image(steep, image_at(steep, pose, values, lens), settings))
    assert found.flaming.any()
    assert found.flaming.sum() < 30


def test_grey_levels_are_grey_below_the_hot_level(steep: Landscape) -> None:
    values = np.tile(np.arange(0.0, 250.0, 2.0).repeat(2)[:240], (200, 1))
    pose = pose_above(steep, 100.0, 90.0, 0.0, -90.0)
    settings = ThermalFramesSection(hot_level=180.0, max_position_sd_m=100.0)
    lens = Lens(240, 200, 240.0)
    image = sensor_image(steep, image_at(steep, pose, values, lens, kind="levels"), settings)
    found = overlay(steep, image)
    colours = found.rgba[found.seen][:, :3].astype(int)
    grey = np.ptp(colours, axis=1) <= 1
    assert 0.65 < grey.mean() < 0.85  # 180 of the levels up to 238
    assert (colours[~grey][:, 0] > colours[~grey][:, 2] + 50).all()
    assert image.unit == "grey level"


def test_the_map_receives_the_stated_error_at_the_hot_pixels(steep: Landscape) -> None:
    pose = pose_above(steep, 100.0, 90.0, 60.0, -65.0)
    values = np.full((512, 640), COOL_C)
    values[250:260, 300:340] = HOT_C
    image = image_at(steep, pose, values)
    found, sent = frame_cells(image, steep, SETTINGS), sensor_image(steep, image)
    shown = described("thermal_frames", sent, steep)
    assert shown.position_sd_m == pytest.approx(found.position_sd_m, abs=0.01)
    assert shown.major_m >= shown.minor_m > 0.0
    row, col = steep.row_col_of(
        *steep.xy_of_lat_lon(np.array(shown.lat_deg), np.array(shown.lon_deg))
    )
    (place,) = ground_points(steep, LENS, pose, np.array([320.0]), np.array([255.0]))
    assert np.hypot(row - place[0], col - place[1]) * steep.cell_size_m < 2.0
    grid_deg = found.ellipse.major_from_grid_north_deg
    turned = shown.major_from_deg - grid_deg - steep.grid_convergence_deg
    assert (turned + 90.0) % 180.0 - 90.0 == pytest.approx(0.0, abs=0.06)
    (west, north), _, (east, south), _ = shown.corners
    assert west < shown.lon_deg < east
    assert south < shown.lat_deg < north


def test_the_latest_images_are_kept_with_the_times_of_their_observations(steep: Landscape) -> None:
    arrived = ArrivedImages(steep, SETTINGS, lambda name, why: pytest.fail(why))
    pose = pose_above(steep, 100.0, 90.0, 60.0, -90.0)
    lens = Lens(64, 48, 60.0)
    for number in range(2 * MAX_IMAGES + 4):
        image = image_at(steep, pose, np.full((48, 64), COOL_C), lens, position_sd_m=0.1)
        taken_s = TAKEN.timestamp() + number * IMAGE_EVERY_S / 2.0
        taken = datetime.fromtimestamp(taken_s, UTC)
        arrived.add_image(image._replace(taken=taken, name=f"{number}"), taken)
        fix = Telemetry(7_200_000_000 + number * 1_000_000, "hawk", 36, -84, 600, 120, 20, 0, 0)
        observed = arrived.next_observed(fix, taken_s)
        assert observed is not None
        assert arrived.images[-1].at_us in (observed.at_us, observed.at_us - 1_000_000)
    assert len(arrived.images) == MAX_IMAGES
    assert [each.name for each in arrived.images][-2:] == ["24", "26"]
    assert {each.vehicle for each in arrived.images} == {"hawk"}

    class Camera:
        images = arrived.images

    class Broken:
        images = ("no image",)

    sensors = Sensors({"thermal": Camera(), "broken": Broken(), "other": object()}, steep.shape)  # type: ignore[dict-item]
    assert sensors.images() == {"thermal": tuple(arrived.images)}
    assert "objects other than SensorImage" in sensors.failed["broken"]


def test_a_picture_is_drawn_once(steep: Landscape) -> None:
    pose = pose_above(steep, 100.0, 90.0, 60.0, -90.0)
    image = sensor_image(
        steep, image_at(steep, pose, np.full((48, 64), COOL_C), Lens(64, 48, 60.0))
    )
    calls = []

    def colours(places: NDArray[np.float64]) -> NDArray[np.uint8]:
        calls.append(places)
        return image.colours(places)

    pictures = ImagePictures(steep)
    for number in (1, 2, 1):
        pictures.png("thermal_frames", image._replace(number=number, colours=colours))
    assert len(calls) == 2
