"""Convert the pixels of a thermal image to observed cells of the landscape's grid. Pure.

Each pixel is hot, warm or cool. Hot pixels show burning ground. Warm pixels are warmer than the
background, which is the most frequent temperature of all pixels that are not hot. Ground that has
burned stays warm, but sunlit ground is warm, too. Therefore, warm pixels count as burned out only
if they are connected to hot pixels, and as unknown otherwise. A cell is burned if most of its
pixels are hot or burned out, unburned if nearly all of its pixels are cool, and unseen otherwise.
In a cell beside a burned cell, it is enough if two thirds of the pixels are cool, because the front
passes through such cells. Otherwise, the first cells ahead of the front would be unseen, and an
estimate that spreads too fast would not be corrected. Cells that are only partly in the image are
unseen, because their pixels may show the neighbouring cell. Ground that has burned out and cooled
looks like unburned ground; therefore, cells that an earlier image of the sensor showed as burned
stay burned (``Burned``). A grey-level image has no temperatures: its pixels are hot or unknown.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, Mask, widened, window_at
from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import ThermalCameraSection, ThermalFramesSection
from mission_service.fire.observed_window import LETTERS, Window, in_letters, states_in
from mission_service.sensors.thermal.frame_matching import reduced
from mission_service.sensors.thermal.frame_registration import FrameRegistration
from mission_service.sensors.thermal.ground_points import ErrorEllipse, ellipse_of
from mission_service.sensors.thermal.ground_projections import (
    CornerProjection,
    PoseProjection,
    projection_of,
    stated_errors,
)
from mission_service.sensors.thermal.thermal_image import ThermalImage

BACKGROUND_C, STEP_C = (-60.0, 200.0), 2.0
COOL, BURNED_OUT, HOT, UNKNOWN = 0, 1, 2, 3
KELVIN_C = 273.15
MOST = 0.5  # fraction of hot and burned-out pixels in a burned cell
NEARLY_ALL, AT_FRONT = 0.95, 0.67  # fraction of cool pixels in an unburned cell
MIN_PIXELS = 4  # per cell
MAX_OFFSET = 0.15  # cells, from a cell's centre to the mean of its pixels; 0.25 if half is seen
MIN_NOT_HOT = 0.01  # fraction of the pixels
MAX_RAYS = 100_000  # in a larger image, only every second, third, ... row and column is used
ERRORS_EVERY = 4  # spacing of the rows and columns for which errors are computed


class FrameCells(NamedTuple):
    """The cells of the landscape that an image shows, with the errors of their positions."""

    window: Window
    hot_pixels: int  # that show ground of the landscape
    position_sd_m: float  # along each axis, the mean over the pixels of the ellipse
    ellipse: ErrorEllipse  # mean of the hot pixels, or of all seen pixels if none is hot
    centre: tuple[float, float]  # grid position (row, column) of the ellipse
    matches: int  # tie points with earlier images
    inexact: float  # fraction of the pixels that are not used because of their position error
    projection: PoseProjection | CornerProjection  # after the registration
    step: int  # every ``step``-th row and column of the image was used
    seen: Mask  # (y, x) of these pixels, those that are used and show the landscape


class Burned:
    """The cells that earlier images of one sensor showed as burned.

    ``since_s`` (y, x) is the time of the first such image, infinity in other cells.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        self.since_s: Floats = np.full(shape, np.inf)

    def added(self, found: FrameCells, taken_s: float) -> FrameCells:
        """Return an image's cells, keeping earlier burned cells burned; store new burned cells.

        Images may arrive in any order; ``taken_s`` is the time of the image.
        """
        window = found.window
        state = states_in(window.cells)
        here = self.since_s[window_at(window.row, window.col, state.shape)]
        kept = np.where((here <= taken_s) & (state == UNBURNED), BURNED, state)
        here[state == BURNED] = np.minimum(here[state == BURNED], taken_s)
        return found._replace(window=window._replace(cells=in_letters(LETTERS[kept])))


