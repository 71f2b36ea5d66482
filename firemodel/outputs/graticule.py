"""Draw the graticule (parallels and meridians with coordinates) and north arrow of a map."""

import math
from typing import Any

import numpy as np

from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape

Frame = tuple[float, float, float, float]  # west, east, south, north in km from the SW corner
STEPS_MIN = (0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 20, 30, 60, 120, 300, 600)
MAX_LINES = 6
POINTS = 40  # number of points on each line; lines are curved in most projections


def km_of(land: Landscape, lat_deg: Any, lon_deg: Any) -> tuple[Any, Any]:
    """Convert WGS84 coordinates to km east and north of the landscape's south-west corner."""
    x_m, y_m = land.xy_of_lat_lon(lat_deg, lon_deg)
    return (x_m - land.west_m) / 1e3, (y_m - land.south_m) / 1e3


def draw_graticule(axes: Any, land: Landscape, frame: Frame) -> None:
    """Draw parallels and meridians, with WGS84 degrees and decimal minutes on the axes.

    Args:
        axes: Axes in km from the landscape's south-west corner.
        land: The landscape, for its projection.
        frame: The limits of the axes.
    """
    lat_deg, lon_deg = _edge_places(land, frame)
    marks: dict[str, list[tuple[float, str]]] = {"x": [], "y": []}
    for across in ("x", "y"):
        of, along = (lon_deg, lat_deg) if across == "x" else (lat_deg, lon_deg)
        step_min = _step_min(float(np.ptp(of)))
        others = np.linspace(along.min(), along.max(), POINTS)
        first, last = math.ceil(of.min() * 60 / step_min), math.floor(of.max() * 60 / step_min)
        for number in range(first, last + 1):
            fixed = np.full(POINTS, number * step_min / 60.0)
            place = (others, fixed) if across == "x" else (fixed, others)
            x, y = km_of(land, *place)
            axes.plot(x, y, color="black", linewidth=0.4, alpha=0.5, scalex=False, scaley=False)
            at = _crossing(y, x, frame[2]) if across == "x" else _crossing(x, y, frame[0])
            marks[across].append((at, _label(number, step_min, "EW" if across == "x" else "NS")))
    for across, (low, high) in (("x", frame[:2]), ("y", frame[2:])):
        inside = [mark for mark in marks[across] if low <= mark[0] <= high]
        axis = axes.xaxis if across == "x" else axes.yaxis
        axis.set_ticks([at for at, _ in inside], [label for _, label in inside])
    axes.tick_params(axis="y", labelrotation=90)
    for label in axes.get_yticklabels():
        label.set_verticalalignment("center")
    axes.set(xlim=frame[:2], ylim=frame[2:])


def draw_north(axes: Any, land: Landscape) -> None:
    """Draw an arrow towards true north in the upper right corner of axes with grid north up."""
    turn = math.radians(land.grid_deg(0.0))
    east, north = 0.075 * math.sin(turn), 0.075 * math.cos(turn)
    arrow = {"arrowstyle": "-|>,head_width=0.5,head_length=0.9", "linewidth": 2, "color": "black"}
    axes.annotate(
        "N",
        xy=(0.95 + east / 2, 0.93 + north / 2),
        xytext=(0.95 - east / 2, 0.93 - north / 2),
        xycoords="axes fraction",
        ha="center",
        va="center",
        fontsize=12,
        fontweight="bold",
        arrowprops=arrow,
        bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 2},
    )


def _edge_places(land: Landscape, frame: Frame) -> tuple[Floats, Floats]:
    """Return the latitudes and (unwrapped) longitudes of points on the edge of a frame."""
    west, east, south, north = (1e3 * each for each in frame)
    along, zero = np.linspace(0.0, 1.0, POINTS), np.zeros(POINTS)
    x = west + (east - west) * np.concatenate([along, along, zero, zero + 1.0])
    y = south + (north - south) * np.concatenate([zero, zero + 1.0, along, along])
    lat_deg, lon_deg = land.lat_lon_of(land.west_m + x, land.south_m + y)
    inside = np.isfinite(lat_deg) & np.isfinite(lon_deg)
    return lat_deg[inside], land.unwrapped_deg(lon_deg[inside])


def _step_min(span_deg: float) -> float:
    """Return the smallest round step, in minutes, that gives at most ``MAX_LINES`` lines."""
    return next((step for step in STEPS_MIN if span_deg * 60 <= MAX_LINES * step), STEPS_MIN[-1])


def _crossing(along: Floats, across: Floats, at: float) -> float:
    """Return the position at which a line crosses an edge of the frame, or NaN."""
    order = np.argsort(along)
    return float(np.interp(at, along[order], across[order], left=math.nan, right=math.nan))


def _label(number: int, step_min: float, sides: str) -> str:
    """Return a label in degrees and decimal minutes, for example 36°21.5′N.

    Degrees beyond 180 are those on the other side of the antimeridian.
    """
    turn = round(360.0 * 60.0 / step_min)
    if abs(number) > turn / 2:
        number -= turn if number > 0 else -turn
    decimals = 2 if step_min < 0.1 else 1 if step_min < 1 else 0
    whole, minutes = divmod(round(abs(number) * step_min, 2), 60.0)
    width = 2 if decimals == 0 else 3 + decimals
    return f"{whole:.0f}°{minutes:0{width}.{decimals}f}′{sides[number < 0]}"
