"""Draw maps of a fire as PNG: hillshade, fuel, arrival times, isochrones, graticule and scale."""

import math
import warnings
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape
from firemodel.outputs.event_polygon import M2_PER_ACRE
from firemodel.outputs.graticule import Frame, draw_graticule, draw_north
from firemodel.outputs.layer_legends import (
    Layer,
    arrival_layer,
    arrival_layer_of,
    fuel_groups,
    fuel_layer,
)
from firemodel.outputs.whole_file import whole_file
from firemodel.physics.fuels import NON_BURNABLE
from firemodel.spread.fire_scheme import Fire

MAX_ISOCHRONES = 12
MAX_TITLE = 90  # number of characters that fit in the figure
FUEL_ALPHA, FIRE_ALPHA = 0.45, 0.85
NOTE = "Simulated fire. Not for navigation. {crs}, graticule WGS 84, arrow to true north."


def draw_map(path: Path | str, fire: Fire, title: str, time_zero: datetime | None = None) -> None:
    """Draw a fire as a PNG with the time, burned area, arrival times, isochrones and graticule.

    Args:
        path: The file to write.
        fire: A fire that has been advanced to the time of interest.
        title: The map's title.
        time_zero: The calendar time of 0 s, if there is one.

    Raises:
        FireModelError: The file cannot be written.
    """
    arrival_s = fire.burned_arrival_s()
    line = status_line(fire, time_zero)
    layer = arrival_layer_of(fire, time_zero)
    draw_arrival(Path(path), fire.landscape, arrival_s, title, line, layer)


def draw_arrival(
    path: Path,
    land: Landscape,
    arrival_s: Floats,
    title: str,
    line: str,
    layer: Layer,
) -> None:
    """Draw arrival times (y, x) in the style of ``draw_map``; ``line`` goes below the title."""
    frame = frame_around(land, arrival_s)
    figure, axes = start_map(land, arrival_s, frame, isochrones=True, layer=layer)
    set_title(axes, title, line)
    with whole_file(path) as part:
        save_map(figure, part)


def save_map(figure: Any, file: Any) -> None:
    """Write a figure from ``start_map`` as a PNG without the software's name.

    ``print_png`` draws the figure once. ``savefig`` would draw it twice, first for the layout
    alone.

    Args:
        figure: The figure. Characters that the font does not contain are drawn as boxes, without a
            warning.
        file: The path or the open binary file to write.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "(Glyph|Matplotlib currently does not support)")
        figure.canvas.print_png(file, metadata={"Software": None})


def status_line(fire: Fire, time_zero: datetime | None = None) -> str:
    """Return a text with the fire's time and burned area."""
    area_m2 = fire.front(fire.time_s).area
    return f"{time_in_words(fire.time_s, time_zero)} · burned: {area_in_words(area_m2)}"


def time_in_words(time_s: float, time_zero: datetime | None) -> str:
    """Return a time after mission time 0 as text, with the date if ``time_zero`` is given."""
    after = f"{time_s / 3600.0:.4g} h after mission time 0"
    if time_zero is None:
        return f"{after} (no calendar date)"
    instant = time_zero + timedelta(seconds=time_s)
    return f"{instant.isoformat(sep=' ', timespec='minutes')}, {after}"


def area_in_words(area_m2: float) -> str:
    """Return an area in hectares and acres."""
    return f"{area_m2 / 1e4:,.1f} ha ({area_m2 / M2_PER_ACRE:,.0f} acres)"


def set_title(axes: Any, title: str, line: str) -> None:
    """Set a title in bold, shortened to ``MAX_TITLE``, with a second line below it."""
    if len(title) > MAX_TITLE:
        title = f"{title[: MAX_TITLE - 1]}…"
    axes.set_title(title, loc="left", pad=20, fontsize=13, fontweight="bold", parse_math=False)
    axes.text(0.0, 1.01, line, transform=axes.transAxes, fontsize=10, va="bottom")


