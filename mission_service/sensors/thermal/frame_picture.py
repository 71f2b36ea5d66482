"""Draws the cells that a thermal image shows on the map, with the error ellipse of their place."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import window_at
from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN
from firemodel.landscape.landscape import Landscape
from firemodel.outputs.arrival_map import frame_around, save_map, set_title, start_map
from firemodel.outputs.whole_file import whole_file
from mission_service.fire.observed_window import states_in
from mission_service.sensors.thermal.frame_cells import FrameCells
from mission_service.sensors.thermal.thermal_image import ThermalImage

BURNED_COLOUR, UNBURNED_COLOUR, CAMERA_COLOUR = "#e31a1c", "#1f78ff", "#000000"
NOTE = "Observed by a thermal camera. Not for navigation. Graticule WGS 84, arrow to true north."
ALPHA = 0.7
SIGMAS = 2.146  # the ellipse that contains the true place with a probability of 90 %


def draw_frame(path: Path, landscape: Landscape, image: ThermalImage, found: FrameCells) -> None:
    """Draw the observed cells, the ellipse of 90 % and the camera's position.

    Raises OSError if the file cannot be written.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Ellipse, Patch

    window = found.window
    state = states_in(window.cells)
    shown = np.full(landscape.shape, np.inf)
    shown[window_at(window.row, window.col, state.shape)] = np.where(state == UNSEEN, np.inf, 0.0)
    camera_m = np.array([landscape.xy_of_lat_lon(image.lat_deg, image.lon_deg)])
    frame = frame_around(landscape, shown, camera_m)
    figure, axes = start_map(landscape, np.full(landscape.shape, np.inf), frame)
    limits = axes.axis()
    draw_cells(axes, landscape, (window.row, window.col), state)
    ellipse = found.ellipse
    axes.add_patch(
        Ellipse(
            km_from_corner(landscape, *landscape.xy_of(*found.centre)),
            2.0 * SIGMAS * ellipse.major_m / 1e3,
            2.0 * SIGMAS * ellipse.minor_m / 1e3,
            angle=90.0 - ellipse.major_from_grid_north_deg,
            fill=False,
            edgecolor=CAMERA_COLOUR,
            linewidth=2.0,
            zorder=6,
        )
    )
    axes.plot(
        *km_from_corner(landscape, *camera_m[0]),
        marker="^",
        color=CAMERA_COLOUR,
        markersize=9,
        zorder=6,
    )
    axes.axis(limits)
    axes.legend(
        handles=[
            Patch(color=BURNED_COLOUR, alpha=ALPHA, label="burned"),
            Patch(color=UNBURNED_COLOUR, alpha=ALPHA, label="unburned"),
            Line2D([], [], color="black", label="error of the place, 90 %"),
            Line2D([], [], color=CAMERA_COLOUR, marker="^", linestyle="", label="camera"),
        ],
        loc="upper left",
        title="Observed",
    ).set_zorder(7)
    line = (
        f"{image.taken:%Y-%m-%d %H:%M:%S} UTC · {found.hot_pixels} hot pixels · "
        f"position ± {found.position_sd_m:.1f} m"
    )
    set_title(axes, image.name, line)
    axes.set_xlabel(NOTE, fontsize=9)
    with whole_file(path) as part:
        save_map(figure, part)


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
    """Return a place in km from the landscape's south-west corner, for the axes."""
    south_m = landscape.north_m - landscape.shape[0] * landscape.cell_size_m
    return (x_m - landscape.west_m) / 1e3, (y_m - south_m) / 1e3
