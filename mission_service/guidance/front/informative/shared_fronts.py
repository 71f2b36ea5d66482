"""The estimated fronts shared by all vehicles of a run, and the visits planned by each vehicle."""

import numpy as np
from numpy.typing import NDArray

from mission_service.events import FrontsEstimated
from mission_service.guidance.front.informative.front_nodes import Front, front_of
from mission_service.guidance.front.informative.legs import unburned_ground
from mission_service.visibility_graph import VisibilityGraph

Floats = NDArray[np.float64]
# Vehicles do not fly along shorter fronts.
MIN_INNER_CELLS, MIN_OUTER_CELLS = 16.0, 6.0
NO_VISITS = np.empty((0, 3))


class SharedFronts:
    """The latest fronts, and the planned visits of each vehicle; ``version`` counts changes."""

    def __init__(self, cell_m: float) -> None:
        """Begin without fronts; ``cell_m`` is the size of the grid's cells in metres."""
        self._cell_m = cell_m
        self.fronts: list[Front] = []
        self.version = 0
        self._unburned: VisibilityGraph | None = None  # None until the first use
        self._visits: dict[str, Floats] = {}

    def replace_fronts(self, event: FrontsEstimated) -> None:
        """Replace the fronts with the sufficiently long fronts in an event."""
        fronts = [front_of(each, event.at_us / 1e6, self._cell_m) for each in event.fronts]
        self.fronts = [
            front
            for front in fronts
            if front.length_cells >= (MIN_INNER_CELLS if front.inner else MIN_OUTER_CELLS)
        ] or fronts[:1]
        self.version += 1
        self._unburned = None

    def unburned(self) -> VisibilityGraph:
        """Return the visibility graph of the unburned ground, for flights between fronts."""
        if self._unburned is None:
            self._unburned = unburned_ground([front.points for front in self.fronts])
        return self._unburned

    def set_visits(self, vehicle: str, visits: Floats) -> None:
        """Store the visits (n, 3; row, column, time in s) planned by a vehicle."""
        self._visits[vehicle] = visits

    def remove_vehicle(self, vehicle: str) -> None:
        """Remove the visits of a vehicle that has left."""
        self._visits.pop(vehicle, None)

    def visits_of_others(self, vehicle: str) -> Floats:
        """Return the visits (n, 3; row, column, time in s) planned by other vehicles."""
        found = [visits for name, visits in sorted(self._visits.items()) if name != vehicle]
        return np.concatenate(found) if found else NO_VISITS
