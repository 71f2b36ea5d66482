"""The estimated fronts that all vehicles of a run share, and the routes that each vehicle flies."""

import numpy as np
from numpy.typing import NDArray

from mission_service.events import FrontsEstimated
from mission_service.guidance.front.informative.front_nodes import Front, front_of
from mission_service.guidance.front.informative.legs import unburned_ground
from mission_service.guidance.visibility_graph import VisibilityGraph

Floats = NDArray[np.float64]
# Shorter fronts are not flown.
MIN_INNER_CELLS, MIN_OUTER_CELLS = 16.0, 6.0
NO_VISITS = np.empty((0, 3))


class SharedFronts:
    """The latest fronts, and the planned visits of each vehicle; ``version`` counts the fronts."""

    def __init__(self, cell_m: float) -> None:
        """Begin without fronts on a grid with cells of this size."""
        self._cell_m = cell_m
        self.fronts: list[Front] = []
        self.version = 0
        self._unburned: VisibilityGraph | None = None  # of these fronts, once computed
        self._visits: dict[str, Floats] = {}

    def replace_fronts(self, event: FrontsEstimated) -> None:
        """Replace the fronts."""
        fronts = [front_of(each, event.at_us / 1e6, self._cell_m) for each in event.fronts]
        self.fronts = [
            front
            for front in fronts
            if front.length_cells >= (MIN_INNER_CELLS if front.inner else MIN_OUTER_CELLS)
        ] or fronts[:1]
        self.version += 1
        self._unburned = None

    def unburned(self) -> VisibilityGraph:
        """Return the ground outside the fire, for flights from one front to another."""
        if self._unburned is None:
            self._unburned = unburned_ground([front.points for front in self.fronts])
        return self._unburned

    def set_visits(self, vehicle: str, visits: Floats) -> None:
        """Store the visits (n, 3; row, column, time in s) that a vehicle plans."""
        self._visits[vehicle] = visits

    def remove_vehicle(self, vehicle: str) -> None:
        """Remove a vehicle that has left."""
        self._visits.pop(vehicle, None)

    def visits_of_others(self, vehicle: str) -> Floats:
        """Return the visits (n, 3; row, column, time in s) that other vehicles plan."""
        found = [visits for name, visits in sorted(self._visits.items()) if name != vehicle]
        return np.concatenate(found) if found else NO_VISITS