def frame_cells(
    image: ThermalImage,
    landscape: Landscape,
    settings: ThermalCameraSection,
    registration: FrameRegistration | None = None,
) -> FrameCells:
    """Return the cells that a thermal image shows, with the errors of their positions.

    With ``registration``, the image is registered to the preceding images. Pixels whose position
    has a larger standard deviation than ``max_position_sd_m`` are unseen.

    Raises FireModelError, whose text names the image, if the image shows no ground of the
    landscape, if the settings do not determine its lens or its hot pixels, or if its values are
    implausible.
    """
    try:
        return _cells_of(image, landscape, settings, registration)
    except FireModelError as error:
        raise FireModelError(f"{image.name}: {error}") from None


def _cells_of(
    image: ThermalImage,
    landscape: Landscape,
    settings: ThermalCameraSection,
    registration: FrameRegistration | None,
) -> FrameCells:
    height, width = image.values.shape
    projection: PoseProjection | CornerProjection = projection_of(image, landscape, settings)
    kinds = kinds_of(image, settings)
    matches = 0
    if registration is not None and isinstance(projection, PoseProjection):
        still = (kinds == COOL) | (kinds == UNKNOWN)
        errors, taken_s = stated_errors(settings, image), image.taken.timestamp()
        frame = reduced(image.values, still, projection.lens, projection.pose, errors, taken_s)
        pose, covariance, matches = registration.registered(frame)
        projection = projection._replace(pose=pose, covariance=covariance)
    step = math.ceil(math.sqrt(width * height / MAX_RAYS))
    kinds = kinds[::step, ::step]
    col, row = (
        each.astype(float)
        for each in np.meshgrid(np.arange(0, width, step), np.arange(0, height, step))
    )
    places = projection.places(col.ravel(), row.ravel())
    found = np.isfinite(places[:, 0])
    if not found.any():
        raise FireModelError("shows no ground of the landscape")
    some = places.reshape(*kinds.shape, 2)[::ERRORS_EVERY, ::ERRORS_EVERY]
    spread = projection.covariances(some.reshape(-1, 2)).reshape(*some.shape[:2], 2, 2)
    sd_m = np.sqrt(np.trace(spread, axis1=2, axis2=3) / 2.0)
    max_sd_m = settings.max_position_sd_m if isinstance(projection, PoseProjection) else math.inf
    exact = _repeated(sd_m <= max_sd_m, kinds.shape)
    seen = found & exact.ravel()
    if not seen.any():
        raise FireModelError(
            f"the standard deviation of its position is at least {np.nanmin(sd_m):.1f} m; "
            f"{settings.TABLE}.max_position_sd_m = {settings.max_position_sd_m:g}"
        )
    shown = seen.reshape(kinds.shape) & (kinds == HOT)
    hot_pixels = int(np.count_nonzero(shown)) * step * step
    if not hot_pixels:
        shown = seen.reshape(kinds.shape)
    shown &= np.isfinite(_repeated(sd_m, kinds.shape))
    mean = _repeated(spread, kinds.shape)[shown].mean(axis=0)
    middle = places[shown.ravel()].mean(axis=0)
    return FrameCells(
        _window_of(places[seen], kinds.ravel()[seen], landscape.shape),
        hot_pixels,
        float(np.sqrt(np.trace(mean) / 2.0)),
        ellipse_of(mean),
        (float(middle[0]), float(middle[1])),
        matches,
        1.0 - float(np.count_nonzero(seen) / np.count_nonzero(found)),
        projection,
        step,
        seen.reshape(kinds.shape),
    )


