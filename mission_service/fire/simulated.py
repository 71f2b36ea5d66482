"""The simulated truth: the landscape, the fire that burns on it, and a camera that looks at it.

Nothing but observations leaves this module towards the planners.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.links.signing import read_key
from firemodel.landscape.landscape import Landscape
from firemodel.spread.fire import Fire
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.config.shared_links import sharing
from mission_service.errors import ScenarioError
from mission_service.events import CrewEvent, Observed, Telemetry
from mission_service.fire.corrected import CorrectedFire
from mission_service.fire.setup import begun_again, cells_lit, check_fire, fire_of, landscape_of

AROUND_CELLS = 3  # of a change that people are told of, so that its edge is seen

Marks = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera looking straight down: its footprint on the ground is a disc.

    With ``along_deg``, the angle along the track, it is a rectangle that turns with the vehicle.
    """

    fov_deg: float
    along_deg: float | None = None

    def radius_m(self, height_m: float) -> float:
        """Radius of the footprint from ``height_m`` above ground, half the width of a rectangle."""
        return max(height_m, 0.0) * math.tan(math.radians(self.fov_deg) / 2.0)

    def half_length_m(self, height_m: float) -> float:
        """Half the length of a rectangle along the track; 0 for a disc."""
        return max(height_m, 0.0) * math.tan(math.radians(self.along_deg or 0.0) / 2.0)


def beyond_rectangle(
    south: Any, east: Any, heading_deg: float, half_width: float, half_length: float
) -> Marks:
    """Which places (arrays) are outside a rectangle around 0, 0, its length along a heading."""
    cos, sin = math.cos(math.radians(heading_deg)), math.sin(math.radians(heading_deg))
    ahead, right = east * sin - south * cos, east * cos + south * sin
    return np.asarray((np.abs(ahead) > half_length) | (np.abs(right) > half_width))


class Window(NamedTuple):
    """Cells as an ``Observed`` has them."""

    row: int
    col: int
    cells: tuple[str, ...]


def window_of_change(before: Fire, after: Fire) -> Window | None:
    """The cells around those that burn in one of two fires and not in the other."""
    burned = after.burned()
    rows, cols = np.nonzero(burned != before.burned())
    if not rows.size:
        return None
    top, left = (max(int(cells.min()) - AROUND_CELLS, 0) for cells in (rows, cols))
    below, right = (int(cells.max()) + AROUND_CELLS + 1 for cells in (rows, cols))
    shown = burned[top:below, left:right]
    return Window(top, left, in_letters(np.where(shown, ord("b"), ord("u"))))


def in_letters(codes: NDArray[Any]) -> tuple[str, ...]:
    """Codes of characters (y, x) as a string a row."""
    text = codes.astype(np.uint8).tobytes().decode("ascii")
    width = codes.shape[1]
    return tuple(text[start : start + width] for start in range(0, len(text), width))


class FireWorld:
    """The burning truth and what cameras see of it."""

    def __init__(
        self, fire: Fire, landscape: Landscape, corrected: CorrectedFire | None = None
    ) -> None:
        """``corrected`` takes what people say of the fire, where that changes what burns."""
        self.fire = fire
        self.landscape = landscape
        self._corrected = corrected

    def advance(self, at_us: int) -> None:
        """Let the fire burn up to this mission time (never backwards)."""
        at_s = at_us / 1e6
        if at_s > self.fire.time_s:
            self.fire.advance(at_s)

    def light(self, points: Sequence[tuple[float, float]], at_s: float) -> None:
        """Set fire to what can burn of a point or a line (lat, lon), at the earliest now."""
        fires = [self.fire] if self._corrected is None else self._corrected.all_of(self.fire)
        for row, col in cells_lit(points, self.landscape):
            for fire in fires:
                fire.light(row, col, max(at_s, fire.time_s))

    def told(self, event: CrewEvent) -> Window | None:
        """Take in what a person says of the fire and the wind; the window that burns otherwise.

        Raises FireModelError for what cannot be; nothing is changed then.
        """
        if self._corrected is None:
            return None
        before = self.fire
        self.fire = self._corrected.told(event, before)
        return None if self.fire is before else window_of_change(before, self.fire)

    def corrections(self) -> list[dict[str, Any]]:
        """What people have drawn and holds."""
        return [] if self._corrected is None else self._corrected.log.status()

    def observe(
        self, telemetry: Telemetry, camera: Camera, wider_cells: float = 0.0
    ) -> Observed | None:
        """What the camera of a vehicle sees from where it is, or nothing outside the landscape.

        Its footprint reaches ``wider_cells`` farther than the camera's own.
        """
        self.advance(telemetry.at_us)
        land = self.landscape
        x_m, y_m = land.xy_of_lat_lon(telemetry.lat_deg, telemetry.lon_deg)
        if not math.isfinite(x_m + y_m):  # too far away for the landscape's projection
            return None
        height_m = telemetry.altitude_amsl_m - float(land.elevation_at(x_m, y_m))
        half_width = camera.radius_m(height_m) / land.cell_size_m
        half_length = camera.half_length_m(height_m) / land.cell_size_m
        half_width += wider_cells
        half_length += wider_cells if camera.along_deg is not None else 0.0
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
        if camera.along_deg is None:
            beyond = rows * rows + cols * cols > radius * radius
        else:
            heading_deg = telemetry.heading_deg - land.grid_convergence_deg
            beyond = beyond_rectangle(rows, cols, heading_deg, half_width, half_length)
        codes[beyond] = ord(".")
        return Observed(telemetry.at_us, telemetry.vehicle, top, left, in_letters(codes))


def world_of(scenario: Scenario, landscape: Landscape) -> FireWorld:
    """The fire of a scenario, to be set right by people.

    In a burn it is the simulated truth: what people say changes what is believed, not what burns.
    """
    corrected = None
    if scenario.planner.rule != "burn":
        corrected = CorrectedFire(landscape, partial(begun_again, scenario, landscape))
    return FireWorld(fire_of(scenario, landscape), landscape, corrected)


def camera_of(vehicle: VehicleSection) -> Camera:
    """The camera a vehicle carries."""
    return Camera(vehicle.camera_fov_deg, vehicle.camera_along_deg)


def check(scenario: Scenario) -> dict[str, object]:
    """Everything a scenario names, loaded; raises what is wrong with it."""
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
        "landscape": f"{rows} x {cols} cells of {landscape.cell_size_m:g} m, {landscape.crs}",
        "vehicles": ", ".join(vehicle.name for vehicle in scenario.vehicles),
    }
