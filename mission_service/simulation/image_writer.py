"""Writes the images of a simulated thermal camera to the folder that ``thermal_frames`` watches.

These files are the only connection between the simulated fire and the estimate.
"""

import os
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from autopilot_bridge.mock.mock_camera import CapturedImage
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import SimulatedCameraSection
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.errors import ScenarioError
from mission_service.fire.simulated_fire import SimulatedFire
from mission_service.sensors.thermal.camera_geometry import CameraPose, Lens, focal_px_of
from mission_service.sensors.thermal.thermal_image import SUFFIXES
from mission_service.simulation.thermal_images import rendered, write_frame

WIDTH, HEIGHT = 160, 128  # pixels
# Mission time 0 in a simulation's files, constant so that equal runs write equal files.
SIMULATED_ZERO = datetime(2026, 1, 1, tzinfo=UTC)


class ImageWriter:
    """The camera of one simulated vehicle, whose horizontal field of view is ``camera_fov_deg``."""

    def __init__(
        self,
        scenario: Scenario,
        section: VehicleSection,
        fire: SimulatedFire,
        times_of: Callable[[CapturedImage], tuple[int, datetime]],
    ) -> None:
        """Set the fire; ``times_of`` returns an image's mission time in µs and its file time.

        Raises ScenarioError for a missing folder, and if no mission would trigger the camera.
        """
        if section.camera_trigger_m is None:
            raise ScenarioError(
                f"{scenario.name}: {section.name} takes no images for thermal_frames; set its "
                "camera_trigger_m"
            )
        self._folder = folder_of(scenario)
        self._errors = scenario.simulation.camera
        self._seed = (scenario.seed, section.system_id)
        self._fire = fire
        self._times_of = times_of
        focal_px = focal_px_of(section.camera_fov_deg, WIDTH)
        self._lens = Lens(WIDTH, HEIGHT, focal_px, scenario.estimate.thermal_frames.distortion)

    def write(self, image: CapturedImage) -> None:
        """Write a captured image if the camera is above the landscape."""
        at_us, taken = self._times_of(image)
        self._fire.advance(at_us)
        rng = np.random.default_rng((*self._seed, image.number))
        fire, land = self._fire.fire, self._fire.landscape
        pose = _pose_of(image, land)
        try:
            celsius = rendered(land, fire.arrival_time_s, at_us / 1e6, pose, rng, self._lens)
        except FireModelError:
            return
        reported = _with_errors(pose, self._errors, rng) if self._errors.poses_in_files else None
        name = f"{self._seed[1]:03d}-{image.number:05d}.tif"
        part = self._folder / f".{name}.part"
        write_frame(part, land, reported, celsius, taken, self._lens)
        os.utime(part, (taken.timestamp(), taken.timestamp()))
        part.rename(self._folder / name)


def folder_of(scenario: Scenario) -> Path:
    """Return the watched folder. Raises ScenarioError if the folder does not exist."""
    folder = scenario.estimate.thermal_frames.folder
    if folder is None or not Path(folder).is_dir():
        raise ScenarioError(
            f"{scenario.name}: estimate.thermal_frames.folder: no such folder; create it"
        )
    return Path(folder)


def check_is_empty(folder: Path) -> None:
    """Raise ScenarioError for a folder with images, which would be processed as new images."""
    if any(each.name.lower().endswith(SUFFIXES) for each in folder.iterdir()):
        raise ScenarioError(f"{folder}: contains images; remove them, or use an empty folder")


def _pose_of(image: CapturedImage, land: Landscape) -> CameraPose:
    x_m, y_m = land.xy_of_lat_lon(image.lat_deg, image.lon_deg)
    yaw_deg = float(land.grid_deg(image.yaw_deg))
    place = (float(x_m), float(y_m), image.altitude_amsl_m)
    return CameraPose(*place, yaw_deg, image.pitch_deg, image.roll_deg)


def _with_errors(
    pose: CameraPose, errors: SimulatedCameraSection, rng: np.random.Generator
) -> CameraPose:
    """Return a pose with random measurement errors."""
    steps = (
        *rng.normal(0.0, errors.gps_sd_m, 3),
        *rng.normal(0.0, errors.gimbal_sd_deg, 3),
    )
    return CameraPose(*(float(part + step) for part, step in zip(pose, steps, strict=True)))
