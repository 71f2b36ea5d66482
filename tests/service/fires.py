"""A small fire in files: rasters, weather, ignition, and the scenario that names these files."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import Point, mapping
from shapely.geometry.base import BaseGeometry

from firemodel.landscape.landscape import Landscape
from firemodel.landscape.readers.shapes import into_crs
from tests.firemodel.grids import landscape, write_raster
from tests.firemodel.test_shapes import geojson

SIZE = 60
ROW, COL = np.mgrid[:SIZE, :SIZE]
HEIGHTS = (200.0 + 4.0 * np.abs(COL - 30) + 2.0 * ROW).astype(np.float32)
LAND = landscape(np.where(ROW < 40, 2, 1), HEIGHTS)
LIT = (30, 18)  # row, column
FILES = '[landscape]\nsource = "files"\n'
TIFFS = FILES + 'fuel = "fuel.tif"\nelevation = "dem.tif"\n'
CSV = '[weather_file]\npath = "weather.csv"\nstart = 2024-07-01T12:00:00\n'
POINT = '[[ignition]]\nfile = "lit.geojson"\n'
HEAD = 'name = "small"\nseed = 5\nduration_s = 3600\n'
FLAT = """\
name = "flat"
seed = 3
duration_s = 1800
[landscape]
source = "flat"
lat_deg = 37.0
lon_deg = -119.0
rows = 60
cols = 60
[[ignition]]
lat_deg = 37.0
lon_deg = -119.0
[[weather]]
at_s = 0
wind_speed_m_s = 2
wind_from_deg = 250
"""
# Two hours; the file contains all moistures except the live ones.
WEATHER = """\
time,wind_speed_m_s,wind_from_deg,dead_1h_pct,dead_10h_pct,dead_100h_pct
2024-07-01T11:00,5,270,6,7,8
2024-07-01T12:30,6,250,5,6,7
2024-07-01T14:00,7,240,5,6,7
"""


def at(row: float, col: float) -> tuple[float, float]:
    """Return longitude and latitude of a place on the grid."""
    lat, lon = LAND.lat_lon_of(*LAND.xy_of(row, col))
    return lon, lat


def drawn(path: Path, *shapes: BaseGeometry) -> Path:
    """Return shapes in the landscape's CRS as GeoJSON."""
    return geojson(path, *(mapping(into_crs(shape, LAND.crs, "EPSG:4326")) for shape in shapes))


def on_grid(row: float, col: float) -> Point:
    """Return a place on the grid in the landscape's CRS."""
    return Point(*LAND.xy_of(row, col))


def write_site(folder: Path, land: Landscape = LAND, fuel: NDArray[Any] | None = None) -> Path:
    """Write the files that ``TIFFS``, ``CSV`` and ``POINT`` name."""
    write_raster(folder / "fuel.tif", land.fuel_model if fuel is None else fuel)
    assert land.elevation_m is not None
    write_raster(folder / "dem.tif", land.elevation_m)
    (folder / "weather.csv").write_text(WEATHER, encoding="utf-8")
    lat, lon = land.lat_lon_of(*land.xy_of(*LIT))
    geojson(folder / "lit.geojson", {"type": "Point", "coordinates": [lon, lat]})
    return folder


def write_scenario(folder: Path, *parts: str, head: str = HEAD) -> Path:
    """Write a scenario with these tables; without tables, with the usual ones."""
    path = folder / "fire.toml"
    path.write_text("\n".join([head, *(parts or (TIFFS, CSV, POINT))]), encoding="utf-8")
    return path


def write_flat(folder: Path) -> Path:
    """Write a scenario of level ground without further files."""
    path = folder / "flat.toml"
    path.write_text(FLAT, encoding="utf-8")
    return path
