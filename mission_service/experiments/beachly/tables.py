"""Convert the result to text."""

from typing import Any


def in_text(found: dict[str, Any]) -> str:
    """Return the result as lines of text."""
    lines = [
        "Trajectories: drops, places skipped as unsafe, minimum time to fire at low height,",
        "drops outside the unit, maximum miss of a drop",
    ]
    for row in found["trajectories"]:
        lines.append(
            f"  scenario {row['scenario']}{row['drops']:7}{row['skipped']:7}"
            f"{row['min_time_margin_s']:9.0f} s{row['outside_area']:6}"
            f"{row['farthest_off_its_place_m']:8.1f} m   {row['lines']} lines"
        )
    lines.append("Corrections: mean front error without and with corrections, and its reduction")
    for row in found["corrections"]:
        before_m, after_m = row["mean_error_uncorrected_m"], row["mean_error_m"]
        less = 1.0 - after_m / before_m if before_m else 0.0
        lines.append(
            f"  {row['truth']:12} {row['method']:10}{row['corrections']:6} corrections"
            f"{before_m:8.1f} m{after_m:8.1f} m{less:7.0%}"
        )
    return "\n".join(lines)
