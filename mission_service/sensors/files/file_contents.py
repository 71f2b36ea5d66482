"""The observations in a file, and the landscape's grid to which the observations refer."""

from datetime import UTC, datetime, timedelta
from typing import Literal
from zoneinfo import ZoneInfo

import msgspec
import numpy as np

from firemodel.landscape.landscape import Landscape
from mission_service.events import Place
from mission_service.ground_distance import M_PER_DEG

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
MARGIN_DEG = 0.05  # margin around the landscape, for pixels whose centre is outside it


class FileReport(msgspec.Struct, frozen=True, tag=True):
    """A report about positions (latitude, longitude), as in the event ``FireObserved``."""

    state: Literal["burned", "burning", "unburned", "smoke"]
    shape: Literal["points", "line", "polygon"]
    points: tuple[Place, ...]
    seen_unix_s: float
    position_sd_m: float
    source: str
    false_alarms: float = 0.0
    islands: tuple[tuple[Place, ...], ...] = ()


class FileCells(msgspec.Struct, frozen=True, tag=True):
    """A window of cells of the landscape's grid, as in the event ``Observed``."""

    row: int
    col: int
    cells: tuple[str, ...]
    seen_unix_s: float
    position_sd_m: float
    source: str


class FileContents(msgspec.Struct, frozen=True):
    """The observations in a file, in order of time, and notes on features that are not used."""

    kind: str
    observations: tuple[FileReport | FileCells, ...]
    notes: tuple[str, ...] = ()


class FileSettings(msgspec.Struct, frozen=True):
    """The keys of ``[estimate.observation_files]`` on which the contents of a file depend."""

    time_zone: str
    position_sd_m: float
    burned_values: tuple[float, ...]
    unburned_values: tuple[float, ...]

    @property
    def zone(self) -> ZoneInfo:
        """The time zone of times without an offset from UTC."""
        return ZoneInfo(self.time_zone)


class Grid(msgspec.Struct, frozen=True):
    """The grid of a landscape."""

    crs: str
    west_m: float
    north_m: float
    cell_size_m: float
    rows: int
    cols: int

    def level_ground(self) -> Landscape:
        """Return a landscape with level ground and a single fuel on this grid."""
        fuel = np.ones((self.rows, self.cols), dtype=np.int16)
        level = np.zeros(fuel.shape, dtype=np.float32)
        return Landscape(self.crs, self.west_m, self.north_m, self.cell_size_m, fuel, level)


def utc_of(unix_s: float) -> str:
    """Convert a time in seconds since 1970 to ISO 8601 text in UTC."""
    return (EPOCH + timedelta(seconds=unix_s)).isoformat()


def grid_of(landscape: Landscape) -> Grid:
    """Return the grid of a landscape."""
    west_m, north_m, cell_m = landscape.west_m, landscape.north_m, landscape.cell_size_m
    return Grid(landscape.crs, west_m, north_m, cell_m, *landscape.shape)


def degrees_around(landscape: Landscape) -> tuple[float, float, float, float]:
    """Return south, west, north and east (degrees) of the landscape with a margin around it."""
    rows, cols = landscape.shape
    row, col = np.array([0, 0, rows, rows]), np.array([0, cols, 0, cols])
    lat, lon = landscape.lat_lon_of(*landscape.xy_of(row.astype(float), col.astype(float)))
    widest = MARGIN_DEG / max(np.cos(np.radians(np.abs(lat).max())), 0.01)
    half = landscape.cell_size_m / M_PER_DEG
    south, north = lat.min() - MARGIN_DEG - half, lat.max() + MARGIN_DEG + half
    return float(south), float(lon.min() - widest), float(north), float(lon.max() + widest)
