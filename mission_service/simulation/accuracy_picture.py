"""Draws the expected error along the front for different numbers of aircraft."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from firemodel.arrays import Floats
from firemodel.outputs.whole_file import whole_file
from mission_service.simulation.expected_accuracy import Accuracy

COLOURS = "plasma"
MARGIN = 0.06  # around the fronts, as a fraction of their extent
COLOUR_DECADES = 2.0  # range of the colours; smaller errors get the lowest colour
PANEL_IN = 4.2


def draw_accuracy(
    path: Path, found: Sequence[Accuracy], cell_m: float, name: str, minutes: float
) -> None:
    """Draw one panel for each number of aircraft, with the same scales and colours.

    Raises FireModelError if the file cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import LineCollection
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter

    errors_m = np.concatenate([front.error_m for each in found for front in each.fronts])
    largest_m = float(errors_m.max())
    lowest_m = max(float(errors_m.min()), largest_m / 10.0**COLOUR_DECADES)
    colours = ScalarMappable(LogNorm(lowest_m, max(largest_m, 1.01 * lowest_m)), COLOURS)
    columns = math.ceil(math.sqrt(len(found)))
    rows = -(-len(found) // columns)
    figure = Figure(figsize=(PANEL_IN * columns + 0.8, PANEL_IN * rows + 0.9), dpi=110)
    FigureCanvasAgg(figure)
    figure.set_layout_engine("constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    west, east, south, north = _extent_km(found, cell_m)
    for axes, each in zip(panels, found, strict=False):
        for front in each.fronts:
            x_km, y_km = front.col * cell_m / 1e3, -front.row * cell_m / 1e3
            axes.fill(x_km, y_km, color="#ffffff" if front.inner else "#ececec", zorder=1)
            points = np.column_stack([x_km, y_km])
            lines = list(np.stack([points, np.roll(points, -1, axis=0)], axis=1))
            shown = np.maximum(front.error_m, lowest_m)
            axes.add_collection(
                LineCollection(lines, colors=colours.to_rgba(shown), linewidths=3.0)
            )
        count = "no aircraft" if each.aircraft == 0 else f"{each.aircraft} aircraft"
        axes.set_title(f"{count}: mean error {each.error_m:.0f} m", fontsize=11)
        axes.set(xlim=(west, east), ylim=(south, north), aspect="equal")
        axes.set_xlabel("km")
        axes.tick_params(labelleft=False)
    for axes in panels[len(found) :]:
        axes.set_axis_off()
    bar = figure.colorbar(colours, ax=panels.tolist(), shrink=0.8)
    bar.set_label("expected distance from the true front (m)")
    bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    bar.ax.yaxis.set_major_formatter("{x:g}")
    bar.ax.yaxis.set_minor_formatter(NullFormatter())
    figure.suptitle(f"{name}: the estimated front {minutes:g} min after takeoff (grid north is up)")
    with whole_file(path) as part:
        figure.savefig(part, format="png")


def _extent_km(found: Sequence[Accuracy], cell_m: float) -> tuple[float, float, float, float]:
    """Return the west, east, south and north limits of all panels."""

    def limits(values: Floats) -> tuple[float, float]:
        low, high = float(values.min()), float(values.max())
        margin = MARGIN * (high - low) + 2.0 * cell_m / 1e3
        return low - margin, high + margin

    fronts = [front for each in found for front in each.fronts]
    x_km = np.concatenate([front.col for front in fronts]) * cell_m / 1e3
    y_km = -np.concatenate([front.row for front in fronts]) * cell_m / 1e3
    return (*limits(x_km), *limits(y_km))
