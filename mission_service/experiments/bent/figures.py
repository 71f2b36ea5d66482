"""Draw figures 5.1 to 5.3 of Bent's thesis from the runs of this experiment."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mission_service.experiments.bent.scenarios import Run
from mission_service.experiments.bent.tables import averages, name_of

HOUR_S = 3600.0
BENCHMARK_COLOUR, IMPORTANCE_COLOUR, CENTRE_COLOUR = "0.55", "tab:blue", "tab:orange"
UNIT = {"linear": "m", "exponential": "s$^{1 + \\mathrm{ROS}}$"}


def draw(out: Path, runs: Sequence[Run], single: Sequence[Run], every_s: float) -> None:
    """Draw all three figures as PNG; ``single`` are the runs with one vehicle for figure 5.3."""
    draw_combinations(out / "bent_5_1.png", "5.1", runs, "linear")
    draw_combinations(out / "bent_5_2.png", "5.2", runs, "exponential")
    combination = ("back-and-forth", "importance", "linear")
    shown = [run for run in [*single, *runs] if run.case[:3] == combination]
    draw_team_sizes(out / "bent_5_3.png", sorted(shown, key=lambda run: run.case.uavs), every_s)


def draw_combinations(path: Path, number: str, runs: Sequence[Run], importance: str) -> None:
    """Draw figure 5.1 or 5.2: the mean cost of each combination over all team sizes."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    costs = averages([run.as_row() for run in runs], importance)
    colour_of = {}
    for run in runs:
        negotiated = CENTRE_COLOUR if run.case.negotiation == "centre" else IMPORTANCE_COLOUR
        colour = negotiated if run.case.negotiation else BENCHMARK_COLOUR
        colour_of[name_of(run.case.planner, run.case.negotiation)] = colour
    names = sorted(costs, key=lambda name: costs[name][0], reverse=True)
    figure = Figure(figsize=(9.0, 5.0), dpi=120, layout="constrained")
    axes = figure.subplots()
    at = np.arange(len(names))
    mean, std = np.array([costs[name] for name in names]).T
    axes.barh(at, mean, xerr=std, color=[colour_of[name] for name in names], capsize=3)
    digits = 1 if importance == "linear" else 0
    for place in range(len(names)):
        text = f"{mean[place]:,.{digits}f} ± {std[place]:,.{digits}f}"
        axes.text(1.01, place, text, va="center", transform=axes.get_yaxis_transform())
    axes.set_yticks(at, names)
    axes.set_xlim(0.0)
    axes.set_xlabel(f"cost, {importance} importance ({UNIT[importance]}): mean ± std over time")
    axes.set_title(f"Bent, figure {number}: combinations, averaged over 2 to 6 vehicles")
    kinds = (
        (BENCHMARK_COLOUR, "benchmark"),
        (IMPORTANCE_COLOUR, "negotiation on importance"),
        (CENTRE_COLOUR, "on centre of importance"),
    )
    handles = [Patch(color=colour, label=label) for colour, label in kinds]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    figure.savefig(path)


def draw_team_sizes(path: Path, runs: Sequence[Run], every_s: float) -> None:
    """Draw figure 5.3: the cost over time for teams of different sizes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 5.0), dpi=120, layout="constrained")
    over_time, by_size = figure.subplots(1, 2, width_ratios=(3, 1))
    for run in runs:
        hours = np.arange(run.cost.size) * every_s / HOUR_S
        label = f"{run.case.uavs}: {run.mean:.1f} ± {run.std:.1f}"
        over_time.plot(hours, run.cost, linewidth=1.0, label=label)
    over_time.set_xlabel("hours since deployment")
    over_time.set_ylabel("cost, linear importance (m)")
    over_time.set_xlim(0.0)
    over_time.set_ylim(0.0)
    over_time.legend(title="vehicles: mean ± std", loc="upper left")
    sizes = [run.case.uavs for run in runs]
    means, stds = [run.mean for run in runs], [run.std for run in runs]
    by_size.errorbar(sizes, means, stds, marker="o", capsize=4)
    by_size.set_xticks(sizes)
    by_size.set_ylim(0.0)
    by_size.set_xlabel("vehicles")
    by_size.set_title("mean ± std")
    figure.suptitle("Bent, figure 5.3: back and forth, negotiation on importance")
    figure.savefig(path)
