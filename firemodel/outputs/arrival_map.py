"""Draw a map of a fire as a PNG with hillshade, fuel, hours of arrival, isochrones and scale."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape

Frame = tuple[float, float, float, float]  # west, east, south, north in km from the SW corner
MAX_ISOCHRONES = 12
MIN_SCALE_H = 1 / 60  # minimum range of the colour scale in hours


def draw_map(path: Path, land: Landscape, arrival_s: Floats, title: str) -> None:
    """Draw a fire as a PNG with hillshade, fuel, hours of arrival, isochrones and scale.

    Args:
        path: The file to write.
        land: The landscape.
        arrival_s: Arrival times (y, x) in seconds; unburned cells have infinity.
        title: The map's title.
    """
    figure, axes = start_map(land, arrival_s, frame_around(land, arrival_s), isochrones=True)
    axes.set_title(title, parse_math=False)
    figure.savefig(path)


def start_map(
    land: Landscape, arrival_s: Floats, frame: Frame, *, isochrones: bool = False
) -> tuple[Any, Any]:
    """Return a figure and its axes, which show the base map and the fire.

    The axes are in km from the south-west corner.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import LightSource
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.5, 9), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    window, extent = _window(land, frame)
    north, east = 2.0 * land.gradient[:, window[0], window[1]]  # exaggerated
    normals = np.dstack([-east, -north, np.ones(north.shape)])
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    shade = LightSource(315, 45).shade_normals(normals)
    axes.imshow(shade, cmap="gray", extent=extent, vmin=-0.4, vmax=1.1, interpolation="bilinear")
    codes = land.fuel_model[window]
    fuel = np.ma.masked_where((codes > 90) & (codes < 100), codes)
    axes.imshow(fuel, cmap="YlGn_r", extent=extent, alpha=0.25, interpolation="nearest")
    hours = np.ma.masked_invalid(np.where(np.isfinite(arrival_s), arrival_s / 3600.0, np.nan))
    hours = hours[window]
    if hours.count():
        first, last = float(hours.min()), float(hours.max())
        burned = axes.imshow(hours, cmap="autumn_r", extent=extent, alpha=0.75)
        burned.set_clim(first, max(last, first + MIN_SCALE_H))
        figure.colorbar(burned, ax=axes, label="time of arrival of the fire (h)", shrink=0.7)
        if isochrones:
            _draw_isochrones(axes, hours, extent)
    axes.set(
        xlabel="east of the west edge (km)",
        ylabel="north of the south edge (km)",
        xlim=frame[:2],
        ylim=frame[2:],
    )
    _draw_scale(axes, frame)
    return figure, axes


def frame_around(land: Landscape, arrival_s: Floats, more_xy_m: Floats | None = None) -> Frame:
    """Return a square frame, with a margin, around the fire and further points (k, 2).

    Points that are not finite, because they are too far away for the projection, are ignored.
    """
    rows, cols = np.nonzero(np.isfinite(arrival_s))
    points = np.stack(land.xy_of(rows, cols), axis=1)
    if more_xy_m is not None and len(more_xy_m):
        points = np.concatenate([points, more_xy_m[np.isfinite(more_xy_m).all(axis=1)]])
    height, width = land.shape
    if not len(points):
        points = np.stack(land.xy_of(np.array([0, height - 1]), np.array([0, width - 1])), axis=1)
    km = (points - [land.west_m, land.north_m - height * land.cell_size_m]) / 1e3
    half = 0.55 * max(*np.ptp(km, axis=0), 20 * land.cell_size_m / 1e3)
    east, north = (km.max(axis=0) + km.min(axis=0)) / 2
    return east - half, east + half, north - half, north + half


def _window(land: Landscape, frame: Frame) -> tuple[tuple[slice, slice], Frame]:
    """Return the rows and columns within a frame, and their extent in km."""
    rows, cols = land.shape
    size = land.cell_size_m / 1e3
    left, right = max(math.floor(frame[0] / size), 0), min(math.ceil(frame[1] / size), cols)
    top = max(rows - math.ceil(frame[3] / size), 0)
    bottom = min(rows - math.floor(frame[2] / size), rows)
    extent = (left * size, right * size, (rows - bottom) * size, (rows - top) * size)
    return (slice(top, bottom), slice(left, right)), extent


def _draw_isochrones(axes: Any, hours: Any, extent: Frame) -> None:
    step = _round_step(float(np.ptp(hours.compressed())), MAX_ISOCHRONES)
    # No isochrone at the earliest time, at which only cells of the initial fire burn.
    first = math.floor(hours.min() / step + 1e-9) + 1
    levels = np.arange(first, math.floor(hours.max() / step) + 1) * step
    if min(hours.shape) < 2 or not len(levels):
        return
    lines = axes.contour(
        hours, levels=levels, extent=extent, origin="upper", colors="black", linewidths=0.6
    )
    axes.clabel(lines, fmt=lambda hour: f"{hour:g} h", fontsize=7)


def _draw_scale(axes: Any, frame: Frame) -> None:
    width = frame[1] - frame[0]
    length = _round_step(width, 4)
    x, y = frame[0] + 0.05 * width, frame[2] + 0.05 * (frame[3] - frame[2])
    for colour, thickness in (("white", 6), ("black", 3)):
        axes.plot([x, x + length], [y, y], color=colour, linewidth=thickness, solid_capstyle="butt")
    label = f"{length:g} km" if length >= 1 else f"{1000 * length:g} m"
    text = axes.text(x + length / 2, y + 0.012 * width, label, ha="center", va="bottom")
    text.set_bbox({"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 1})


def _round_step(span: float, most: int) -> float:
    """Return the smallest of ..., 1, 2, 5, 10, ... that makes at most ``most`` steps of a span."""
    if span <= 0.0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(span / most))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power * most >= span)
