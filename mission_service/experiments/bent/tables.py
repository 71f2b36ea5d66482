"""Write tables 5.1 to 5.4 of Bent's thesis, with the thesis's and this program's results."""

from collections.abc import Sequence
from typing import Any

from mission_service.experiments.bent.scenarios import SIZES

PLANNER_NAMES = {
    "circling": "Circling",
    "bumper": "Bumper",
    "back-and-forth": "Back and Forth",
    "highest-dynamic": "High Target Dynamic",
    "highest-static": "High Target Static",
    "predictive": "Predictive",
    "predictive-kept": "Predictive Kept",
}
# Negotiation on importance has an empty name, because the thesis omits this name.
NEGOTIATION_NAMES = {None: "", "importance": "", "centre": " - COI", "arrival": " - First There"}
# Tables 5.1 and 5.2: the combinations with the lowest cost and with the lowest standard deviation,
# for each number of vehicles, and for the average.
THESIS_BEST = {
    "linear": (
        ("Circling", "Circling"),
        ("Bumper", "High Target Static - COI"),
        ("High Target Static - COI", "Back and Forth"),
        ("Back and Forth - COI", "High Target Dynamic"),
        ("High Target Static", "Predictive"),
        ("Back and Forth", "Back and Forth"),
    ),
    "exponential": (
        ("Circling", "Circling"),
        ("Bumper", "Bumper"),
        ("High Target Dynamic", "High Target Dynamic - COI"),
        ("Predictive", "High Target Static - COI"),
        ("High Target Static", "High Target Static"),
        ("High Target Dynamic", "High Target Dynamic - COI"),
    ),
}
# Tables 5.3 and 5.4: average cost, average standard deviation.
THESIS_NEGOTIATIONS = {
    "linear": {"importance": (64.397, 25.085), "centre": (65.816, 24.733)},
    "exponential": {"importance": (3371.688, 2697.640), "centre": (3037.289, 2246.203)},
}

SPREADS = {
    "outward": "rates of spread along the normal of the front",
    "maximum": "maximum rates of spread",
}

Row = dict[str, Any]
Averages = dict[str, tuple[float, float]]  # name: mean and standard deviation of the cost


def name_of(planner: str, negotiation: str | None) -> str:
    """Return the name of a combination in the thesis."""
    return PLANNER_NAMES[planner] + NEGOTIATION_NAMES[negotiation]


def averages(runs: Sequence[Row], importance: str, sizes: Sequence[int] = SIZES) -> Averages:
    """Return the mean cost of each combination over the given numbers of vehicles."""
    found: dict[str, list[tuple[float, float]]] = {}
    for run in runs:
        if run["importance"] == importance and run["uavs"] in sizes:
            name = name_of(run["planner"], run["negotiation"])
            found.setdefault(name, []).append((run["mean_cost"], run["std_cost"]))
    return {
        name: (sum(mean for mean, _ in each) / len(each), sum(std for _, std in each) / len(each))
        for name, each in found.items()
    }


def best(costs: Averages, which: int) -> str:
    """Return the combination with the lowest mean cost (0) or standard deviation (1)."""
    return min(costs, key=lambda name: costs[name][which])


def agreement(runs: Sequence[Row]) -> tuple[int, int, float, float]:
    """Compare the best combinations with those of the thesis, in all cells of tables 5.1 and 5.2.

    Returns the number of cells with the same combination, the number of all cells, the number of
    equal combinations expected from random choices, and the mean fraction by which the thesis's
    combination is worse here.
    """
    same, shares, chance = 0, [], 0.0
    for importance, rows in THESIS_BEST.items():
        groups = [[size] for size in SIZES] + [list(SIZES)]
        for sizes, thesis in zip(groups, rows, strict=True):
            costs = averages(runs, importance, sizes)
            for which in (0, 1):
                ours = best(costs, which)
                same += ours == thesis[which]
                shares.append(costs[thesis[which]][which] / costs[ours][which] - 1.0)
                chance += 1.0 / len(costs)
    return same, len(shares), chance, sum(shares) / len(shares)


