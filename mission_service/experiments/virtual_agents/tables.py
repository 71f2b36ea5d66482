"""Write table 2 of this experiment, with the paper's numbers, as text."""

from typing import Any

# Final coverage, in percent, from the paper's text and figures.
PAPER = {
    "Exp1": 100,
    "Exp2": 67,
    "Exp2_1": 100,
    "Exp3": 83,
    "Exp3_1": 100,
    "Exp4": 100,
    "Exp5": 100,
}


def in_text(found: dict[str, Any]) -> str:
    """Return the result as a table of text."""
    lines = [
        "Coverage in the last minute, of the best places found offline, the best at any time, and",
        "the paper's. Conflicts, collisions, nearest pair of all flights",
        "             virtual agents",
        "            end offline   best  paper      UAVs  efficiency  conflicts collisions"
        "  nearest  cells wrong",
    ]
    for row in found["experiments"]:
        lines.append(
            f"  {row['name']:6}{row['va_coverage_final']:7.1%}{row['va_coverage_best_static']:8.1%}"
            f"{row['va_coverage_best']:7.1%}{PAPER[row['name']]:5} %"
            f"{row['uav_coverage_final']:10.1%}{row['uav_coverage_efficiency_final']:12.2%}"
            f"{row['conflicts']:11}{row['collisions']:11}{row['closest_m']:7.0f} m"
            f"{row['inaccuracy_mean_cells']:13.1f}"
        )
    return "\n".join(lines)
