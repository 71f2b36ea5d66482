"""The state of an incident at a given mission time, from which all products are made.

The fire is the estimate of the run, not the simulated fire.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.time_zone import time_zone_of
from firemodel.outputs.event_polygon import M2_PER_ACRE, geodesic_acres
from firemodel.outputs.front_files import area_geometry
from firemodel.spread.fire_scheme import Fire, burned_area
from firemodel.spread.front import front_polygons
from mission_service.events import NoteAdded
from mission_service.fire.forecast import Arrival
from mission_service.products.heat import Heat
from mission_service.runtime.run_statistics import RunStatistics

HOUR_S = 3600.0
LEVELS = (0.1, 0.5, 0.9)  # burn probabilities of the outlines
NOTE = "Estimate of mission-service, not approved by a person. Not for navigation."


class InterpreterLine(NamedTuple):
    """A line of the interpreter's log with its mission time."""

    at_s: float
    text: str


class ImageTimes(NamedTuple):
    """The images of a run: their number, and the mission times of the first and the last."""

    total: int
    first_s: float | None
    last_s: float | None


@dataclass(frozen=True)
class Incident:
    """The fire, its forecast, heat, drops and log at mission time ``at_s``.

    ``time_zero`` is the calendar time of mission time 0. ``arrival`` contains the arrival times of
    the estimate until ``at_s`` and of the forecast later. ``probability`` (y, x) is the burn
    probability at the end of the forecast, None without a forecast. ``fire`` is None in a burn,
    in which the estimate has no flame lengths. ``run`` is the folder with the photos of the notes.
    """

    name: str
    landscape: Landscape
    at_s: float
    time_zero: datetime
    prescribed: bool
    arrival: Arrival
    forecast_s: float  # length of the forecast
    probability: Floats | None
    fire: Fire | None
    heat: Heat
    record: RunStatistics
    images: ImageTimes
    log: Sequence[InterpreterLine] = field(default_factory=list)
    notes: Sequence[NoteAdded] = ()
    run: Path = Path()

    def when(self, at_s: float) -> datetime:
        """Return a mission time in the time zone of the landscape."""
        instant = self.time_zero + timedelta(seconds=round(at_s))
        return instant if self._zone is None else instant.astimezone(self._zone)

    @cached_property
    def _zone(self) -> Any:
        return time_zone_of(self.landscape)

    def utc(self, at_s: float) -> datetime:
        """Return a mission time in UTC."""
        return self.when(at_s).astimezone(UTC)

    def unix_ms(self, at_s: float) -> int:
        """Return a mission time in ms since 1970 UTC."""
        return round(self.utc(at_s).timestamp() * 1000)

    def in_words(self, at_s: float) -> str:
        """Return a mission time as local time with its zone, and UTC."""
        local, utc = self.when(at_s), self.utc(at_s)
        day = "" if local.date() == utc.date() else f"{utc:%Y-%m-%d} "
        return f"{local:%Y-%m-%d %H:%M} {local:%Z} ({day}{utc:%H:%M} UTC)"

    def area(self, at_s: float) -> Any:
        """Return the area burned at the given time, a shapely MultiPolygon (landscape's CRS)."""
        return burned_area(self.arrival.arrival_s, self.landscape, at_s, self.arrival.start_area)

    @cached_property
    def perimeter(self) -> Any:
        """The area burned at ``at_s``, as a GeoJSON MultiPolygon (WGS84)."""
        return area_geometry(self.area(self.at_s), self.landscape)

    @cached_property
    def acres(self) -> float:
        """The geodesic area of the perimeter in acres."""
        return geodesic_acres(self.perimeter)

    def past_times_s(self) -> list[float]:
        """Return the hours of mission time at which fronts are drawn, and ``at_s``."""
        begun_s = float(self.arrival.arrival_s.min())
        if begun_s >= self.at_s:
            return [self.at_s]
        first = int(begun_s // HOUR_S) + 1
        whole = [hour * HOUR_S for hour in range(first, int(self.at_s // HOUR_S) + 1)]
        return [*(at_s for at_s in whole if 0.0 < at_s < self.at_s), self.at_s]

    def forecast_times_s(self) -> list[float]:
        """Return the times of the isochrones ahead: each hour, and the end of the forecast."""
        hours = range(1, int(self.forecast_s // HOUR_S) + 1)
        times_s = [self.at_s + hour * HOUR_S for hour in hours]
        end_s = self.at_s + self.forecast_s
        return times_s if not self.forecast_s or end_s in times_s else [*times_s, end_s]

    def likely_area(self, level: float) -> Any:
        """Return the area that burns by the end of the forecast with at least this probability."""
        assert self.probability is not None
        return front_polygons(1.0 - self.probability, 1.0 - level, self.landscape)

    def likely_acres(self, level: float) -> float:
        """Return the geodesic area of ``likely_area`` in acres."""
        return geodesic_acres(area_geometry(self.likely_area(level), self.landscape))


def hectares(acres: float) -> float:
    """Convert acres to hectares."""
    return acres * M2_PER_ACRE / 1e4