def start_map(
    land: Landscape,
    arrival_s: Floats,
    frame: Frame,
    *,
    isochrones: bool = False,
    layer: Layer | None = None,
) -> tuple[Any, Any]:
    """Return a figure and its axes, which show the base map and the fire, with a legend.

    The axes are in km from the south-west corner, and labelled with the graticule. The classes of
    arrival times are those of ``layer``; without a layer, the classes are derived from the times on
    the map.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 9.2), dpi=120)
    FigureCanvasAgg(figure)
    figure.set_layout_engine("compressed", w_pad=0.12, h_pad=0.12)
    axes = figure.add_subplot()
    fuel = draw_ground(axes, land, frame)
    parts = draw_classes(axes, land, arrival_s, frame, isochrones=isochrones, layer=layer)
    axes.set_xlabel(NOTE.format(crs=land.crs if len(land.crs) < 20 else "Grid"), fontsize=9)
    draw_graticule(axes, land, frame)
    draw_north(axes, land)
    draw_scale(axes, frame)
    _draw_legend(axes, {**parts, "Fuel": fuel})
    return figure, axes


def draw_ground(axes: Any, land: Landscape, frame: Frame) -> list[tuple[str, str]]:
    """Draw hillshade and fuel within a frame; return the colours and names of the fuels.

    ``axes`` are in km from the landscape's south-west corner.
    """
    from matplotlib.colors import LightSource

    window, extent = _window(land, frame)
    north, east = 2.0 * land.gradient[:, window[0], window[1]]  # slopes are exaggerated
    normals = np.dstack([-east, -north, np.ones(north.shape)])
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    shade = LightSource(315, 45).shade_normals(normals)
    axes.imshow(shade, cmap="gray", extent=extent, vmin=-0.4, vmax=1.1, interpolation="bilinear")
    codes = land.fuel_model[window]
    fuel = _coloured(codes, fuel_layer(codes), FUEL_ALPHA)
    axes.imshow(fuel, extent=extent, interpolation="nearest")
    groups = [group for group in fuel_groups(codes) if np.isin(codes, group.codes).any()]
    return [*((group.colour, group.name) for group in groups), *_unburnable(codes)]


def draw_classes(
    axes: Any,
    land: Landscape,
    arrival_s: Floats,
    frame: Frame,
    *,
    isochrones: bool = False,
    layer: Layer | None = None,
) -> dict[str, list[tuple[str, str]]]:
    """Draw arrival times in the colours of their classes; return their part of the legend."""
    window, extent = _window(land, frame)
    times_s = np.ma.masked_invalid(np.where(np.isfinite(arrival_s), arrival_s, np.nan))[window]
    if not times_s.count():
        return {}
    layer = layer or arrival_layer(float(times_s.min()), float(times_s.max()), None)
    fire = _coloured(times_s.filled(np.nan), layer, FIRE_ALPHA)
    axes.imshow(fire, extent=extent, interpolation="nearest")
    if isochrones:
        _draw_isochrones(axes, times_s / 3600.0, extent)
    return {"Arrival of fire": [(each.colour, each.label) for each in layer.classes]}


def _coloured(values: NDArray[Any], layer: Layer, alpha: float) -> NDArray[np.uint8]:
    """Return the colours (y, x, 4) of the values' classes; NaN is transparent."""
    limits = [each.upto for each in layer.classes]
    place = np.minimum(np.searchsorted(limits, values), len(limits) - 1)
    place[np.isnan(values)] = len(limits)
    colours = [(*each.rgb, round(255 * alpha)) for each in layer.classes]
    return np.array([*colours, (0, 0, 0, 0)], np.uint8)[place]


def _unburnable(codes: NDArray[Any]) -> list[tuple[str, str]]:
    """Return the colours and names of the unburnable codes in a map."""
    return [
        (each.colour, each.label)
        for each in fuel_layer(codes).classes
        if each.upto in NON_BURNABLE and (codes == each.upto).any()
    ]


def _draw_legend(axes: Any, parts: Mapping[str, Sequence[tuple[str, str]]]) -> None:
    """Draw colours and labels under headings, beside the map."""
    from matplotlib.legend import Legend
    from matplotlib.patches import Patch

    handles, labels = [], []
    for heading, entries in parts.items():
        handles.append(Patch(alpha=0.0))
        labels.append(heading)
        for colour, label in entries:
            handles.append(Patch(facecolor=colour, edgecolor="0.4", linewidth=0.5))
            labels.append(label)
    legend = Legend(
        axes, handles, labels, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0,
        fontsize=9, frameon=False,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_fontweight("bold" if text.get_text() in parts else "normal")
    axes.add_artist(legend)  # keeps this legend if a caller adds another one
    legend.set_clip_box(None)  # the legend is outside the axes


def frame_around(land: Landscape, arrival_s: Floats, more_xy_m: Floats | None = None) -> Frame:
    """Return a square frame, with a margin, around the fire and any additional points (k, 2).

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
    half = 0.6 * max(*np.ptp(km, axis=0), 20 * land.cell_size_m / 1e3)
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
    from matplotlib.patheffects import withStroke

    step = _round_step(float(np.ptp(hours.compressed())), MAX_ISOCHRONES)
    # No isochrone at the earliest time, when only cells of the initial fire burn.
    first = math.floor(hours.min() / step + 1e-9) + 1
    levels = np.arange(first, math.floor(hours.max() / step) + 1) * step
    if min(hours.shape) < 2 or not len(levels):
        return
    lines = axes.contour(
        hours, levels=levels, extent=extent, origin="upper", colors="black", linewidths=0.6
    )
    labels = axes.clabel(lines, fmt=lambda hour: f"{hour:g} h", fontsize=9)
    for label in labels:
        label.set_path_effects([withStroke(linewidth=2.5, foreground="white")])


def draw_scale(axes: Any, frame: Frame) -> None:
    """Draw a scale bar in the lower left corner of axes in km."""
    width = frame[1] - frame[0]
    length = _round_step(width, 4)
    x, y = frame[0] + 0.05 * width, frame[2] + 0.05 * (frame[3] - frame[2])
    for colour, thickness in (("white", 6), ("black", 3)):
        axes.plot([x, x + length], [y, y], color=colour, linewidth=thickness, solid_capstyle="butt")
    label = f"{length:g} km" if length >= 1 else f"{1000 * length:g} m"
    text = axes.text(x + length / 2, y + 0.012 * width, label, ha="center", va="bottom")
    text.set_bbox({"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 1})


def _round_step(span: float, most: int) -> float:
    """Return the smallest step (..., 1, 2, 5, 10, ...) with at most ``most`` steps in a span."""
    if span <= 0.0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(span / most))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power * most >= span)
