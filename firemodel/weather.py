"""Weather in steps: each entry holds from its time until the next one's."""

import bisect
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

from firemodel.errors import FireModelError
from firemodel.rothermel import Moisture


@dataclass(frozen=True, slots=True)
class Weather:
    """Conditions from ``at_s`` on.

    Wind is 6.1 m (20 ft) above the vegetation and named by where it comes from, degrees clockwise
    from north. Moistures are percent of the oven-dry weight.
    """

    at_s: float
    wind_speed_m_s: float
    wind_from_deg: float
    dead_1h_pct: float
    dead_10h_pct: float
    dead_100h_pct: float
    live_herb_pct: float
    live_woody_pct: float

    @property
    def moisture(self) -> Moisture:
        """As fractions."""
        return Moisture(
            self.dead_1h_pct / 100.0,
            self.dead_10h_pct / 100.0,
            self.dead_100h_pct / 100.0,
            self.live_herb_pct / 100.0,
            self.live_woody_pct / 100.0,
        )


class WeatherStream:
    """Entries in order of time, the first at 0 s or earlier."""

    def __init__(self, entries: Sequence[Weather]) -> None:
        """Raises FireModelError naming the entry and the value that cannot be."""
        if not entries:
            raise FireModelError("weather: no entries; give at least one, at 0 s")
        for number, entry in enumerate(entries):
            _check(number, entry)
            if number and not entry.at_s > entries[number - 1].at_s:
                raise FireModelError(
                    f"weather entry {number}: at_s = {entry.at_s} is not later than the one "
                    f"before ({entries[number - 1].at_s}); sort the entries by time"
                )
        if entries[0].at_s > 0.0:
            raise FireModelError(
                f"weather entry 0: at_s = {entries[0].at_s}, so the weather before it is unknown; "
                "the first entry must be at 0 s or earlier"
            )
        self.entries = tuple(entries)
        self._times = [entry.at_s for entry in entries]

    def index_at(self, time_s: float) -> int:
        """Index of the entry that holds at a time."""
        return max(bisect.bisect_right(self._times, time_s) - 1, 0)

    def at(self, time_s: float) -> Weather:
        """The entry that holds at a time."""
        return self.entries[self.index_at(time_s)]

    def change_times(self) -> tuple[float, ...]:
        """When the weather changes."""
        return tuple(self._times[1:])


def _check(number: int, entry: Weather) -> None:
    for field in fields(entry):
        value = getattr(entry, field.name)
        if not math.isfinite(value):
            raise FireModelError(f"weather entry {number}: {field.name} = {value} is not a number")
        if field.name != "at_s" and value < 0.0:
            raise FireModelError(
                f"weather entry {number}: {field.name} = {value} must not be negative"
            )
    if entry.wind_from_deg > 360.0:
        raise FireModelError(
            f"weather entry {number}: wind_from_deg = {entry.wind_from_deg} must be 0 to 360, "
            "clockwise from north"
        )


def wind_adjustment_factor(depth_ft: float) -> float:
    """Midflame wind over wind 20 ft above the vegetation, no unit, for fuel not under trees.

    Andrews 2012 (RMRS-GTR-266), after Albini & Baughman 1979; fuel depth in ft.
    """
    return 1.83 / math.log((20.0 + 0.36 * depth_ft) / (0.13 * depth_ft))
