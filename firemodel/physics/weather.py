"""Define weather streams: each entry is in effect from its time until the next entry."""

import bisect
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from datetime import datetime, timedelta
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.physics.rothermel import M_PER_FT, Moisture
from firemodel.physics.wind_field import WindField

WIND_10M_OVER_20FT = 1.15
Numbers = float | NDArray[np.floating]
NOT_NUMBERS = ("of_fuels", "of_zones", "wind_field")
DEAD_PCT = ("dead_1h_pct", "dead_10h_pct", "dead_100h_pct")
DeadMoistures = tuple[float, float, float]  # of 1-h, 10-h and 100-h fuel, as fractions


@dataclass(frozen=True, slots=True)
class Weather:
    """The weather in effect from ``at_s`` on.

    The wind speed is the speed 6.1 m (20 ft) above the vegetation. The wind direction is the
    direction from which the wind blows, in degrees clockwise from true north. Moistures are in
    percent of the oven-dry weight. ``of_fuels`` contains pairs of a fuel code and its moistures
    (fractions), for fuels with their own moistures. ``of_zones`` contains the dead moistures in
    each zone of a landscape (``moisture_zones``), or nothing if these moistures are the same
    everywhere. With ``wind_field``, wind speed and direction apply to the whole landscape, and the
    local wind is relative to them.
    """

    at_s: float
    wind_speed_m_s: float
    wind_from_deg: float
    dead_1h_pct: float
    dead_10h_pct: float
    dead_100h_pct: float
    live_herb_pct: float
    live_woody_pct: float
    of_fuels: tuple[tuple[int, Moisture], ...] = field(default=(), kw_only=True)
    of_zones: tuple[DeadMoistures, ...] = field(default=(), kw_only=True)
    wind_field: WindField | None = field(default=None, kw_only=True)

    def moisture_of(self, code: int, zone: int = 0) -> Moisture:
        """Return the moistures of a fuel in a zone as fractions.

        Dead moistures in ``of_zones`` take precedence over moistures in ``of_fuels``, which take
        precedence over the others.
        """
        found = dict(self.of_fuels).get(code, self.moisture)
        if not self.of_zones:
            return found
        return Moisture(*self.of_zones[zone], found.live_herb, found.live_woody)

    def with_dead_moisture(self, factor: float) -> "Weather":
        """Return this entry with all dead moistures multiplied by a factor."""
        dead = {name: factor * getattr(self, name) for name in DEAD_PCT}
        own = (
            (
                code,
                Moisture(
                    factor * each.dead_1h,
                    factor * each.dead_10h,
                    factor * each.dead_100h,
                    each.live_herb,
                    each.live_woody,
                ),
            )
            for code, each in self.of_fuels
        )
        zones = (tuple(factor * wet for wet in zone) for zone in self.of_zones)
        return replace(self, **dead, of_fuels=tuple(own), of_zones=tuple(zones))  # type: ignore[arg-type]

    def in_wind(self, speed_m_s: float, from_deg: float) -> "Weather":
        """Return this entry with another wind and the corresponding local winds."""
        field = self.wind_field
        if field is not None:
            field = field.turned(from_deg - self.wind_from_deg)
        return replace(
            self, wind_speed_m_s=speed_m_s, wind_from_deg=from_deg % 360.0, wind_field=field
        )

    @property
    def moisture(self) -> Moisture:
        """The moistures as fractions, for fuels that are not in ``of_fuels``."""
        return Moisture(
            self.dead_1h_pct / 100.0,
            self.dead_10h_pct / 100.0,
            self.dead_100h_pct / 100.0,
            self.live_herb_pct / 100.0,
            self.live_woody_pct / 100.0,
        )


class WeatherSource(NamedTuple):
    """The file from which a stream was read, for messages about the records in the file.

    ``start`` is the time in the file that is 0 s of the stream, or None if the times in the file
    are in seconds. ``humidity_pct`` contains the humidity of each entry of the stream, or is None
    if the file contains no humidity.
    """

    name: str
    start: datetime | None = None
    humidity_pct: tuple[float, ...] | None = None

    def place(self, at_s: float) -> str:
        """Return the file and the time of a record, for a message."""
        if self.start is None:
            return f"{self.name}, record at {at_s:g} s"
        return f"{self.name}, record of {self.start + timedelta(seconds=at_s):%Y-%m-%dT%H:%M}"


