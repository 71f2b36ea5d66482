"""Defines the tables for wind that varies in space."""

from datetime import datetime
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from firemodel.landscape.wind_options import Height, North, Unit
from mission_service.config.section_base import Finite, Latitude, Line, Longitude, Section


class WindFilePair(Section):
    """The grids of speed and direction at one time: ``at_s``, or a calendar ``time``."""

    speed: Path
    direction: Path
    at_s: Finite | None = None
    time: datetime | None = None

    @property
    def time_given(self) -> float | datetime | None:
        """The time of the wind, if it is given."""
        return self.time if self.at_s is None else self.at_s

    @model_validator(mode="after")
    def _one_time(self) -> "WindFilePair":
        if self.at_s is not None and self.time is not None:
            raise ValueError("specify either at_s or `time`")
        return self


class WindGridsSection(Section):
    """Wind that varies in space and time, instead of the wind of the weather.

    The wind is in one file ``path`` (.atm, GeoTIFF, NetCDF, GRIB), or in ``pairs`` of files with
    speed and direction. ``at_s`` are the times of the winds in ``path`` if it has none; ``start``
    is the calendar time of mission time 0, by default that of the weather file, or ``time_zero``.
    ``unit``, ``height`` (above the vegetation), ``north`` (of directions) and ``crs`` are needed if
    the files do not contain them. Winds are interpolated every ``interval_s``.
    """

    path: Path | None = None
    pairs: tuple[WindFilePair, ...] = ()
    at_s: tuple[Finite, ...] = ()
    start: datetime | None = None
    unit: Unit | None = None
    height: Height | None = None
    north: North | None = None
    crs: Line | None = None
    interval_s: Annotated[float, Field(ge=60, le=86_400)] = 900.0

    @model_validator(mode="after")
    def _one_source(self) -> "WindGridsSection":
        if (self.path is None) == (not self.pairs):
            raise ValueError("specify either `path` or `pairs`")
        if self.at_s and self.path is None:
            raise ValueError("at_s has no effect with `pairs`; specify at_s or `time` in each pair")
        return self


class TerrainWindSection(Section):
    """Wind over terrain: the wind of the weather becomes the wind of each cell.

    The wind of the weather is that 20 ft above the vegetation at the station with the position
    ``station_lat_deg``, ``station_lon_deg``, or without a station the free wind around the
    landscape.
    """

    station_lat_deg: Latitude | None = None
    station_lon_deg: Longitude | None = None

    @property
    def station(self) -> tuple[float, float] | None:
        """The latitude and longitude of the station, if it is given."""
        if self.station_lat_deg is None or self.station_lon_deg is None:
            return None
        return self.station_lat_deg, self.station_lon_deg

    @model_validator(mode="after")
    def _whole_position(self) -> "TerrainWindSection":
        if (self.station_lat_deg is None) != (self.station_lon_deg is None):
            raise ValueError("specify both station_lat_deg and station_lon_deg, or neither")
        return self