def in_text(found: dict[str, Any]) -> str:
    """Return the result as tables of text."""
    from_km, to_km = found["perimeter_km"]
    lines = [
        f"Fire {found['fire']!r}: {found['hours']:g} h, perimeter {from_km:.1f} to {to_km:.1f} km, "
        f"vehicles at {found['speed_m_s']:g} m/s.",
        f"Cost: mean importance of the cells, every 20 s; {SPREADS[found['spread']]} in m/s.",
    ]
    runs, later = found["runs"], found["later"]
    for table, importance in (("5.1", "linear"), ("5.2", "exponential")):
        lines += ["", f"Table {table}: best combinations, {importance} importance"]
        lines += _best_lines(runs, importance)
    same, cells, chance, worse = agreement(runs)
    lines += [
        "",
        f"Same best combination as in the thesis: {same} of {cells} cells (by chance "
        f"{chance:.1f}); the thesis's combination is on average {100.0 * worse:.1f} % worse here "
        "than the best one.",
    ]
    for table, importance in (("5.3", "linear"), ("5.4", "exponential")):
        lines += ["", f"Table {table}: negotiations, {importance} importance, averages"]
        lines += _negotiation_lines(runs, later, importance)
    for importance in ("linear", "exponential"):
        lines += ["", f"All combinations, {importance} importance: mean ± standard deviation"]
        lines += _all_lines([*runs, *later], importance)
    closest_m = min(run["min_separation_m"] for run in [*runs, *later])
    return "\n".join([*lines, "", f"Minimum distance of two vehicles: {closest_m:.1f} m"])


def _best_lines(runs: Sequence[Row], importance: str) -> list[str]:
    lines = [_row("UAVs", "lowest cost", "thesis", "lowest stdev", "thesis")]
    groups = [(str(size), [size]) for size in SIZES] + [("Average", list(SIZES))]
    for (label, sizes), thesis in zip(groups, THESIS_BEST[importance], strict=True):
        costs = averages(runs, importance, sizes)
        cells = []
        for which in (0, 1):
            name = best(costs, which)
            cells += [f"{name} {costs[name][which]:.2f}", thesis[which]]
        lines.append(_row(label, *cells))
    return lines


def _row(label: str, *cells: str) -> str:
    return f"{label:8}" + "".join(f"{cell:34}" for cell in cells).rstrip()


def _negotiation_lines(runs: Sequence[Row], later: Sequence[Row], importance: str) -> list[str]:
    lines = [f"{'':24}{'cost':>10}{'thesis':>10}{'stdev':>10}{'thesis':>10}"]
    for negotiation, label in (
        ("importance", "Importance"),
        ("centre", "Center of Importance"),
        ("arrival", "First There (idea)"),
    ):
        chosen = [run for run in [*runs, *later] if run["negotiation"] == negotiation]
        costs = averages([run for run in chosen if run["planner"] != "predictive-kept"], importance)
        thesis = THESIS_NEGOTIATIONS[importance].get(negotiation)
        line = f"{label:24}"
        for which in (0, 1):
            mean = sum(cost[which] for cost in costs.values()) / len(costs)
            line += f"{mean:10.3f}" + (f"{thesis[which]:10.3f}" if thesis else f"{'':10}")
        lines.append(line.rstrip())
    return lines


def _all_lines(runs: Sequence[Row], importance: str) -> list[str]:
    lines = [f"{'':36}" + "".join(f"{f'{size} UAVs':>18}" for size in SIZES)]
    by_size = [averages(runs, importance, [size]) for size in SIZES]
    for name in by_size[0]:
        cells = "".join(
            f"{f'{costs[name][0]:.2f} ± {costs[name][1]:.2f}':>18}" for costs in by_size
        )
        lines.append(f"{name:36}{cells}")
    return lines
