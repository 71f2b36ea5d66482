"""Reports a whole burn: fire fronts at regular times, totals, JSON and a picture."""

import math
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import contourpy
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from mission_service.guidance.burn.lines.hazard import LONG_AGO_S
from mission_service.guidance.burn.lines.ignition_lines import only_areas
from mission_service.guidance.burn.plan_summary import in_feet
from mission_service.guidance.burn.whole_burn import WholeBurn

Floats = NDArray[np.float64]

M2_PER_ACRE, M_PER_CHAIN = 4046.8564224, 20.1168
TIMES = 61  # number of fire fronts in a report
FRONT_CELL_M, FRONT_NODES = 3.0, 20_000
LOAD_COLOURS = ("#0b3c8c", "#7a0177", "#00695c", "#4e342e", "#33691e", "#ad1457")


def slider_times_s(burn: WholeBurn, count: int = TIMES) -> Floats:
    """Return ``count`` evenly spaced times from the start of a burn to its end."""
    return np.linspace(burn.begin_s, max(burn.end_s, burn.begin_s + 1.0), count)


def ignition_raster(burn: WholeBurn, area: BaseGeometry) -> tuple[Floats, Floats, Floats]:
    """Return a raster of ignition times: x (cols,), y (rows,), and times (rows, cols).

    Row 0 is in the south.
    """
    west, south, east, north = area.bounds
    border_m = 0.1 * max(east - west, north - south)
    wide_m, high_m = east - west + 2 * border_m, north - south + 2 * border_m
    cell = max(FRONT_CELL_M, math.sqrt(wide_m * high_m / FRONT_NODES))
    x = west - border_m + cell * np.arange(math.ceil(wide_m / cell) + 1)
    y = south - border_m + cell * np.arange(math.ceil(high_m / cell) + 1)
    nodes = np.stack([np.tile(x, y.size), np.repeat(y, x.size)], axis=1)
    times = np.asarray(burn.fire.ignition_time_s(nodes), np.float64)
    ignition_s: Floats = np.maximum(times, LONG_AGO_S).reshape(y.size, x.size)
    return x.astype(np.float64), y.astype(np.float64), ignition_s


def burned_areas(
    burn: WholeBurn, area: BaseGeometry, times_s: Floats, simplified_m: float = 1.0
) -> list[BaseGeometry]:
    """Return the burned area (polygons with holes) at each time; empty before the first fire."""
    x, y, ignition_s = ignition_raster(burn, area)
    never = float(np.max(times_s)) + 1e6
    lines = contourpy.contour_generator(
        x, y, np.minimum(ignition_s, never), fill_type=contourpy.FillType.OuterOffset
    )
    found = []
    for at_s in times_s.tolist():
        filled: Any = lines.filled(2.0 * LONG_AGO_S, at_s)
        parts = []
        for points, ends in zip(*filled, strict=True):
            outer, *holes = (points[begin:end] for begin, end in pairwise(ends))
            parts.append(shapely.Polygon(outer, holes))
        shape: BaseGeometry = shapely.union_all(parts) if parts else shapely.Polygon()
        found.append(only_areas(shape.simplify(simplified_m)))
    return found


def burn_totals(burn: WholeBurn, area: BaseGeometry) -> dict[str, Any]:
    """Compute the totals of a burn, in metric units and in the units that fire crews use."""
    plans = [line.plan for line in burn.lines]
    steps = [np.diff(plan.path[:, :2], axis=0) for plan in plans]
    flown_m = float(sum(np.hypot(*step.T).sum() for step in steps))
    lines_m = float(sum(np.ptp(plan.line.across(plan.drops[:, :2])) for plan in plans))
    left_m2 = burn.area_left.area if burn.ended.why != "complete" else 0.0
    min_margin_s = min((plan.min_time_margin_s for plan in plans), default=math.inf)
    return {
        "lines": len({round(plan.line.along_m, 3) for plan in plans}),
        "flights": len(plans),
        "loads": burn.loads,
        "spheres": sum(len(plan.drops) for plan in plans),
        "skipped": sum(len(plan.skipped) for plan in plans),
        "duration_s": round(burn.end_s - burn.begin_s, 1),
        "flown_m": round(flown_m, 1),
        "flown_ft": in_feet(flown_m),
        "lines_m": round(lines_m, 1),
        "lines_chains": round(lines_m / M_PER_CHAIN, 1),
        "unit_ha": round(area.area / 1e4, 2),
        "unit_acres": round(area.area / M2_PER_ACRE, 2),
        "left_ha": round(left_m2 / 1e4, 2),
        "left_acres": round(left_m2 / M2_PER_ACRE, 2),
        "min_time_margin_s": round(min_margin_s, 1) if math.isfinite(min_margin_s) else None,
        "ended": burn.ended.words,
    }


