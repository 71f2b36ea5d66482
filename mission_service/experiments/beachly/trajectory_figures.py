"""Draw pictures like Beachly's figures 6 and 7, with fire, burn unit, path and drops."""

from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from mission_service.experiments.beachly.trajectories import LOW_SHARE, Flown

Floats = NDArray[np.float64]

LINE_COLOURS = ("#0b3c8c", "#7a0177", "#00796b", "#8c6d00", "#c2185b", "#2e7d32")
BURNED, LATER = "#4d4d4d", "#e8a27c"
AROUND_M = 45.0
GRID_M = 2.0


def draw_trajectory(path: Path, flown: Flown) -> None:
    """Draw the burned areas at the first drop and at the end, the path and the drops."""
    figure = Figure(figsize=(8.0, 7.6), dpi=110, layout="constrained")
    axes = figure.subplots()
    west, south, east, north = flown.area.bounds
    origin = np.array([west, south])
    x = np.arange(west - AROUND_M, east + AROUND_M, GRID_M)
    y = np.arange(south - AROUND_M, north + AROUND_M, GRID_M)
    grid_x, grid_y = np.meshgrid(x, y)
    points = np.column_stack([grid_x.ravel(), grid_y.ravel()])
    last = flown.samples[-1]
    arrival = last.fire.ignition_time_s(points).reshape(grid_x.shape)
    first_s = flown.spheres[0].at_us / 1e6 if flown.spheres else last.at_s
    # Control lines hold the fire in the unit.
    inside = shapely.contains_xy(flown.area, grid_x, grid_y)
    arrival = np.where(np.isfinite(arrival) & inside, arrival, 1e9)
    for until_s, colour in ((last.at_s, LATER), (first_s, BURNED)):
        axes.contourf(
            x - west, y - south, arrival, levels=[-1e9, until_s], colors=[colour], alpha=0.75
        )
    outline = np.array(flown.area.exterior.coords) - origin
    axes.plot(*outline.T, color="black", linewidth=1.5)
    _draw_path(axes, flown, origin)
    _draw_drops(axes, flown, origin)
    axes.set_aspect("equal")
    axes.set_xlabel("m east")
    axes.set_ylabel("m north")
    axes.set_title(
        f"Scenario {flown.scenario}: {len(flown.spheres)} drops on {len(flown.lit_lines)} lines"
    )
    _legend(axes, flown, first_s, last.at_s)
    figure.savefig(path)


def _draw_path(axes: Any, flown: Flown, origin: Floats) -> None:
    """Draw the path, solid at low height and dashed above (climb and safe height)."""
    track = np.array([(each.x_m, each.y_m) for each in flown.samples]) - origin
    safe_m = flown.lit_lines[0].safe_height_m if flown.lit_lines else 60.0
    low = np.array([each.height_m < LOW_SHARE * safe_m for each in flown.samples])
    for style, chosen in (("-", low), ("--", ~low)):
        line = np.where(chosen[:, None] | np.roll(chosen, 1)[:, None], track, np.nan)
        axes.plot(*line.T, style, color="#333333", linewidth=1.0)


def _draw_drops(axes: Any, flown: Flown, origin: Floats) -> None:
    for number, plan in enumerate(flown.lit_lines):
        colour = LINE_COLOURS[number % len(LINE_COLOURS)]
        fallen = np.array(
            [s.falls_m for s in flown.spheres if flown.plans.get(s.plan_hash) is plan]
        ).reshape(-1, 2)
        axes.plot(*(fallen - origin).T, "o", color=colour, markersize=5)
        first = fallen[0] - origin
        axes.annotate(
            str(number + 1),
            first,
            xytext=(0, 9),
            textcoords="offset points",
            ha="center",
            color=colour,
            weight="bold",
        )
        if plan.skipped:
            lat, lon = np.array(plan.skipped).T
            skipped = np.column_stack(flown.landscape.xy_of_lat_lon(lat, lon)) - origin
            axes.plot(*skipped.T, "x", color=colour, markersize=5)


def _legend(axes: Any, flown: Flown, first_s: float, last_s: float) -> None:
    safe_m = flown.lit_lines[0].safe_height_m if flown.lit_lines else 60.0
    low_m = flown.lit_lines[0].drop_height_m if flown.lit_lines else 15.0
    axes.legend(
        handles=[
            Patch(color=BURNED, label=f"burned at the first drop ({first_s / 60:.0f} min)"),
            Patch(color=LATER, label=f"burned at the end ({last_s / 60:.0f} min)"),
            Line2D([], [], color="#333333", label=f"flown at {low_m:g} m"),
            Line2D([], [], color="#333333", linestyle="--", label=f"up to {safe_m:g} m"),
            Line2D([], [], color=LINE_COLOURS[0], marker="o", linestyle="", label="drops, by line"),
            Line2D([], [], color=LINE_COLOURS[0], marker="x", linestyle="", label="skipped"),
        ],
        loc="upper center",
        ncols=3,
        bbox_to_anchor=(0.5, -0.08),
        fontsize=8,
    )
