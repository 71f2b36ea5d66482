"""Compute which cells of a fire the vehicles' cameras show and when images are due."""

import math
from typing import NamedTuple

import numpy as np

from firemodel.arrays import Mask, window_at
from firemodel.landscape.landscape import Landscape
from firemodel.spread.fire_scheme import Fire
from mission_service import events
from mission_service.config.scenario import Scenario
from mission_service.fire.camera import Camera, beyond_rectangle, camera_of
from mission_service.fire.observed_window import in_letters


class Footprint(NamedTuple):
    """The cells that a camera shows; (``top``, ``left``) is the north-west cell of the window."""

    top: int
    left: int
    beyond: Mask  # (y, x) the cells of the window that lie outside the footprint
    height_m: float  # height of the camera above the ground


class CameraViews:
    """The cameras of all vehicles: footprints, periods, and whether positions are reliable."""

    def __init__(self, scenario: Scenario) -> None:
        self._cameras = {section.name: camera_of(section) for section in scenario.vehicles}
        self._every_us = {
            section.name: round(1e6 / section.camera_rate_hz) for section in scenario.vehicles
        }
        self._due_us = dict.fromkeys(self._cameras, 0)
        self._faults: dict[str, set[str]] = {name: set() for name in self._cameras}

    def is_due(self, fix: events.Telemetry) -> bool:
        """Return whether an image is due; if so, the next image becomes due one period later.

        No image is due while the vehicle's position is unreliable, because the image would be
        misplaced.
        """
        if self._faults[fix.vehicle] or fix.at_us < self._due_us[fix.vehicle]:
            return False
        self._due_us[fix.vehicle] = fix.at_us + self._every_us[fix.vehicle]
        return True

    def on_event(self, event: events.AnyEvent) -> None:
        """Process a change in the reliability of a position."""
        if isinstance(event, events.GpsFixChanged):
            self._set_fault(event.vehicle, "fix", event.good)
        elif isinstance(event, events.EstimatorStatusChanged):
            self._set_fault(event.vehicle, "estimator", event.healthy)
        elif isinstance(event, events.VehicleRebooted):
            self._faults[event.vehicle].clear()

    def seen_from(
        self, fix: events.Telemetry, fire: Fire, wider_cells: float = 0.0
    ) -> events.Observed | None:
        """Return the image of a fire from a vehicle's camera, or None off the landscape.

        ``wider_cells`` is added to the footprint on each side.
        """
        return observed(fire, fix, self._cameras[fix.vehicle], wider_cells)

    def footprint(
        self, fix: events.Telemetry, land: Landscape, wider_cells: float = 0.0
    ) -> Footprint | None:
        """Return the cells that a vehicle's camera shows, or None off the landscape."""
        return footprint_of(land, fix, self._cameras[fix.vehicle], wider_cells)

    def _set_fault(self, vehicle: str, source: str, good: bool) -> None:
        faults = self._faults[vehicle]
        if good:
            faults.discard(source)
        else:
            faults.add(source)


def observed(
    fire: Fire, fix: events.Telemetry, camera: Camera, wider_cells: float = 0.0
) -> events.Observed | None:
    """Return the image of a fire from a camera's position, or None off the landscape."""
    shown = footprint_of(fire.landscape, fix, camera, wider_cells)
    if shown is None:
        return None
    arrived = fire.arrival_time_s[window_at(shown.top, shown.left, shown.beyond.shape)]
    return image_of(fix, shown, arrived <= fix.at_us / 1e6)


def image_of(
    fix: events.Telemetry, shown: Footprint, burned: Mask, unseen: Mask | None = None
) -> events.Observed:
    """Return the image of the burned cells (y, x) in a footprint, without ``unseen`` cells."""
    codes = np.where(burned, ord("b"), ord("u")).astype(np.uint8)
    codes[shown.beyond if unseen is None else shown.beyond | unseen] = ord(".")
    return events.Observed(fix.at_us, fix.vehicle, shown.top, shown.left, in_letters(codes))


def footprint_of(
    land: Landscape, fix: events.Telemetry, camera: Camera, wider_cells: float = 0.0
) -> Footprint | None:
    """Return the cells that a camera shows from a position, or None off the landscape."""
    x_m, y_m = land.xy_of_lat_lon(fix.lat_deg, fix.lon_deg)
    if not math.isfinite(x_m + y_m):  # too far from the landscape to be projected
        return None
    height_m = fix.altitude_amsl_m - float(land.elevation_at(x_m, y_m))
    half_width = camera.half_width_m(height_m) / land.cell_size_m + wider_cells
    half_length = camera.half_length_m(height_m) / land.cell_size_m
    half_length += wider_cells if camera.along_rad is not None else 0.0
    radius = math.hypot(half_width, half_length)
    row, col = (float(value) for value in land.row_col_of(x_m, y_m))
    top, bottom = (
        max(math.ceil(row - radius), 0),
        min(math.floor(row + radius), land.shape[0] - 1),
    )
    left, right = (
        max(math.ceil(col - radius), 0),
        min(math.floor(col + radius), land.shape[1] - 1),
    )
    if radius <= 0.0 or top > bottom or left > right:
        return None
    rows = np.arange(top, bottom + 1)[:, None] - row
    cols = np.arange(left, right + 1)[None, :] - col
    if camera.along_rad is None:
        beyond = rows * rows + cols * cols > radius * radius
    else:
        heading_deg = land.grid_deg(fix.heading_deg)
        beyond = beyond_rectangle(rows, cols, heading_deg, half_width, half_length)
    return Footprint(top, left, beyond, height_m)


def arrival_at(fire: Fire, row: int, col: int) -> float | None:
    """Return a fire's arrival time in s at a cell; None if unburned or off the grid."""
    rows, cols = fire.landscape.shape
    if not (0 <= row < rows and 0 <= col < cols):
        return None
    arrival_s = float(fire.arrival_time_s[row, col])
    return arrival_s if math.isfinite(arrival_s) else None
