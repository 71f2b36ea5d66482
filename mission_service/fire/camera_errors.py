"""Simulate the errors of cameras (position, direction, detection) and the effect of smoke.

The same seed, vehicle and time give the same errors, regardless of the number and order of images.
"""

import math
import zlib
from typing import NamedTuple

import numpy as np

from firemodel.arrays import Floats, Mask, window_at
from firemodel.spread.fire_scheme import Fire
from mission_service.config.fire_sections import SimulatedCameraSection
from mission_service.config.scenario import Scenario
from mission_service.events import Telemetry
from mission_service.fire.camera_views import Footprint

STREAM = 3  # random numbers of this module; other modules use other streams of the same seed
GPS_PERIOD_US = 60_000_000  # the position error is constant for this time
SMOKING_S = 1200.0  # time during which a burning cell emits smoke
CALM_M_S = 0.5  # in weaker wind, smoke rises and does not cover the ground


class Shown(NamedTuple):
    """What an image with errors shows."""

    burned: Mask  # (y, x) cells that appear as burned
    unseen: Mask  # (y, x) cells behind smoke
    position_sd_m: float


class CameraErrors:
    """The errors of the simulated cameras of a scenario."""

    def __init__(self, scenario: Scenario) -> None:
        self.settings: SimulatedCameraSection = scenario.simulation.camera
        self._seed = scenario.seed

    def shown(self, fire: Fire, fix: Telemetry, footprint: Footprint) -> Shown:
        """Return the cells of a fire that an image shows as burned, and those behind smoke."""
        settings = self.settings
        rng = self._generator(fix.vehicle, fix.at_us)
        gps = self._generator(fix.vehicle, -1 - fix.at_us // GPS_PERIOD_US)
        tilt_m = max(footprint.height_m, 0.0) * math.tan(math.radians(settings.gimbal_sd_deg))
        shift_m = gps.normal(0.0, settings.gps_sd_m, 2) + rng.normal(0.0, tilt_m, 2)
        cells = np.rint(shift_m / fire.landscape.cell_size_m)
        south, east = int(cells[0]), int(cells[1])
        burned = _times(fire, footprint, 0, (south, east)) <= fix.at_us / 1e6
        chance = rng.random(burned.shape)
        wrong = np.where(burned, chance < settings.missed, chance < settings.false_alarms)
        unseen = np.zeros_like(burned)
        if settings.kind == "visible":
            unseen = self._behind_smoke(fire, fix.at_us / 1e6, footprint)
        return Shown(burned ^ wrong, unseen, math.hypot(settings.gps_sd_m, tilt_m))

    def _generator(self, vehicle: str, number: int) -> np.random.Generator:
        words = (self._seed, STREAM, zlib.crc32(vehicle.encode()), number % 2**64)
        return np.random.default_rng(words)

    def _behind_smoke(self, fire: Fire, at_s: float, footprint: Footprint) -> Mask:
        """Return the cells (y, x) of a window that lie downwind of burning cells."""
        weather, land = fire.weather.weather_at(at_s), fire.landscape
        reach = math.floor(self.settings.smoke_m / land.cell_size_m)
        covered = np.zeros(footprint.beyond.shape, dtype=bool)
        if weather.wind_speed_m_s < CALM_M_S:
            return covered
        arrival_s = _times(fire, footprint, reach)
        smoking = (arrival_s <= at_s) & (arrival_s > at_s - SMOKING_S)
        towards_rad = math.radians(land.grid_deg(weather.wind_from_deg + 180.0))
        for cells in range(1, reach + 1):
            south = round(-cells * math.cos(towards_rad))
            east = round(cells * math.sin(towards_rad))
            covered |= smoking[window_at(reach - south, reach - east, covered.shape)]
        return covered


def _times(
    fire: Fire, footprint: Footprint, margin: int, shift: tuple[int, int] = (0, 0)
) -> Floats:
    """Return the arrival times (y, x) in a window with a margin; infinity off the landscape.

    ``shift`` moves the window by that many rows and columns.
    """
    height, width = footprint.beyond.shape
    rows = footprint.top + shift[0] + np.arange(-margin, height + margin)
    cols = footprint.left + shift[1] + np.arange(-margin, width + margin)
    last_row, last_col = (size - 1 for size in fire.landscape.shape)
    inside = np.ix_((rows >= 0) & (rows <= last_row), (cols >= 0) & (cols <= last_col))
    places = np.ix_(np.clip(rows, 0, last_row), np.clip(cols, 0, last_col))
    found = np.full((rows.size, cols.size), np.inf)
    found[inside] = fire.arrival_time_s[places][inside]
    return found
