"""Draws a thermal image on the map, with its observed cells and their error ellipse.

``observation_picture`` uses functions of this module for the observations in other files.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, Mask
from firemodel.assimilation.observation import BURNED, UNBURNED
from firemodel.landscape.landscape import Landscape
from firemodel.outputs.arrival_map import save_map, set_title, start_map
from firemodel.outputs.graticule import Frame
from firemodel.outputs.whole_file import whole_file
from mission_service.fire.observed_window import states_in
from mission_service.sensors.thermal.draped_image import DrapedImage
from mission_service.sensors.thermal.frame_cells import FrameCells
from mission_service.sensors.thermal.thermal_image import ThermalImage

BURNED_COLOUR, UNBURNED_COLOUR, CAMERA_COLOUR = "#e31a1c", "#1f78ff", "#000000"
ELLIPSE_COLOUR = "#00e5ff"
NOTE = "Observed by a thermal camera. Not for navigation. Graticule WGS 84, arrow to true north."
ALPHA = 0.7
SIGMAS = 2.146  # for an ellipse that contains the true position with a probability of 90 %
SIDE_PX = 1000  # longer side of the drawn image
MARGIN = 0.12  # around the image and its camera, as a fraction of the larger extent


def draw_frame(
    path: Path, landscape: Landscape, image: ThermalImage, found: FrameCells, draped: DrapedImage
) -> None:
    """Draw an image, the outlines of its observed cells, the 90 % error ellipse and the camera.

    Raises FireModelError if the file cannot be written.
    """
    from matplotlib.lines import Line2D

    camera_m = landscape.xy_of_lat_lon(image.lat_deg, image.lon_deg)
    camera_km = km_from_corner(landscape, float(camera_m[0]), float(camera_m[1]))
    west_km, east_km, south_km, north_km = extent = _extent(landscape, draped)
    points = np.array([camera_km, (west_km, south_km), (east_km, north_km)])
    nothing = np.full(landscape.shape, np.inf)
    figure, axes = start_map(landscape, nothing, _square(points))
    limits = axes.axis()
    axes.imshow(_picture(draped), extent=extent, origin="upper", interpolation="nearest", zorder=3)
    state, corner = states_in(found.window.cells), (found.window.row, found.window.col)
    for code, colour in ((UNBURNED, UNBURNED_COLOUR), (BURNED, BURNED_COLOUR)):
        _draw_outline(axes, landscape, corner, state == code, colour)
    _draw_ellipse(axes, landscape, found)
    axes.plot(
        *camera_km, marker="^", color=CAMERA_COLOUR, markeredgecolor="white", markersize=11,
        linestyle="", zorder=6,
    )  # fmt: skip
    axes.axis(limits)
    beside = axes.legend(
        handles=[
            Line2D([], [], color=BURNED_COLOUR, linewidth=2, label="burned cells"),
            Line2D([], [], color=UNBURNED_COLOUR, linewidth=2, label="unburned cells"),
            Line2D(
                [], [], color=ELLIPSE_COLOUR, linewidth=2, label="90 % ellipse\nof the position"
            ),
            Line2D([], [], color=CAMERA_COLOUR, marker="^", linestyle="", label="camera"),
        ],
        loc="upper left", bbox_to_anchor=(1.01, 0.68), borderaxespad=0.0, fontsize=9,
        frameon=False, title="Observed", alignment="left",
        title_fontproperties={"size": 9, "weight": "bold"},
    )  # fmt: skip
    beside.set_clip_box(None)  # lies outside the axes
    _draw_scale(axes, draped)
    major_m, minor_m = (2.0 * SIGMAS * each for each in found.ellipse[:2])
    line = (
        f"{image.taken:%Y-%m-%d %H:%M:%S} UTC · {found.hot_pixels} hot pixels · "
        f"position ± {found.position_sd_m:.1f} m, 90 % in {major_m:.1f} × {minor_m:.1f} m"
    )
    set_title(axes, image.name, line)
    axes.set_xlabel(NOTE, fontsize=9)
    with whole_file(path) as part:
        save_map(figure, part)


def _extent(landscape: Landscape, draped: DrapedImage) -> Frame:
    """Return west, east, south and north of an image in km from the landscape's corner."""
    top, left, bottom, right = draped.bounds
    west_km, north_km = km_from_corner(landscape, *landscape.xy_of(top, left))
    east_km, south_km = km_from_corner(landscape, *landscape.xy_of(bottom, right))
    return west_km, east_km, south_km, north_km


