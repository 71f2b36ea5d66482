"""Pictures of docs/planners.md: ``python -m benchmarks.planner_pictures docs/planners``."""

import sys
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from firemodel.arrays import Floats
from mission_service.experiments.bent.ring_flight import fly_team
from mission_service.experiments.bent.ring_history import RingStep, ring_history
from mission_service.experiments.bent.scenarios import SPEED_M_S, uneven
from mission_service.experiments.islam_hu.ideal_flight import Flight, fly
from mission_service.experiments.islam_hu.predictive_flight import fly_predictive
from mission_service.experiments.islam_hu.scenarios import islam_hu_burn, islam_hu_planner
from mission_service.guidance.front.islam_hu_planner import Rule
from mission_service.guidance.team.balanced import Balanced
from mission_service.guidance.team.baselines import Bumper, Circling
from mission_service.guidance.team.bent_rules import LATER_PLANNERS, PLANNERS, bent_rule
from mission_service.guidance.team.front_ring import TeamRule

UAVS = 4
SHOWN_S = 3600.0
COLOURS = ("#0b3c8c", "#7a0177", "#00695c", "#b34700")
ALONE_RULES: tuple[Rule, ...] = ("circling", "islam_hu", "islam_hu_damped")
TEAM_RULES: dict[str, Callable[[], TeamRule]] = {
    "team.balanced": Balanced,
    "team.circling": Circling,
    "team.bumper": Bumper,
    **{
        f"team.{name}": partial(bent_rule, name, "importance", "linear")
        for name in (*PLANNERS, *LATER_PLANNERS)
    },
}


def bearings_deg(places: NDArray[Any], centre: tuple[int, int]) -> Floats:
    """Return the bearings of places (n, 2) row, column from the ignition."""
    bearing: Floats = (
        np.rad2deg(np.arctan2(places[:, 1] - centre[1], centre[0] - places[:, 0])) % 360.0
    )
    return bearing


def spread_by_bearing(history: list[RingStep], centre: tuple[int, int]) -> Floats:
    """Return the spread rate in m/min, (360, steps), on each bearing from the ignition."""
    found = np.empty((360, len(history)))
    for number, step in enumerate(history):
        bearing = bearings_deg(step.cells, centre)
        order = np.argsort(bearing)
        found[:, number] = np.interp(
            np.arange(360), bearing[order], step.spread_rate_m_s[order], period=360.0
        )
    return 60.0 * found


def draw(
    path: Path,
    title: str,
    tracks: Mapping[str, Floats],
    history: list[RingStep],
    centre: tuple[int, int],
) -> None:
    """Draw the bearing of each vehicle over time, with the spread rate as the background.

    The tracks, by vehicle name, have the columns time in s, row, column.
    """
    figure = Figure(figsize=(9, 3.6), dpi=80, layout="constrained")
    FigureCanvasAgg(figure)
    axes: Any = figure.add_subplot()
    from_h, to_h = history[0].at_s / 3600.0, history[-1].at_s / 3600.0
    spread = axes.imshow(
        spread_by_bearing(history, centre),
        extent=(from_h, to_h, 0.0, 360.0),
        origin="lower",
        aspect="auto",
        cmap="YlOrRd",
        vmin=0.0,
        alpha=0.8,
    )
    figure.colorbar(spread, ax=axes, label="spread of the front (m/min)")
    for (name, track), colour in zip(tracks.items(), COLOURS, strict=False):
        bearing = bearings_deg(track[:, 1:], centre)
        line = np.where(np.abs(np.diff(bearing, append=bearing[-1:])) > 180.0, np.nan, bearing)
        axes.plot(track[:, 0] / 3600.0, line, color=colour, linewidth=1.3, label=name)
    axes.set(
        xlim=(from_h, to_h),
        ylim=(0.0, 360.0),
        yticks=range(0, 361, 90),
        xlabel="time since ignition (h)",
        ylabel="bearing from the ignition (°)",
    )
    axes.set_title(title, fontsize=11)
    axes.legend(loc="upper left", ncols=len(tracks), fontsize=8)
    figure.savefig(path, pil_kwargs={"optimize": True})


def draw_teams(folder: Path) -> None:
    """Draw the last hour of four vehicles at the uneven fire, for each team rule."""
    fire = uneven()
    history = ring_history(fire)
    shown = [step for step in history if step.at_s >= fire.end_s - SHOWN_S]
    for name, rule in TEAM_RULES.items():
        flight = fly_team(history, rule(), UAVS, SPEED_M_S)
        mean, std = flight.mean_std("linear")
        title = f"{name}: mean unseen advance {mean:.1f} m (± {std:.1f} m over time)"
        tracks = {f"UAV {member + 1}": track for member, track in flight.tracks.items()}
        draw(folder / f"{name.replace('.', '-')}.png", title, tracks, shown, fire.ignition)


def draw_alone(folder: Path) -> None:
    """Draw five hours of one vehicle at the paper's first fire, for each rule."""
    fire = islam_hu_burn("slow-then-fast", "devs8")
    history = ring_history(fire, every_s=120.0)
    flights: dict[str, Flight] = {
        rule: fly(fire, islam_hu_planner(fire, rule)) for rule in ALONE_RULES
    }
    flights["predictive"] = fly_predictive(fire)
    for name, flight in flights.items():
        error = f"distance error {flight.max_error.mean():.1f} cells at worst, mean over time"
        title = f"{name}: {len(flight.reversals)} reversals, {error}"
        draw(folder / f"{name}.png", title, {"UAS": flight.track}, history, fire.ignition)


def main() -> None:
    """Draw all pictures into the given folder."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    draw_alone(folder)
    draw_teams(folder)


if __name__ == "__main__":
    main()