class WeatherStream:
    """Weather entries in chronological order, the first at 0 s or earlier."""

    def __init__(self, entries: Sequence[Weather], source: WeatherSource | None = None) -> None:
        """Raise FireModelError for an invalid entry; the message names the entry and the value."""
        if not entries:
            raise FireModelError("weather: no entries; specify at least one, at 0 s")
        for number, entry in enumerate(entries):
            _check(number, entry)
            if number and not entry.at_s > entries[number - 1].at_s:
                raise FireModelError(
                    f"weather entry {number}: at_s = {entry.at_s} is not later than the previous "
                    f"entry ({entries[number - 1].at_s}); sort the entries by time"
                )
        if entries[0].at_s > 0.0:
            raise FireModelError(
                f"weather entry 0: at_s = {entries[0].at_s}, so the weather before it is missing; "
                "the first entry must be at 0 s or earlier"
            )
        self.entries = tuple(entries)
        self.source = source
        self._times = [entry.at_s for entry in entries]

    def index_at(self, time_s: float) -> int:
        """Return the index of the entry in effect at the given time."""
        return max(bisect.bisect_right(self._times, time_s) - 1, 0)

    def weather_at(self, time_s: float) -> Weather:
        """Return the entry in effect at the given time."""
        return self.entries[self.index_at(time_s)]

    def blown(self, speed_m_s: float, from_deg: float, at_s: float) -> "WeatherStream":
        """Return the stream with a new, constant wind from ``at_s`` on and no later entries."""
        entry = replace(self.weather_at(at_s).in_wind(speed_m_s, from_deg), at_s=at_s)
        return WeatherStream((*(each for each in self.entries if each.at_s < at_s), entry))

    def since(self, time_s: float) -> "WeatherStream":
        """Return the stream from the given time on.

        The entry in effect at that time is extended back to 0 s.
        """
        first, *later = self.entries[self.index_at(time_s) :]
        return WeatherStream((replace(first, at_s=min(first.at_s, 0.0)), *later))

    def change_times(self) -> tuple[float, ...]:
        """Return the times in seconds of all entries except the first."""
        return tuple(self._times[1:])

    def changes(self) -> tuple[Weather, ...]:
        """Return the first entry and each entry that differs from its predecessor."""
        pairs = zip(self.entries[1:], self.entries[:-1], strict=True)
        others = [new for new, old in pairs if replace(new, at_s=0.0) != replace(old, at_s=0.0)]
        return (self.entries[0], *others)


def _check(number: int, entry: Weather) -> None:
    for name in (each.name for each in fields(entry) if each.name not in NOT_NUMBERS):
        value = getattr(entry, name)
        if not math.isfinite(value):
            raise FireModelError(f"weather entry {number}: {name} = {value} is not a number")
        if name != "at_s" and value < 0.0:
            raise FireModelError(f"weather entry {number}: {name} = {value} must not be negative")
    if entry.wind_from_deg > 360.0:
        raise FireModelError(
            f"weather entry {number}: wind_from_deg = {entry.wind_from_deg} must be 0 to 360, "
            "clockwise from north"
        )


def wind_20ft_from_10m(wind_10m: float | Floats) -> float | Floats:
    """Convert wind at 10 m to wind at 20 ft (6.1 m) above the vegetation, in the same unit.

    The ratio is from Andrews 2012 (RMRS-GTR-266), after Turner & Lawson 1978.
    """
    return wind_10m / WIND_10M_OVER_20FT


def crown_ratio_from_base(canopy_height_m: Numbers, canopy_base_m: Numbers) -> Floats:
    """Return the crown ratio (crown length over tree height); 0 where there are no trees."""
    height_m = np.asarray(canopy_height_m, dtype=np.float64)
    some = np.where(height_m > 0.0, height_m, 1.0)
    ratio = np.where(height_m > 0.0, 1.0 - np.asarray(canopy_base_m) / some, 0.0)
    return np.clip(ratio, 0.0, 1.0)


def unsheltered_factor(depth_ft: Floats) -> Floats:
    """Return the wind adjustment factor of fuel that is not under trees; 0 without fuel.

    The factor gives the mean wind between the top of the fuel and twice the height of the fuel
    (Andrews 2012, after Albini & Baughman 1979, INT-221).
    """
    some = np.where(depth_ft > 0.0, depth_ft, 1.0)
    return np.where(depth_ft > 0.0, 1.83 / np.log((20.0 + 0.36 * some) / (0.13 * some)), 0.0)


def sheltered_factor(crown_fill: Floats, canopy_height_ft: Floats) -> Floats:
    """Return the wind adjustment factor below a canopy (Andrews 2012).

    The equation is from Albini & Baughman 1979.

    ``crown_fill`` is the fraction of the volume below the tree tops that is filled by crowns.
    """
    profile = np.log((20.0 + 0.36 * canopy_height_ft) / (0.13 * canopy_height_ft))
    return 0.555 / (np.sqrt(crown_fill * canopy_height_ft) * profile)


def wind_adjustment_factor(
    depth_ft: Numbers,
    canopy_cover: Numbers = 0.0,
    canopy_height_m: Numbers = 0.0,
    crown_ratio: Numbers = 0.0,
) -> float | Floats:
    """Return the ratio of the midflame wind to the wind 20 ft above the vegetation (Andrews 2012).

    The fuel depth is in ft; canopy cover and crown ratio are fractions. All arguments are numbers
    or arrays of the same shape. Crowns are assumed to be cones. The cones fill the fraction
    ``canopy_cover * crown_ratio / 3`` of the volume below the tree tops. Fuel is sheltered if
    crowns fill at least 5 % of the volume and, as in `behave`, the canopy is at least 6 ft high.
    See RMRS-GTR-266. Raises FireModelError for a cover or ratio outside 0 to 1.
    """
    for name, part in (("canopy_cover", canopy_cover), ("crown_ratio", crown_ratio)):
        wrong = ~((np.asarray(part) >= 0.0) & (np.asarray(part) <= 1.0))
        if wrong.any():
            value = np.asarray(part)[wrong][0]
            raise FireModelError(f"{name} = {value}: must be a fraction from 0 to 1, not percent")
    fill = np.asarray(canopy_cover) * crown_ratio / 3.0
    height_ft = np.asarray(canopy_height_m) / M_PER_FT
    sheltered = (fill >= 0.05) & (height_ft >= 6.0)
    below = sheltered_factor(np.where(sheltered, fill, 1.0), np.where(sheltered, height_ft, 6.0))
    factor: Floats = np.where(
        sheltered, below, unsheltered_factor(np.asarray(depth_ft, dtype=np.float64))
    )
    return factor[()]
