"""Convert the thermal images of one sensor to observations as the images arrive."""

from collections import deque
from collections.abc import Callable
from datetime import datetime

from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import ThermalCameraSection
from mission_service.errors import MissionServiceError
from mission_service.events import Observed, Telemetry
from mission_service.fire.sensors import MAX_IMAGES, SensorImage
from mission_service.sensors.thermal.draped_image import DrapedImage, draped_image
from mission_service.sensors.thermal.frame_cells import Burned, FrameCells, frame_cells
from mission_service.sensors.thermal.frame_registration import FrameRegistration
from mission_service.sensors.thermal.thermal_image import ThermalImage

AHEAD_S = 5.0  # tolerated difference between the clocks of the camera and the service
MAX_WAITING = 100  # images; the oldest are dropped
IMAGE_EVERY_S = 2.0  # shortest interval between two images for the map
MISSED, FALSE_ALARMS = 0.05, 0.01  # fractions of cells, as assumed by the estimate


class ArrivedImages:
    """The images of one sensor, queued until a vehicle reports its next position.

    ``add_image`` may be called in a thread; ``next_observed`` is called on the event loop.
    """

    def __init__(
        self,
        landscape: Landscape,
        settings: ThermalCameraSection,
        refuse: Callable[[str, str], None],
    ) -> None:
        """Set ``refuse``, which is called with the name of an unused image and the reason."""
        self._landscape, self._settings, self._refuse = landscape, settings, refuse
        self._burned = Burned(landscape.shape)
        self._registration = FrameRegistration(landscape)
        self._waiting: deque[tuple[str, str, FrameCells, DrapedImage, float]] = deque()
        self._number = 0  # number of images used so far
        self.images: deque[SensorImage] = deque(maxlen=MAX_IMAGES)

    def restore_burned(self, since_s: Floats) -> None:
        """Set since when (y, x) images have shown cells as burned, in seconds since 1970."""
        self._burned.since_s = since_s

    def add_image(self, image: ThermalImage, now: datetime, file: str = "") -> None:
        """Add an image; ``file`` is the name of its event (``sensor_files``).

        Raises MissionServiceError or FireModelError for an image that is not used.
        """
        age_s = (now - image.taken).total_seconds()
        if age_s < -AHEAD_S:
            raise MissionServiceError(
                f"{image.name}: was taken {-age_s:.0f} s in the future; check the camera's clock"
            )
        if age_s > self._settings.max_age_s:
            raise MissionServiceError(
                f"{image.name}: was taken {age_s:.0f} s ago; {self._settings.TABLE}.max_age_s = "
                f"{self._settings.max_age_s:g}"
            )
        taken_s = image.taken.timestamp()
        cells = frame_cells(image, self._landscape, self._settings, self._registration)
        found = self._burned.added(cells, taken_s)
        if not set("".join(found.window.cells)) <= {"."}:
            draped = draped_image(image, found, self._settings)
            self._waiting.append((image.name, file, found, draped, taken_s))
        while len(self._waiting) > MAX_WAITING:
            dropped, *_ = self._waiting.popleft()
            self._refuse(dropped, f"{dropped}: more than {MAX_WAITING} newer images wait")

    def next_observed(
        self, fix: Telemetry, now_s: float, taken_us: Callable[[float], int | None] = lambda _: None
    ) -> Observed | None:
        """Return the next image as an observation of a vehicle, or None.

        Args:
            fix: A position of the vehicle.
            now_s: The time of the position in seconds since 1970.
            taken_us: Converts a time in seconds since 1970 to mission time, or returns None; then
                the image's mission time is computed from ``now_s``.
        """
        if not self._waiting:
            return None
        name, file, found, draped, taken_s = self._waiting.popleft()
        at_us = taken_us(taken_s)
        if at_us is None:
            at_us = fix.at_us - max(round((now_s - taken_s) * 1e6), 0)
        at_us = min(at_us, fix.at_us)
        if at_us < 0:
            self._refuse(name, f"{name}: was taken {-at_us / 1e6:.0f} s before mission time 0")
            return None
        self._keep(fix.vehicle, at_us, name, found, draped)
        return Observed(
            at_us,
            fix.vehicle,
            *found.window,
            position_sd_m=round(found.position_sd_m, 2),
            missed=MISSED,
            false_alarms=FALSE_ALARMS,
            file=file,
        )

    def _keep(
        self, vehicle: str, at_us: int, name: str, found: FrameCells, draped: DrapedImage
    ) -> None:
        """Keep an image for the map unless taken within ``IMAGE_EVERY_S`` of the last one."""
        self._number += 1
        if self.images and abs(at_us - self.images[-1].at_us) < 1e6 * IMAGE_EVERY_S:
            return
        self.images.append(
            SensorImage(
                *(self._number, at_us, vehicle, name, draped.bounds, draped.colours),
                *(draped.scale, draped.unit, found.centre, *found.ellipse),
            )
        )