def _square(points: Floats) -> Frame:
    """Return a square frame with a margin around points (n, 2) in km."""
    half = (0.5 + MARGIN) * float(np.ptp(points, axis=0).max())
    east, north = (float(each) for each in (points.max(axis=0) + points.min(axis=0)) / 2.0)
    return east - half, east + half, north - half, north + half


def _picture(draped: DrapedImage) -> NDArray[np.uint8]:
    """Return the colours (y, x, 4) of the ground within the bounds of an image."""
    top, left, bottom, right = draped.bounds
    pixel = max(bottom - top, right - left) / SIDE_PX
    rows, cols = round((bottom - top) / pixel), round((right - left) / pixel)
    row, col = np.meshgrid(
        top + (np.arange(rows) + 0.5) * (bottom - top) / rows,
        left + (np.arange(cols) + 0.5) * (right - left) / cols,
        indexing="ij",
    )
    return draped.colours(np.column_stack([row.ravel(), col.ravel()])).reshape(rows, cols, 4)


def _draw_outline(
    axes: Any, landscape: Landscape, corner: tuple[int, int], cells: Mask, colour: str
) -> None:
    """Draw the outline of the cells (y, x) of a window; ``corner`` is its first row and column."""
    from matplotlib.collections import LineCollection

    inside = np.pad(cells, 1)
    above = np.argwhere(inside[1:, 1:-1] != inside[:-1, 1:-1])  # cells whose upper side is drawn
    left = np.argwhere(inside[1:-1, 1:] != inside[1:-1, :-1])
    begins = np.concatenate([above, left])
    along = np.concatenate([np.tile((0, 1), (len(above), 1)), np.tile((1, 0), (len(left), 1))])
    sides = [
        [km_from_corner(landscape, *landscape.xy_of(*(place + corner - 0.5))) for place in side]
        for side in zip(begins, begins + along, strict=True)
    ]
    for line_colour, width in (("white", 4.0), (colour, 2.0)):
        axes.add_collection(
            LineCollection(
                sides, colors=line_colour, linewidths=width, capstyle="projecting", zorder=4
            )
        )


def _draw_ellipse(axes: Any, landscape: Landscape, found: FrameCells) -> None:
    from matplotlib.patches import Ellipse
    from matplotlib.patheffects import withStroke

    ellipse = found.ellipse
    patch = Ellipse(
        km_from_corner(landscape, *landscape.xy_of(*found.centre)),
        2.0 * SIGMAS * ellipse.major_m / 1e3,
        2.0 * SIGMAS * ellipse.minor_m / 1e3,
        angle=90.0 - ellipse.major_from_grid_north_deg,
        fill=False,
        edgecolor=ELLIPSE_COLOUR,
        linewidth=2.0,
        zorder=6,
    )
    patch.set_path_effects([withStroke(linewidth=4.0, foreground="black")])
    axes.add_patch(patch)


def _draw_scale(axes: Any, draped: DrapedImage) -> None:
    """Draw an image's colour scale with its values, below the legend of the map."""
    beside = axes.inset_axes((1.03, 0.04, 0.03, 0.4))
    last = len(draped.scale) - 1
    colours = draped.palette[1:, None, :3]
    beside.imshow(colours, origin="lower", extent=(0.0, 1.0, 0.0, last), aspect="auto")
    beside.set_title("°C" if draped.unit == "°C" else "Grey\nlevel", fontsize=9, loc="left")
    beside.set_xticks([])
    beside.yaxis.tick_right()
    beside.set_yticks(range(last + 1), [f"{value:.0f}" for value, _ in draped.scale], fontsize=9)


def draw_cells(
    axes: Any, landscape: Landscape, corner: tuple[int, int], state: NDArray[np.uint8]
) -> None:
    """Colour the burned and unburned cells of a window; ``corner`` is its first row and column."""
    from matplotlib.colors import to_rgba

    cell_km = landscape.cell_size_m / 1e3
    colours = np.zeros((*state.shape, 4))
    for code, colour in ((BURNED, BURNED_COLOUR), (UNBURNED, UNBURNED_COLOUR)):
        colours[state == code] = to_rgba(colour, ALPHA)
    rows, cols = state.shape
    west_km, south_km = corner[1] * cell_km, (landscape.shape[0] - corner[0] - rows) * cell_km
    extent = (west_km, west_km + cols * cell_km, south_km, south_km + rows * cell_km)
    axes.imshow(colours, extent=extent, origin="upper", interpolation="nearest", zorder=3)


def km_from_corner(landscape: Landscape, x_m: float, y_m: float) -> tuple[float, float]:
    """Return a position in km from the landscape's south-west corner, for the axes."""
    return (x_m - landscape.west_m) / 1e3, (y_m - landscape.south_m) / 1e3
