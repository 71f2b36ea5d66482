"""The pictures of docs/planners.md: ``python -m benchmarks.planner_pictures docs/planners``."""

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mission_service.experiments.ring_flight import TeamFlight, fly_team
from mission_service.experiments.ring_history import RingStep, ring_history
from mission_service.experiments.team_fires import SPEED_M_S, uneven
from mission_service.planners.benchmarks import Bumper, Circling
from mission_service.planners.bent import LATER_PLANNERS, PLANNERS, bent_rule
from mission_service.planners.ring import TeamRule

Floats = NDArray[np.float64]

UAVS = 4
SHOWN_S = 3600.0
COLOURS = ("#0b3c8c", "#7a0177", "#00695c", "#b34700")
TEAM_RULES: dict[str, tuple[str, Callable[[], TeamRule]]] = {
    "team-circling": ("team.circling", Circling),
    "team-bumper": ("team.bumper", Bumper),
    **{
        f"team-{name}": (f"team.{name}", partial(bent_rule, name, "importance", "linear"))
        for name in (*PLANNERS, *LATER_PLANNERS)
    },
}


def bearings_deg(places: NDArray[Any], centre: tuple[int, int]) -> Floats:
    """Bearing from the ignition of places (n, 2) row, column."""
    bearing: Floats = (
        np.rad2deg(np.arctan2(places[:, 1] - centre[1], centre[0] - places[:, 0])) % 360.0
    )
    return bearing


def spread_by_bearing(history: list[RingStep], centre: tuple[int, int]) -> Floats:
    """Spread rate in m/min (360, steps) on each bearing from the ignition."""
    found = np.empty((360, len(history)))
    for number, step in enumerate(history):
        bearing = bearings_deg(step.cells, centre)
        order = np.argsort(bearing)
        found[:, number] = np.interp(
            np.arange(360), bearing[order], step.spread_rate_m_s[order], period=360.0
        )
    return 60.0 * found


def draw_team(
    path: Path, title: str, flight: TeamFlight, history: list[RingStep], centre: tuple[int, int]
) -> None:
    """Where each vehicle is around the fire over its last hour; the background is the spread."""
    figure = Figure(figsize=(9, 3.6), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes: Any = figure.add_subplot()
    shown = [step for step in history if step.at_s >= history[-1].at_s - SHOWN_S]
    from_h, to_h = shown[0].at_s / 3600.0, shown[-1].at_s / 3600.0
    spread = axes.imshow(
        spread_by_bearing(shown, centre),
        extent=(from_h, to_h, 0.0, 360.0),
        origin="lower",
        aspect="auto",
        cmap="YlOrRd",
        vmin=0.0,
        alpha=0.8,
    )
    figure.colorbar(spread, ax=axes, label="spread of the front (m/min)")
    for (seat, track), colour in zip(flight.tracks.items(), COLOURS, strict=False):
        bearing = bearings_deg(track[:, 1:], centre)
        line = np.where(np.abs(np.diff(bearing, append=bearing[-1:])) > 180.0, np.nan, bearing)
        axes.plot(track[:, 0] / 3600.0, line, color=colour, linewidth=1.3, label=f"UAV {seat + 1}")
    axes.set(
        xlim=(from_h, to_h),
        ylim=(0.0, 360.0),
        yticks=range(0, 361, 90),
        xlabel="time since ignition (h)",
        ylabel="bearing from the ignition (°)",
    )
    mean, std = flight.mean_std("linear")
    axes.set_title(f"{title}: mean unseen advance {mean:.1f} m (± {std:.1f} m over time)")
    axes.legend(loc="upper left", ncols=UAVS, fontsize=8)
    figure.savefig(path)


def main() -> None:
    """Draw them all into the folder that is named."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    fire = uneven()
    history = ring_history(fire)
    for name, (title, rule) in TEAM_RULES.items():
        flight = fly_team(history, rule(), UAVS, SPEED_M_S)
        draw_team(folder / f"{name}.png", title, flight, history, fire.ignition)


if __name__ == "__main__":
    main()
