"""Simulate the truth: a landscape, the fire on it, and the cameras that observe the fire.

Planners receive only observations from this module.
"""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.links.signing import read_key
from firemodel.landscape.landscape import Landscape, crs_label
from firemodel.spread.fire_scheme import Fire
from mission_service.config.scenario import Scenario
from mission_service.config.shared_links import sharing
from mission_service.errors import ScenarioError
from mission_service.events import AnyOperatorEvent, Observed, Telemetry
from mission_service.fire.camera import Camera, beyond_rectangle
from mission_service.fire.corrected_fire import CorrectedFire
from mission_service.fire.setup import (
    begun_again,
    cells_lit,
    check_fire,
    fire_of,
    landscape_of,
    warnings_on,
)

AROUND_CELLS = 3  # margin of a reported window, which includes the edge of the change


class Window(NamedTuple):
    """A window of cells, encoded as in ``Observed``."""

    row: int
    col: int
    cells: tuple[str, ...]


def window_of_change(before: Fire, after: Fire) -> Window | None:
    """Return the window around the cells that have burned in only one of two fires, or None."""
    burned = after.burned()
    rows, cols = np.nonzero(burned != before.burned())
    if not rows.size:
        return None
    top, left = (max(int(cells.min()) - AROUND_CELLS, 0) for cells in (rows, cols))
    below, right = (int(cells.max()) + AROUND_CELLS + 1 for cells in (rows, cols))
    shown = burned[top:below, left:right]
    return Window(top, left, in_letters(np.where(shown, ord("b"), ord("u"))))


def in_letters(codes: NDArray[Any]) -> tuple[str, ...]:
    """Return character codes (y, x) as one string for each row."""
    text = codes.astype(np.uint8).tobytes().decode("ascii")
    width = codes.shape[1]
    return tuple(text[start : start + width] for start in range(0, len(text), width))


class SimulatedFire:
    """The simulated truth, which cameras observe."""

    def __init__(
        self, fire: Fire, landscape: Landscape, corrected: CorrectedFire | None = None
    ) -> None:
        """Set the fire, and ``corrected`` if operators' reports change this fire."""
        self.fire = fire
        self.landscape = landscape
        self._corrected = corrected

    def advance(self, at_us: int) -> None:
        """Advance the fire to this mission time; an earlier time has no effect."""
        at_s = at_us / 1e6
        if at_s > self.fire.time_s:
            self.fire.advance(at_s)

    def light(self, points: Sequence[tuple[float, float]], at_s: float) -> None:
        """Light the burnable cells of a point or line (lat, lon) at ``at_s`` or, if past, now."""
        fires = [self.fire] if self._corrected is None else self._corrected.all_of(self.fire)
        for row, col in cells_lit(points, self.landscape):
            for fire in fires:
                fire.light(row, col, max(at_s, fire.time_s))

    def apply_report(self, event: AnyOperatorEvent) -> Window | None:
        """Apply a report of fire or wind, and return a window around the changed cells or None.

        Raises FireModelError for an invalid report, which changes nothing.
        """
        if self._corrected is None:
            return None
        before = self.fire
        self.fire = self._corrected.apply_report(event, before)
        return None if self.fire is before else window_of_change(before, self.fire)

    def corrections(self) -> list[dict[str, Any]]:
        """Return the status of the corrections in effect."""
        return [] if self._corrected is None else self._corrected.log.status()

    def observe(
        self, telemetry: Telemetry, camera: Camera, wider_cells: float = 0.0
    ) -> Observed | None:
        """Return the observation of a vehicle's camera at its position, or None off the landscape.

        ``wider_cells`` is added to the footprint of the camera on each side.
        """
        self.advance(telemetry.at_us)
        land = self.landscape
        x_m, y_m = land.xy_of_lat_lon(telemetry.lat_deg, telemetry.lon_deg)
        if not math.isfinite(x_m + y_m):  # too far from the landscape for its projection
            return None
        height_m = telemetry.altitude_amsl_m - float(land.elevation_at(x_m, y_m))
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
        arrived = self.fire.arrival_time_s[top : bottom + 1, left : right + 1]
        codes = np.where(arrived <= telemetry.at_us / 1e6, ord("b"), ord("u")).astype(np.uint8)
        rows = np.arange(top, bottom + 1)[:, None] - row
        cols = np.arange(left, right + 1)[None, :] - col
        if camera.along_rad is None:
            beyond = rows * rows + cols * cols > radius * radius
        else:
            heading_deg = land.grid_deg(telemetry.heading_deg)
            beyond = beyond_rectangle(rows, cols, heading_deg, half_width, half_length)
        codes[beyond] = ord(".")
        return Observed(telemetry.at_us, telemetry.vehicle, top, left, in_letters(codes))


def world_of(scenario: Scenario, landscape: Landscape) -> SimulatedFire:
    """Return the fire of a scenario, which operators' reports correct.

    In a burn, reports change the estimate and not this fire.
    """
    corrected = None
    if scenario.burn_flown is None:
        corrected = CorrectedFire(landscape, partial(begun_again, scenario, landscape))
    return SimulatedFire(fire_of(scenario, landscape), landscape, corrected)


def check(scenario: Scenario) -> dict[str, Any]:
    """Load all inputs of a scenario and return a summary; raise an error for any problem."""
    landscape = landscape_of(scenario)
    check_fire(scenario, landscape)
    sharing(scenario.vehicles)
    for vehicle in scenario.vehicles:
        if vehicle.signing_key is not None:
            read_key(vehicle.signing_key)
        x_m, y_m = landscape.xy_of_lat_lon(vehicle.home_lat_deg, vehicle.home_lon_deg)
        if not landscape.contains(x_m, y_m):
            raise ScenarioError(
                f"{scenario.name}: home of {vehicle.name} (lat {vehicle.home_lat_deg}, "
                f"lon {vehicle.home_lon_deg}) lies outside the landscape"
            )
    rows, cols = landscape.shape
    return {
        "scenario": scenario.name,
        "landscape": f"{rows} x {cols} cells of {landscape.cell_size_m:g} m, "
        f"{crs_label(landscape.crs)}",
        "vehicles": ", ".join(vehicle.name for vehicle in scenario.vehicles),
        "warnings": warnings_on(scenario, landscape),
    }
