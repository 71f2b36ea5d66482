"""Draw the UTM grid of a map, and name its squares as in the US National Grid (MGRS on WGS84).

The letters follow NGA.STND.0037 (Universal Grids and the MGRS), for WGS84.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from firemodel.landscape.landscape import Landscape, transformers
from firemodel.outputs.graticule import Frame, km_of

BANDS = "CDEFGHJKLMNPQRSTUVWX"
COLUMNS = ("STUVWXYZ", "ABCDEFGH", "JKLMNPQR")  # for zones 0, 1, 2 modulo 3
ROWS = "ABCDEFGHJKLMNPQRSTUV"
STEPS_KM = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)
MAX_LINES = 8
POINTS = 30


class UtmZone(NamedTuple):
    """A UTM zone: its number and the hemisphere."""

    number: int
    is_north: bool

    @property
    def crs(self) -> str:
        """The zone's CRS (WGS84)."""
        return f"EPSG:{(32600 if self.is_north else 32700) + self.number}"


def zone_of(lat_deg: float, lon_deg: float) -> UtmZone:
    """Return the UTM zone of a position, ignoring the exceptions for Norway and Svalbard."""
    return UtmZone(int((lon_deg + 180.0) // 6.0) % 60 + 1, lat_deg >= 0.0)


def grid_square(lat_deg: float, lon_deg: float) -> str:
    """Return the grid zone and the 100 km square, such as ``16S GF``; "" beyond 80° S, 84° N."""
    if not -80.0 <= lat_deg <= 84.0:
        return ""
    zone = zone_of(lat_deg, lon_deg)
    east_m, north_m = transformers(zone.crs)[1].transform(lon_deg, lat_deg)
    band = BANDS[min(int((lat_deg + 80.0) // 8.0), len(BANDS) - 1)]
    column = COLUMNS[zone.number % 3][int(east_m // 100e3) - 1]
    shift = 5 if zone.number % 2 == 0 else 0
    row = ROWS[(int(north_m // 100e3) + shift) % len(ROWS)]
    return f"{zone.number}{band} {column}{row}"


def draw_utm_grid(axes: Any, land: Landscape, frame: Frame) -> tuple[UtmZone, float]:
    """Draw the lines of the UTM grid, labelled in km at the upper and right edge of the frame.

    Args:
        axes: Axes in km from the landscape's south-west corner.
        land: The landscape, for its projection.
        frame: The limits of the axes.

    Returns:
        The zone, and the spacing of the lines in km.
    """
    west, east, south, north = frame
    to_lon_lat = transformers(land.crs)[0]
    base = np.array([land.west_m, land.south_m])
    corners = base + 1e3 * np.array([(x, y) for x in (west, east) for y in (south, north)])
    lon, lat = to_lon_lat.transform(*corners.T)
    zone = zone_of(float(np.mean(lat)), float(np.mean(land.unwrapped_deg(lon))))
    to_utm, from_utm = transformers(zone.crs)[1], transformers(zone.crs)[0]
    e_m, n_m = to_utm.transform(lon, lat)
    span_km = max(float(np.ptp(e_m)), float(np.ptp(n_m))) / 1e3
    step_km = next((step for step in STEPS_KM if span_km <= MAX_LINES * step), STEPS_KM[-1])
    for name, across, along in (("east", e_m, n_m), ("north", n_m, e_m)):
        beyond = 0.1 * float(np.ptp(along))  # lines are not parallel to the edges of the frame
        others = np.linspace(along.min() - beyond, along.max() + beyond, POINTS)
        step_m = 1e3 * step_km
        for number in range(math.ceil(across.min() / step_m), int(across.max() // step_m) + 1):
            fixed = np.full(POINTS, number * step_m)
            eastings, northings = (fixed, others) if name == "east" else (others, fixed)
            line_lon, line_lat = from_utm.transform(eastings, northings)
            x, y = km_of(land, line_lat, line_lon)
            axes.plot(x, y, color="#1565c0", linewidth=0.45, alpha=0.75, scalex=False, scaley=False)
            _label(axes, name, f"{number * step_km:g}", (x, y), frame)
    return zone, step_km


def _label(axes: Any, name: str, text: str, line: tuple[Any, Any], frame: Frame) -> None:
    """Write a label where a line crosses the upper edge (eastings) or the right edge."""
    x, y = line
    style = {"color": "#1565c0", "fontsize": 6.5, "clip_on": False}
    if name == "east":
        at = float(np.interp(frame[3], y, x, left=math.nan, right=math.nan))
        if frame[0] <= at <= frame[1]:
            axes.annotate(
                text, (at, frame[3]), xytext=(0, 2), textcoords="offset points", ha="center",
                va="bottom", **style,
            )  # fmt: skip
    else:
        at = float(np.interp(frame[1], x, y, left=math.nan, right=math.nan))
        if frame[2] <= at <= frame[3]:
            axes.annotate(
                text, (frame[1], at), xytext=(2, 0), textcoords="offset points", ha="left",
                va="center", rotation=90, **style,
            )  # fmt: skip
