"""The first lap around a fire, at whose end the map is rebuilt around the fire's centre."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission_service.events import Observed
from mission_service.fire.observed_window import states_in
from mission_service.guidance.fire_map import BEARINGS, FireMap
from mission_service.guidance.front.front_path import centre_of_area, turned_deg

ROUND_AGAIN_DEG = 360.0
MAX_SEEN = 10_000  # windows stored in a lap: 20 minutes of views by four cameras, about 4 MB

CameraView = tuple[int, int, NDArray[np.uint8], float]  # a camera's window: row, col, codes, at_s


@dataclass(slots=True)
class LapProgress:
    """The degrees that a vehicle has flown around the map's centre, in its flying direction."""

    bearing_deg: float | None = None  # bearing of the vehicle at the last update
    swept_deg: float = 0.0

    def update(self, bearing_deg: float, clockwise: bool, counts: bool) -> bool:
        """Set the bearing; return whether the lap is complete.

        The angle since the last bearing is added to the lap only if ``counts`` is True.
        """
        if counts and self.bearing_deg is not None:
            self.swept_deg += turned_deg(self.bearing_deg, bearing_deg, clockwise)
        self.bearing_deg = bearing_deg
        return counts and self.swept_deg >= ROUND_AGAIN_DEG


def view_of(observed: Observed) -> CameraView:
    """Return the camera window in an observation."""
    return observed.row, observed.col, states_in(observed.cells), observed.at_us / 1e6


def append_view(seen: list[CameraView], one: CameraView) -> None:
    """Add a view to a lap's views; if there are ``MAX_SEEN``, first delete every second view."""
    if len(seen) >= MAX_SEEN:
        del seen[1::2]
    seen.append(one)


def recentred_map(
    fire_map: FireMap, seen: Sequence[CameraView]
) -> tuple[FireMap, NDArray[np.bool_]]:
    """Return a map of the same views around the fire's centre of area, for an unknown ignition.

    The second result is the mask of the bearings (360) that the last view showed.
    """
    outer, _ = fire_map.filled_outer()
    centre = centre_of_area(outer, fire_map.centre_row, fire_map.centre_col)
    renewed = FireMap(fire_map.shape, *centre, fire_map.ignited_at_s, fire_map.baseline_s)
    in_view = np.zeros(BEARINGS, dtype=bool)
    for window in seen:
        in_view = renewed.add_window(*window)
    return renewed, in_view