def _repeated(values: NDArray[Any], shape: tuple[int, int]) -> NDArray[Any]:
    """Repeat the values of every ``ERRORS_EVERY``-th pixel for all pixels (y, x)."""
    rows, cols = (np.arange(size) // ERRORS_EVERY for size in shape)
    found: NDArray[Any] = values[rows[:, None], cols]
    return found


def kinds_of(image: ThermalImage, settings: ThermalCameraSection) -> NDArray[np.int8]:
    """Return the kind (y, x) of each pixel: COOL, BURNED_OUT, HOT or UNKNOWN.

    Raises FireModelError for a grey-level image if the settings have no ``hot_level``, and for any
    image in which nearly all pixels are hot or most are colder than any ground, because the unit or
    the range of such an image is probably wrong.
    """
    values = image.values
    if image.kind == "levels":
        if settings.hot_level is None:
            raise FireModelError(
                f"contains grey levels instead of temperatures; set {settings.TABLE}.hot_level"
            )
        if np.mean(values < settings.hot_level) < MIN_NOT_HOT:
            raise FireModelError(
                f"nearly all grey levels are hot; check {settings.TABLE}.hot_level"
            )
        return np.where(values >= settings.hot_level, HOT, UNKNOWN).astype(np.int8)
    values = celsius_of(image, settings)
    hot = values >= settings.hot_c
    if np.mean(~hot) < MIN_NOT_HOT or np.median(values) < BACKGROUND_C[0]:
        raise FireModelError(
            f"the median is {np.median(values):.0f} °C; floats must be in "
            "°C, and counts require estimate.thermal_frames.kelvin_per_count"
        )
    warm = values > _background_c(values[~hot]) + settings.warm_difference_c
    kinds = np.where(hot, HOT, np.where(warm, UNKNOWN, COOL)).astype(np.int8)
    kinds[_connected(hot | warm, hot) & ~hot] = BURNED_OUT
    return kinds


def celsius_of(image: ThermalImage, settings: ThermalCameraSection) -> NDArray[np.float32]:
    """Return the temperatures (y, x) in °C of an image of temperatures or counts."""
    if image.kind == "counts" and isinstance(settings, ThermalFramesSection):
        return image.values * np.float32(settings.kelvin_per_count) - np.float32(KELVIN_C)
    return image.values


def _connected(mask: Mask, to: Mask) -> Mask:
    """Return the regions of a mask (y, x) that contain a pixel of ``to``; diagonals connect."""
    from scipy.ndimage import label

    regions, count = label(mask, structure=np.ones((3, 3)))
    chosen = np.zeros(count + 1, dtype=bool)
    chosen[regions[to]] = True
    found: Mask = chosen[regions]
    return found


def _background_c(values_c: NDArray[np.float32]) -> float:
    """Return the most frequent of the temperatures (n,), in steps; 0 °C if there are none."""
    steps = np.clip(values_c, *BACKGROUND_C) - BACKGROUND_C[0]
    counts = np.bincount((steps / STEP_C).astype(np.int64), minlength=1)
    return BACKGROUND_C[0] + STEP_C * (float(counts.argmax()) + 0.5) if values_c.size else 0.0


def _window_of(places: Floats, kinds: NDArray[np.int8], shape: tuple[int, int]) -> Window:
    """Return the states of the cells around the positions (n, 2) of seen pixels."""
    cells = np.rint(places).astype(np.int64)
    top, left = (int(each) for each in cells.min(axis=0))
    rows, cols = (int(each) for each in cells.max(axis=0) - (top, left) + 1)
    number = (cells[:, 0] - top) * cols + cells[:, 1] - left
    counted = [
        np.bincount(number[kinds == kind], minlength=rows * cols).reshape(rows, cols)
        for kind in (COOL, BURNED_OUT, HOT)
    ]
    cool, burned_out, hot = counted
    pixels = np.bincount(number, minlength=rows * cols).reshape(rows, cols)
    offsets = (np.bincount(number, each, rows * cols) for each in (places - cells).T)
    row_offset, col_offset = (each.reshape(rows, cols) / np.maximum(pixels, 1) for each in offsets)
    enough = (pixels >= MIN_PIXELS) & (np.hypot(row_offset, col_offset) <= MAX_OFFSET)
    state = np.full((rows, cols), UNSEEN, dtype=np.uint8)
    state[enough & (hot + burned_out >= MOST * pixels)] = BURNED
    at_front = widened(state == BURNED, 1) & (cool >= AT_FRONT * pixels)
    state[enough & ((cool >= NEARLY_ALL * pixels) | at_front)] = UNBURNED
    assert 0 <= top <= shape[0] - rows
    assert 0 <= left <= shape[1] - cols
    return Window(top, left, in_letters(LETTERS[state]))
