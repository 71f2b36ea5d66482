"""The first lap around a fire, after which the map is rebuilt around the fire's centre."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission_service.events import Observed
from mission_service.fire.observed_window import states_in
from mission_service.guidance.fire_map import BEARINGS, FireMap
from mission_service.guidance.front.front_path import centre_of_area, turned_deg

ROUND_AGAIN_DEG = 360.0
# Maximum number of views stored in a lap: 20 minutes of views from four cameras, about 4 MB.
MAX_SEEN = 10_000

# A camera window: the row and column of its first cell, its cell codes, and the time in s.
CameraView = tuple[int, int, NDArray[np.uint8], float]


@dataclass(slots=True)
class LapProgress:
    """The angle flown by a vehicle around the map's centre in its direction of flight."""

    bearing_deg: float | None = None  # bearing of the vehicle at the last update
    swept_deg: float = 0.0  # angle flown so far

    def update(self, bearing_deg: float, clockwise: bool, counts: bool) -> bool:
        """Set the bearing; return whether the lap is complete.

        The angle from the last bearing is added to the lap only if ``counts`` is True.
        """
        if counts and self.bearing_deg is not None:
            self.swept_deg += turned_deg(self.bearing_deg, bearing_deg, clockwise)
        self.bearing_deg = bearing_deg
        return counts and self.swept_deg >= ROUND_AGAIN_DEG


def view_of(observed: Observed) -> CameraView:
    """Return the camera window in an observation."""
    return observed.row, observed.col, states_in(observed.cells), observed.at_us / 1e6


def append_view(seen: list[CameraView], one: CameraView) -> None:
    """Add a view to a lap's views; at ``MAX_SEEN`` views, first delete every second view."""
    if len(seen) >= MAX_SEEN:
        del seen[1::2]
    seen.append(one)


def recentred_map(
    fire_map: FireMap, seen: Sequence[CameraView]
) -> tuple[FireMap, NDArray[np.bool_]]:
    """Return a map around the fire's centre of area, rebuilt from the views of the lap.

    Planners use this map if the ignition point is unknown. The second result is the mask (360) of
    the bearings on which the last view shows the front.
    """
    outer, _ = fire_map.filled_outer()
    centre = centre_of_area(outer, fire_map.centre_row, fire_map.centre_col)
    renewed = FireMap(fire_map.shape, *centre, fire_map.ignited_at_s, fire_map.baseline_s)
    in_view = np.zeros(BEARINGS, dtype=bool)
    for window in seen:
        in_view = renewed.add_window(*window)
    return renewed, in_view
