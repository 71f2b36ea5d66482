"""Averages the altitudes that a vehicle reports while it stands on the ground. Pure."""

from dataclasses import dataclass

MEAN_OVER_S = 60.0


@dataclass(slots=True)
class GroundAltitude:
    """The mean of the altitudes that a vehicle reports while it stands on the ground."""

    amsl_m: float | None = None
    count: int = 0
    at_s: float = 0.0

    def include(self, amsl_m: float, at_s: float) -> None:
        """Include a reported altitude; reports older than ``MEAN_OVER_S`` lose their weight."""
        since_s, self.at_s = at_s - self.at_s, at_s
        if self.amsl_m is None or not 0.0 <= since_s <= MEAN_OVER_S:
            self.amsl_m, self.count = amsl_m, 1
            return
        self.count += 1
        weight = max(1.0 / self.count, since_s / MEAN_OVER_S)
        self.amsl_m += weight * (amsl_m - self.amsl_m)
