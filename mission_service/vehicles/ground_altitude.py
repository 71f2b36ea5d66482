"""Averages the altitudes that a vehicle reports while it stands on the ground. Pure."""

import math
from dataclasses import dataclass

MEAN_OVER_S = 60.0
SETTLED_S = 60.0  # the mean is used after this time
# The mean begins again if the vehicle was moved, or if the estimated altitude has not settled.
MOVED_M, UNSETTLED_M = 3.0, 1.0
MAX_GAP_S = 10.0  # between two reports

Place = tuple[float, float]  # x, y in metres


@dataclass(slots=True)
class GroundAltitude:
    """The mean of the altitudes that a vehicle has reported at its last place on the ground."""

    place_m: Place = (math.nan, math.nan)
    mean_m: float = math.nan  # above mean sea level
    count: int = 0
    since_s: float = 0.0
    at_s: float = 0.0

    def include(self, place_m: Place, amsl_m: float, at_s: float) -> None:
        """Include a report; reports older than ``MEAN_OVER_S`` lose their weight."""
        passed_s, self.at_s = at_s - self.at_s, at_s
        same = 0.0 <= passed_s <= MAX_GAP_S and math.dist(place_m, self.place_m) <= MOVED_M
        if not (same and abs(amsl_m - self.mean_m) <= UNSETTLED_M):
            self.place_m, self.mean_m, self.count, self.since_s = place_m, amsl_m, 1, at_s
            return
        self.count += 1
        weight = max(1.0 / self.count, passed_s / MEAN_OVER_S)
        self.mean_m += weight * (amsl_m - self.mean_m)

    @property
    def settled_m(self) -> float | None:
        """The mean, if the vehicle has stood there for long enough."""
        return self.mean_m if self.at_s - self.since_s >= SETTLED_S else None
