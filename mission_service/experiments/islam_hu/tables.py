"""Convert the result, with the paper's numbers, to tables of text."""

from typing import Any

from mission_service.experiments.islam_hu.scenarios import (
    ALPHAS,
    COMPARED,
    PAPER_MEAN_MAX_CELLS,
    PAPER_REVERSALS,
)

COLUMN = 17  # width of a planner's column


def in_text(found: dict[str, Any]) -> str:
    """Return the result as tables of text."""
    return "\n\n".join((_reversals(found), _errors(found), _attention(found)))


def _reversals(found: dict[str, Any]) -> str:
    lines = [
        "Reversals in five hours, damped rule",
        "  fire            scheme    " + "".join(f"{f'α = {alpha:g}':>9}" for alpha in ALPHAS),
    ]
    for name, scheme in _fires(found):
        counts = [row["reversals"] for row in _of(found["alpha_sweep"], name, scheme)]
        lines.append(f"  {name:16}{scheme:10}" + "".join(f"{count:9}" for count in counts))
        if name in PAPER_REVERSALS and scheme == COMPARED[-1]:
            printed = "".join(f"{count:9}" for count in PAPER_REVERSALS[name])
            lines.append(f"  {'':16}{'paper':10}{printed}")
    return "\n".join(lines)


def _errors(found: dict[str, Any]) -> str:
    planners = [row["planner"] for row in _of(found["distance_error"], *_fires(found)[0])]
    lines = [
        "Distance error in cells over 360 angles, α = 1: mean over time of the maximum (change",
        "against circling), then mean over time of the mean. The error is that of the convex hull",
        "of the observed front (section VI.E); for predictive, that of its estimated front.",
        "Without aircraft: persistence (front at deployment), model (weather at the ignition)",
        "  fire            scheme    "
        + "".join(f"{planner:>{COLUMN}}" for planner in planners)
        + "   "
        + "".join(f"{planner:>{COLUMN}}" for planner in planners),
    ]
    for name, scheme in _fires(found):
        rows = _of(found["distance_error"], name, scheme)
        worst = {row["planner"]: row["mean_max_cells"] for row in rows}
        lines.append(
            f"  {name:16}{scheme:10}{_against_circling(worst, planners)}   "
            + "".join(f"{row['mean_mean_cells']:{COLUMN}.2f}" for row in rows)
        )
        if name in PAPER_MEAN_MAX_CELLS and scheme == COMPARED[-1]:
            printed = _against_circling(PAPER_MEAN_MAX_CELLS[name], planners)
            lines.append(f"  {'':16}{'paper':10}{printed}".rstrip())
    return "\n".join(lines)


def _against_circling(worst: dict[str, float], planners: list[str]) -> str:
    text = f"{worst['circling']:{COLUMN}.1f}"
    for planner in planners[1:]:
        cell = ""
        if planner in worst:
            change = 100.0 * (worst[planner] / worst["circling"] - 1.0)
            cell = f"{worst[planner]:.1f} ({change:+.0f} %)"
        text += f"{cell:>{COLUMN}}"
    return text


def _attention(found: dict[str, Any]) -> str:
    lines = [
        "Attention of the damped rule, α = 1, before and after the fire changes",
        "  fire            scheme     changes   reversals    time north of the ignition",
    ]
    for row in found["attention"]:
        turns = f"{row['reversals_before']} → {row['reversals_after']}"
        north = f"{row['time_north_before']:.0%} → {row['time_north_after']:.0%}"
        fire = f"{row['scenario']:16}{row['scheme']:10}"
        lines.append(f"  {fire}{row['changes_h']:6.1f} h{turns:>12}    {north}")
    return "\n".join(lines)


def _fires(found: dict[str, Any]) -> list[tuple[str, str]]:
    return [(row["scenario"], row["scheme"]) for row in found["attention"]]


def _of(rows: list[dict[str, Any]], name: str, scheme: str) -> list[dict[str, Any]]:
    return [row for row in rows if (row["scenario"], row["scheme"]) == (name, scheme)]
