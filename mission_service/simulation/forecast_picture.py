"""Draws a forecast from one mapped perimeter to the next, on the base map of all fire maps."""

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from firemodel.assimilation.observation import BURNED
from firemodel.assimilation.scores import overlap
from firemodel.landscape.landscape import Landscape
from firemodel.outputs.arrival_map import (
    frame_around,
    save_map,
    set_title,
    start_map,
    time_in_words,
)
from firemodel.outputs.whole_file import whole_file

if TYPE_CHECKING:
    from mission_service.simulation.fire_assimilation import Step

BANDS = (0.1, 0.5, 0.9, 1.01)
SHADES = ("#fdd49e", "#fc8d59", "#b30000")
BEFORE, AFTER, FREE = "#404040", "#08306b", "#7a0177"


def draw_forecast(
    path: Path, landscape: Landscape, step: "Step", name: str, time_zero: datetime | None
) -> None:
    """Draw a forecast's probability bands, both perimeters, and the area burned in the model alone.

    Raises FireModelError if the file cannot be written.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    after_s = step.after.at_s
    probability = step.probability
    before, after = step.before.state == BURNED, step.after.state == BURNED
    shown = before | after | step.free | (probability > BANDS[0])
    frame = frame_around(landscape, np.where(shown, 0.0, np.inf))
    figure, axes = start_map(landscape, np.full(landscape.shape, np.inf), frame)
    extent = _extent(landscape)
    limits = axes.axis()
    axes.contourf(
        probability[::-1], levels=BANDS, colors=SHADES, alpha=0.75, extent=extent, zorder=3
    )
    for area, colour, style in (
        (before, BEFORE, "solid"),
        (after, AFTER, "solid"),
        (step.free, FREE, "dotted"),
    ):
        axes.contour(
            area[::-1].astype(float),
            levels=[0.5],
            colors=colour,
            linestyles=style,
            linewidths=1.8,
            extent=extent,
            zorder=4,
        )
    axes.axis(limits)
    legend: list[Any] = [
        Patch(color=colour, alpha=0.75, label=label)
        for colour, label in zip(SHADES, ("10 to 50 %", "50 to 90 %", "over 90 %"), strict=True)
    ]
    legend += [
        Line2D([], [], color=BEFORE, label="last perimeter"),
        Line2D([], [], color=AFTER, label="observed later"),
        Line2D([], [], color=FREE, linestyle="dotted", label="model alone"),
    ]
    shown_legend = axes.legend(handles=legend, loc="upper left", title="Burned, probability")
    shown_legend.set_zorder(6)
    minutes = (after_s - step.before.at_s) / 60.0
    scores = (
        f"IoU: estimate {overlap(step.likely, after):.2f}, model alone "
        f"{overlap(step.free, after):.2f}, persistence {overlap(before, after):.2f}"
    )
    set_title(
        axes,
        f"{name}: forecast for {minutes:.0f} min",
        f"{time_in_words(after_s, time_zero)} · {scores}",
    )
    with whole_file(path) as part:
        save_map(figure, part)


def _extent(landscape: Landscape) -> tuple[float, float, float, float]:
    """Return the west, east, south and north limits of the cell centres in km."""
    rows, cols = landscape.shape
    cell_km = landscape.cell_size_m / 1e3
    return 0.5 * cell_km, (cols - 0.5) * cell_km, 0.5 * cell_km, (rows - 0.5) * cell_km
