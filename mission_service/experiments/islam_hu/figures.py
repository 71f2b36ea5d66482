"""Draw the figures of Islam & Hu, section VI, from the flights of this experiment.

The unit of the map axes is one cell.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mission_service.experiments.fires import HOUR_S, Burn
from mission_service.experiments.islam_hu.ideal_flight import Flight, fly
from mission_service.experiments.islam_hu.scenarios import (
    PAPER_REVERSALS,
    changes_s,
    islam_hu_planner,
)
from mission_service.guidance.fire_map import EAST, NORTH

Floats = NDArray[np.float64]

TRACK = "#0b3c8c"
COLOURS = {
    "circling": "#666666",
    "islam_hu": "#7a0177",
    "islam_hu_damped": "#0b3c8c",
    "predictive": "#00796b",
}
OTHER_COLOUR = "#b34700"
BACK, FRONT = "#b34700", "#0b3c8c"
MARGIN_CELLS = 6


def draw(out: Path, burn: Burn, flights: dict[str, Flight], sweep: dict[float, Flight]) -> None:
    """Draw all figures of one fire."""
    stem = f"{burn.name}-{burn.scheme}"
    draw_tracks(out / f"trajectory-{stem}.png", burn, flights)
    if burn.name in PAPER_REVERSALS:  # fig. 11
        named = {f"α = {alpha:g}": flight for alpha, flight in sweep.items()}
        draw_tracks(out / f"alpha-{stem}.png", burn, named)
    draw_errors(out / f"error-{stem}.png", burn, flights)
    draw_importance(out / f"importance-{stem}.png", burn, flights["islam_hu_damped"])


def _new(columns: int, rows: int, size: tuple[float, float]) -> tuple[Figure, list[Any]]:
    figure = Figure(figsize=size, dpi=100, layout="constrained")
    return figure, list(np.ravel(figure.subplots(rows, columns, squeeze=False)))


def draw_tracks(path: Path, burn: Burn, flights: dict[str, Flight]) -> None:
    """Draw the vehicle's tracks on maps of the fire's arrival times (figs. 9 and 11 to 14)."""
    columns = 2 if len(flights) in (2, 4) else 3
    rows = -(-len(flights) // columns)
    figure, panels = _new(columns, rows, (4.0 * columns + 0.8, 4.2 * rows + 0.3))
    for axes in panels[len(flights) :]:
        axes.remove()
    for axes, (label, flight) in zip(panels, flights.items(), strict=False):
        colours = _draw_fire(axes, burn)
        axes.plot(flight.track[:, 2], flight.track[:, 1], color=TRACK, linewidth=0.8)
        axes.plot(
            flight.reversals[:, 2], flight.reversals[:, 1], "o", color="black", markersize=2.5
        )
        axes.plot(burn.ignition[1], burn.ignition[0], "*", color="white", markeredgecolor="black")
        axes.set_title(f"{label}: {len(flight.reversals)} reversals", fontsize=10)
    figure.colorbar(colours, ax=panels[: len(flights)], label="fire arrives (h)", shrink=0.8)
    figure.suptitle(f"{burn.name}, {burn.scheme}, vehicle {burn.speed_m_s:g} m/s")
    figure.savefig(path)


def _draw_fire(axes: Any, burn: Burn) -> Any:
    hours = np.where(burn.burned(burn.end_s), burn.arrival_s / HOUR_S, np.nan)
    colours = axes.imshow(hours, cmap="YlOrRd", vmin=0.0, vmax=burn.end_s / HOUR_S, alpha=0.8)
    fuel = burn.landscape.fuel_model
    edges = np.flatnonzero(fuel[1:, 0] != fuel[:-1, 0])
    for edge in edges:
        axes.axhline(edge + 0.5, color="#1b5e20", linewidth=1.0, linestyle="--")
    _frame(axes, burn.burned(burn.end_s))
    axes.tick_params(labelsize=8)
    return colours


def _frame(axes: Any, burned: NDArray[np.bool_]) -> None:
    """Set the axes to a square around the fire."""
    rows, cols = np.nonzero(burned)
    centre_row, centre_col = (rows.min() + rows.max()) / 2, (cols.min() + cols.max()) / 2
    half = max(np.ptp(rows), np.ptp(cols)) / 2 + MARGIN_CELLS
    axes.set(
        xlim=(centre_col - half, centre_col + half),
        ylim=(centre_row + half, centre_row - half),
        xlabel="column",
        ylabel="row",
    )


def draw_errors(path: Path, burn: Burn, flights: dict[str, Flight]) -> None:
    """Draw fig. 16: the maximum distance error over time, and its running mean (thick line)."""
    figure, (axes,) = _new(1, 1, (8.0, 4.0))
    for planner, flight in flights.items():
        hours, colour = flight.at_s / HOUR_S, COLOURS.get(planner, OTHER_COLOUR)
        label = f"{planner}: mean {flight.max_error.mean():.1f}"
        axes.plot(hours, flight.max_error, color=colour, linewidth=0.8, alpha=0.6)
        so_far = np.cumsum(flight.max_error) / np.arange(1, flight.max_error.size + 1)
        axes.plot(hours, so_far, color=colour, linewidth=2.0, label=label)
    max_error = max(
        flight.max_error.max() for name, flight in flights.items() if name != "islam_hu"
    )
    axes.set(
        xlabel="time since ignition (h)",
        ylabel="maximum distance error (cells)",
        xlim=(burn.deploy_s / HOUR_S, burn.end_s / HOUR_S),
        # The rule ``islam_hu`` may lose track of part of the fire, with an error beyond the plot.
        ylim=(0.0, 1.3 * max_error),
    )
    axes.set_title(f"{burn.name}, {burn.scheme}; thick lines: mean so far", fontsize=10)
    axes.legend(loc="upper left", fontsize=8)
    figure.savefig(path)


def draw_importance(path: Path, burn: Burn, flight: Flight) -> None:
    """Draw fig. 10: the importance of cells behind and ahead at two decisions (damped rule).

    Both decisions are later than ``changes_s``. The left panels show the decision with the lowest
    ratio of the importance behind to the importance ahead. The right panels show the first reversal
    or, without a reversal, the decision with the highest ratio.
    """
    later = flight.windows[flight.windows[:, 0] >= changes_s(burn)]
    share = later[:, 1] / np.maximum(later[:, 2], 1e-9)
    turns_s = flight.reversals[flight.reversals[:, 0] >= later[0, 0], 0]
    turn_s = turns_s[0] if turns_s.size else later[int(np.argmax(share)), 0]
    moments = (float(later[int(np.argmin(share)), 0]), float(turn_s))
    figure, panels = _new(2, 2, (9.0, 7.5))
    planner = islam_hu_planner(burn, "islam_hu_damped")

    def look_at(at_s: float, row: int, col: int) -> None:
        if at_s in moments:
            column = moments.index(at_s)
            importance = planner.importance(row, col, at_s)
            _draw_windows(panels[column], importance, at_s, turning=at_s in turns_s)
            estimated = planner.shape(row, col)
            _draw_estimate(panels[2 + column], burn, estimated, (row, col), planner.clockwise, at_s)

    fly(burn, planner, before=look_at)
    figure.suptitle(f"{burn.name}, {burn.scheme}: importance of the windows, damped rule, α = 1")
    figure.savefig(path)


def _draw_windows(axes: Any, importance: Floats, at_s: float, turning: bool) -> None:
    half = importance.size // 2
    cell = np.arange(importance.size)
    for name, colour, part in (("back", BACK, np.s_[:half]), ("front", FRONT, np.s_[half:])):
        label = f"{name}: {importance[part].sum():.0f}"
        axes.fill_between(cell[part], importance[part], color=colour, alpha=0.7, label=label)
    axes.set(
        xlabel="cell of the estimated front, from the vehicle backwards",
        ylabel="importance (cells of unseen spread)",
        ylim=(0.0, None),
    )
    choice = "turns back" if turning else "keeps its direction"
    axes.set_title(f"{at_s / HOUR_S:.2f} h: {choice}", fontsize=10)
    axes.legend(fontsize=8)


def _draw_estimate(
    axes: Any, burn: Burn, estimated: Floats, at: tuple[int, int], clockwise: bool, at_s: float
) -> None:
    rows, cols = burn.ignition[0] - estimated * NORTH, burn.ignition[1] + estimated * EAST
    axes.contourf(burn.burned(at_s), levels=(0.5, 1.5), colors=("#fdae6b",))
    axes.plot(np.append(cols, cols[0]), np.append(rows, rows[0]), color="black", linewidth=1.0)
    nearest = int(np.argmin(np.hypot(rows - at[0], cols - at[1])))
    ahead = (nearest + (12 if clockwise else -12)) % rows.size
    axes.annotate(
        "",
        xy=(cols[ahead], rows[ahead]),
        xytext=(at[1], at[0]),
        arrowprops={"arrowstyle": "-|>", "color": TRACK, "linewidth": 2.0},
    )
    axes.plot(at[1], at[0], "o", color=TRACK)
    axes.set_aspect("equal")
    _frame(axes, burn.burned(at_s))
    axes.set_title("line: estimated front; orange: the fire; arrow: flying direction", fontsize=8)
