"""Draw figures 6 to 12 of the "Virtual agents" paper from the flights of this experiment."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from mission_service.experiments.virtual_agents.ideal_world import Flight
from mission_service.experiments.virtual_agents.scenarios import CELL_M, COLS, EXPERIMENTS, ROWS

COLOURS = ("#0b3c8c", "#b34700", "#7a0177", "#00796b", "#8c6d00", "#666666", "#c2185b", "#2e7d32")
BURNED, BURNING = "#4d4d4d", "#e05a2b"
HALFWAY_S = 500.0
SERIES = {
    "va_coverage": ("fig8-va-coverage", "virtual-agent coverage", True),
    "uav_coverage": ("fig9-uav-coverage", "UAV coverage in the last 60 s", True),
    "efficiency": ("fig10-coverage-efficiency", "UAV coverage efficiency", True),
    "inaccuracy": ("fig11-inaccuracy", "cells wrong in a UAV's fire map", False),
}

Flights = dict[str, list[Flight]]  # flights by experiment, one per seed


def draw(out: Path, flights: Flights) -> None:
    """Draw all figures as PNG."""
    draw_agents(out / "fig6-virtual-agents.png", flights["Exp3"][0])
    draw_uav(out / "fig7-uav-0.png", flights["Exp3"][0])
    for name, (stem, label, share) in SERIES.items():
        draw_series(out / f"{stem}.png", flights, name, label, share)
    draw_safety(out / "fig12-safety.png", flights)


def _figure(size: tuple[float, float], columns: int = 1) -> tuple[Figure, list[Any]]:
    figure = Figure(figsize=size, dpi=100, layout="constrained")
    return figure, list(np.ravel(figure.subplots(1, columns, squeeze=False)))


def _extent_m() -> tuple[float, float, float, float]:
    half_x, half_y = COLS * CELL_M / 2.0, ROWS * CELL_M / 2.0
    return -half_x, half_x, -half_y, half_y


def _draw_fire(axes: Any, flight: Flight, before_s: float, until_s: float) -> None:
    shown = np.where(flight.arrival_s <= before_s, 1, np.where(flight.arrival_s <= until_s, 2, 0))
    axes.imshow(
        np.ma.masked_equal(shown, 0),
        cmap=ListedColormap([BURNED, BURNING]),
        vmin=1,
        vmax=2,
        extent=_extent_m(),
        interpolation="nearest",
    )
    axes.set(aspect="equal", xlabel="east of the ignition (m)")


def _zoom(axes: Any, tracks: Any) -> None:
    low, high = np.nanmin(tracks, axis=(0, 1)) - 200.0, np.nanmax(tracks, axis=(0, 1)) + 200.0
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))


def draw_agents(path: Path, flight: Flight) -> None:
    """Draw fig. 6: the tracks of the virtual agents before and after 500 s."""
    figure, panels = _figure((11.0, 5.2), 2)
    ends = ((0.0, HALFWAY_S), (HALFWAY_S, flight.track_s[-1]))
    for axes, (from_s, until_s) in zip(panels, ends, strict=True):
        chosen = (flight.track_s >= from_s) & (flight.track_s <= until_s)
        _draw_fire(axes, flight, from_s, until_s)
        for k in range(flight.agents_m.shape[1]):
            x, y = flight.agents_m[chosen, k].T
            colour = COLOURS[k % len(COLOURS)]
            axes.plot(x, y, color=colour, linewidth=1.0, label=f"virtual agent {k}")
            axes.plot(x[-1], y[-1], "o", color=colour, markersize=6)
        _zoom(axes, flight.agents_m[chosen])
        axes.set_title(f"{from_s:.0f} to {until_s:.0f} s")
    panels[0].set_ylabel("north of the ignition (m)")
    panels[0].legend(loc="lower right", fontsize=8)
    figure.savefig(path)


def draw_uav(path: Path, flight: Flight) -> None:
    """Draw fig. 7: UAV 0 and its virtual agent in the first 500 s."""
    figure, (axes,) = _figure((6.4, 6.0))
    chosen = flight.track_s <= HALFWAY_S
    _draw_fire(axes, flight, HALFWAY_S, HALFWAY_S)
    axes.plot(*flight.uavs_m[chosen, 0].T, color=COLOURS[0], linewidth=0.8, label="UAV 0")
    axes.plot(*flight.agents_m[chosen, 0].T, color=COLOURS[1], linewidth=1.2, label="its agent")
    _zoom(axes, flight.uavs_m[chosen])
    axes.set_ylabel("north of the ignition (m)")
    axes.legend(loc="best")
    figure.savefig(path)


def draw_series(path: Path, flights: Flights, name: str, label: str, share: bool) -> None:
    """Draw one of figs. 8 to 11: a metric over time, averaged over seeds, for each experiment."""
    figure, (axes,) = _figure((8.4, 4.4))
    for k, (experiment, runs) in enumerate(flights.items()):
        mean = np.mean([run.series[name] for run in runs], axis=0)
        style = "--" if experiment in ("Exp4", "Exp5") else "-"
        axes.plot(
            runs[0].series_s,
            100.0 * mean if share else mean,
            style,
            color=COLOURS[k % len(COLOURS)],
            linewidth=1.4,
            label=experiment,
        )
    axes.set(xlabel="time (s)", ylabel=f"{label} (%)" if share else label, xlim=(0, None))
    axes.set_ylim((0.0, 102.0) if share else (0.0, None))
    axes.grid(alpha=0.3)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path)


def draw_safety(path: Path, flights: Flights) -> None:
    """Draw fig. 12: the numbers of conflicts and collisions, averaged over the seeds."""
    figure, (axes,) = _figure((8.4, 4.0))
    names = [experiment.name for experiment in EXPERIMENTS if experiment.name in flights]
    places = np.arange(len(names))
    for shift, count, colour in ((-0.2, "conflicts", COLOURS[0]), (0.2, "collisions", COLOURS[1])):
        means = [np.mean([run.series[count][-1] for run in flights[name]]) for name in names]
        bars = axes.bar(places + shift, means, 0.4, color=colour, label=count)
        axes.bar_label(bars, fmt="{:.4g}", fontsize=8)
    axes.set_xticks(places, names)
    axes.set_ylabel("number per flight, mean of the seeds")
    axes.legend()
    figure.savefig(path)
