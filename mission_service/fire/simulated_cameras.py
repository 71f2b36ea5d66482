"""Observe the simulated fire by the cameras of vehicles. No other module reads that fire.

In a simulation and in a live run the fire advances with the clock; a replay advances it by the
events of a journal.
"""

import math

import numpy as np

from firemodel.landscape.landscape import Landscape
from mission_service import events
from mission_service.commands import AnyCommand
from mission_service.config.scenario import Scenario
from mission_service.fire.camera import Camera, beyond_rectangle, camera_of
from mission_service.fire.ignition_reports import ignition_reports_of
from mission_service.fire.observed_window import in_letters
from mission_service.fire.simulated_fire import SimulatedFire, simulated_fire_of


class SimulatedCameras:
    """The cameras of all vehicles, which observe a simulated fire.

    Ignitions that are reported, and spheres that have landed, light the simulated fire.
    """

    def __init__(self, scenario: Scenario, fire: SimulatedFire) -> None:
        """Set the simulated fire; only evaluations after a run may read it elsewhere."""
        self.fire = fire
        self._cameras = {section.name: camera_of(section) for section in scenario.vehicles}
        self._every_us = {
            section.name: round(1e6 / section.camera_rate_hz) for section in scenario.vehicles
        }
        self._due_us = dict.fromkeys(self._cameras, 0)
        self._faults: dict[str, set[str]] = {name: set() for name in self._cameras}
        self._ignitions = ignition_reports_of(scenario)

    def advance(self, at_us: int) -> None:
        """Advance the simulated fire to this mission time; an earlier time has no effect."""
        self.fire.advance(at_us)

    def observation(self, fix: events.Telemetry) -> events.Observed | None:
        """Return the observation of a vehicle's camera from a position if an image is due, or None.

        The result is also None while the vehicle's position is unreliable, because the image would
        be misplaced.
        """
        return self.seen_from(fix) if self._is_due(fix) else None

    def _is_due(self, fix: events.Telemetry) -> bool:
        """Return whether an image is due; if so, the next image becomes due one period later."""
        if self._faults[fix.vehicle] or fix.at_us < self._due_us[fix.vehicle]:
            return False
        self._due_us[fix.vehicle] = fix.at_us + self._every_us[fix.vehicle]
        return True

    def seen_from(self, fix: events.Telemetry, wider_cells: float = 0.0) -> events.Observed | None:
        """Return the observation from a position, or None off the landscape.

        ``wider_cells`` is added to the footprint of the camera on each side.
        """
        self.fire.advance(fix.at_us)
        return observed(self.fire, fix, self._cameras[fix.vehicle], wider_cells)

    def arrival_s(self, row: int, col: int) -> float | None:
        """Return the simulated fire's arrival time at a cell; None if unburned or off the grid."""
        rows, cols = self.fire.landscape.shape
        if not (0 <= row < rows and 0 <= col < cols):
            return None
        arrival_s = float(self.fire.fire.arrival_time_s[row, col])
        return arrival_s if math.isfinite(arrival_s) else None

    def on_event(self, event: events.AnyEvent) -> None:
        """Apply an ignition, a completed drop or a change in the reliability of a position."""
        if isinstance(event, events.GpsFixChanged):
            self._set_fault(event.vehicle, "fix", event.good)
        elif isinstance(event, events.EstimatorStatusChanged):
            self._set_fault(event.vehicle, "estimator", event.healthy)
        elif isinstance(event, events.VehicleRebooted):
            self._faults[event.vehicle].clear()
        elif (reported := self._ignitions.reported_in(event)) is not None:
            self.fire.advance(event.at_us)  # else ignition would be at the last observation's time
            self.fire.light(*reported)

    def on_command(self, command: AnyCommand) -> None:
        """Process a drop."""
        self._ignitions.on_command(command)

    def _set_fault(self, vehicle: str, source: str, good: bool) -> None:
        faults = self._faults[vehicle]
        if good:
            faults.discard(source)
        else:
            faults.add(source)

    def apply_history(self, event: events.AnyEvent) -> None:
        """Apply an event from a journal."""
        self.fire.advance(event.at_us)
        if isinstance(event, events.Telemetry):
            self._is_due(event)
        self.on_event(event)


def cameras_of(scenario: Scenario, landscape: Landscape) -> SimulatedCameras | None:
    """Return the cameras that observe a scenario's simulated fire, or None if it has none."""
    fire = simulated_fire_of(scenario, landscape)
    return None if fire is None else SimulatedCameras(scenario, fire)


def observed(
    world: SimulatedFire, fix: events.Telemetry, camera: Camera, wider_cells: float = 0.0
) -> events.Observed | None:
    """Return what a camera sees of a fire from a position, or None off the landscape."""
    land = world.landscape
    x_m, y_m = land.xy_of_lat_lon(fix.lat_deg, fix.lon_deg)
    if not math.isfinite(x_m + y_m):  # too far from the landscape for its projection
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
    arrived = world.fire.arrival_time_s[top : bottom + 1, left : right + 1]
    codes = np.where(arrived <= fix.at_us / 1e6, ord("b"), ord("u")).astype(np.uint8)
    rows = np.arange(top, bottom + 1)[:, None] - row
    cols = np.arange(left, right + 1)[None, :] - col
    if camera.along_rad is None:
        beyond = rows * rows + cols * cols > radius * radius
    else:
        heading_deg = land.grid_deg(fix.heading_deg)
        beyond = beyond_rectangle(rows, cols, heading_deg, half_width, half_length)
    codes[beyond] = ord(".")
    return events.Observed(fix.at_us, fix.vehicle, top, left, in_letters(codes))