def burn_json(burn: WholeBurn, area: BaseGeometry, times_s: Floats | None = None) -> dict[str, Any]:
    """Return a whole burn as JSON, with coordinates in the landscape's metres and mission times."""
    times = slider_times_s(burn) if times_s is None else times_s
    return {
        "totals": burn_totals(burn, area),
        "assumptions": asdict(burn.assumptions),
        "lines": [
            {
                "number": line.number,
                "load": line.load,
                "begin_s": round(line.plan.begin_s, 2),
                "end_s": round(line.end_s, 2),
                "drops": line.plan.drops.round(2).tolist(),
                "skipped": line.plan.skipped.round(2).tolist(),
                "path": line.plan.path.round(2).tolist(),
                "spheres_left": line.plan.spheres_left,
                "ended": line.plan.ended,
            }
            for line in burn.lines
        ],
        "fronts": [
            {"at_s": round(at_s, 1), "burned": shapely.geometry.mapping(front)}
            for at_s, front in zip(times.tolist(), burned_areas(burn, area, times), strict=True)
        ],
    }


def draw_burn(path: Path, burn: WholeBurn, area: BaseGeometry, title: str) -> None:
    """Draw a burn as a PNG, with fire arrival times as shades and one colour per load."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.5, 9.0), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes: Any = figure.add_subplot()
    west, south, _, _ = area.bounds
    x, y, ignition_s = ignition_raster(burn, area)
    outside = ~shapely.contains_xy(
        area, *np.meshgrid(x, y)
    )  # fire does not cross the control lines
    never = outside | (ignition_s > burn.end_s)
    minutes = np.ma.masked_where(never, (ignition_s - burn.begin_s) / 60.0)
    edges = (x[0] - west, x[-1] - west, y[0] - south, y[-1] - south)
    until = max((burn.end_s - burn.begin_s) / 60.0, 1.0)
    shades = axes.imshow(
        minutes, cmap="autumn", extent=edges, origin="lower", alpha=0.7, vmin=0.0, vmax=until
    )
    figure.colorbar(shades, ax=axes, label="fire arrival, minutes after the start", shrink=0.7)
    for ring in shapely.get_rings(shapely.get_parts(area)):
        axes.plot(*(shapely.get_coordinates(ring) - (west, south)).T, color="black")
    for line in burn.lines:
        colour = LOAD_COLOURS[(line.load - 1) % len(LOAD_COLOURS)]
        low = burn.assumptions.safe_height_m - 1e-6
        for one, other in pairwise(line.plan.path - (west, south, 0.0, 0.0)):
            style = ":" if min(one[2], other[2]) >= low else "-"
            x_m, y_m = zip(one[:2], other[:2], strict=True)
            axes.plot(x_m, y_m, color=colour, linewidth=0.7, linestyle=style)
        drops, skipped = line.plan.drops[:, :2] - (west, south), line.plan.skipped - (west, south)
        axes.plot(*drops.T, ".", color=colour, markersize=5)
        axes.plot(*skipped.T, "x", color="black", markersize=4)
        text = axes.annotate(str(line.number), drops[0], xytext=(-4, 4), textcoords="offset points")
        text.set_bbox({"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1})
        text.set_color(colour)
    axes.set_aspect("equal")
    axes.set(xlabel="east (m)", ylabel="north (m)")
    found, assumed = burn_totals(burn, area), burn.assumptions
    axes.set_title(
        f"{title}\n{found['lines']} lines, {found['spheres']} spheres, {found['loads']} loads, "
        f"{found['duration_s'] / 60.0:.0f} min; {found['unit_ha']} ha ({found['unit_acres']} acres)"
        f"\nassumed: spheres ignite after {assumed.ignition_delay_s:g} s, "
        f"{assumed.speed_m_s:g} m/s, wind {assumed.wind_m_s:g} m/s throughout; "
        f"dotted: at {assumed.safe_height_m:g} m",
        parse_math=False,
        fontsize=9,
    )
    figure.savefig(path)
