"""Draw figs. 10 and 11 of Beachly et al. from the results of simulated participants."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from firemodel.ellipses.point_observations import BURNED, BURNING, UNBURNED
from mission_service.experiments.beachly.corrections import (
    METHODS,
    WATCHING,
    Study,
    arrival_s,
    in_period,
)
from mission_service.experiments.beachly.participants import front_points
from mission_service.experiments.beachly.truth import MINUTE_S, unit_box

COLOURS = {"paper": "#b34700", "gaussian": "#0b3c8c"}
LABELS = {"paper": "the paper's method", "gaussian": "Gaussian process"}
PENS = {
    BURNED: ("black", "burned"),
    BURNING: ("#e8a200", "burning"),
    UNBURNED: ("#2e7d32", "unburned"),
}
SHOWN_MIN = (WATCHING.begins_s[1] + WATCHING.segment_s) / MINUTE_S


def draw(out: Path, studies: list[Study]) -> None:
    """Draw fig. 10 from all studies and fig. 11 from the median study."""
    draw_errors(out / "fig10.png", studies)
    draw_fronts(out / "fig11.png", usual(studies))


def usual(studies: list[Study]) -> Study:
    """Return the study in which the Gaussian process leaves the median share of the error."""
    period = in_period(studies[0].case.at_s)
    left = [
        float(np.nanmean(one.errors_m["gaussian"][period]) / np.nanmean(one.uncorrected_m[period]))
        for one in studies
    ]
    return studies[int(np.argsort(left)[len(left) // 2])]


def draw_errors(path: Path, studies: list[Study]) -> None:
    """Draw fig. 10: one fire with its participants (left) and the mean of all studies (right)."""
    figure = Figure(figsize=(12.0, 4.8), dpi=100, layout="constrained")
    left, right = figure.subplots(1, 2)
    one = usual(studies)
    same = [other for other in studies if other.case.name == one.case.name]
    minutes = one.case.at_s / MINUTE_S
    for method, colour in COLOURS.items():
        for number, other in enumerate(same):
            label = f"{LABELS[method]}, each participant" if number == 0 else None
            left.plot(minutes, other.errors_m[method], "--", color=colour, label=label, linewidth=1)
        mean = np.nanmean([other.errors_m[method] for other in studies], axis=0)
        right.plot(minutes, mean, color=colour, label=LABELS[method])
    left.plot(minutes, one.uncorrected_m, color="black", linewidth=3, label="no corrections")
    uncorrected = np.nanmean([other.uncorrected_m for other in studies], axis=0)
    right.plot(minutes, uncorrected, color="black", linewidth=3, label="no corrections")
    fires = len({other.case.name for other in studies})
    for axes, title in (
        (left, f'fire "{one.case.name}", {len(same)} participants'),
        (right, f"mean of {fires} fires and {len(studies)} participants"),
    ):
        for begin_s in WATCHING.begins_s:
            axes.axvspan(
                begin_s / MINUTE_S,
                (begin_s + WATCHING.segment_s) / MINUTE_S,
                color="#dddddd",
                label="segments shown" if begin_s == WATCHING.begins_s[0] else None,
            )
        axes.set(xlabel="time (minutes)", ylabel="front error (m)", ylim=(0.0, None))
        axes.set_xlim(minutes[0], minutes[-1])
        axes.set_title(title, fontsize=10)
        axes.legend(fontsize=8)
    figure.savefig(path)


def draw_fronts(path: Path, one: Study) -> None:
    """Draw fig. 11: the true and simulated fronts at the end of the second segment."""
    figure = Figure(figsize=(15.0, 5.0), dpi=100, layout="constrained")
    at_s = SHOWN_MIN * MINUTE_S
    number = int(np.argmin(np.abs(one.case.at_s - at_s)))
    observations = one.observations[one.observations[:, 2] <= at_s]
    west, south, east, north = unit_box()
    panels = figure.subplots(1, 3)
    shown: list[tuple[str, Any, float]] = [
        ("no corrections", None, float(one.uncorrected_m[number]))
    ]
    shown += [(LABELS[name], METHODS[name], float(one.errors_m[name][number])) for name in METHODS]
    for axes, (title, method, error_m) in zip(panels, shown, strict=True):
        front = front_points(arrival_s(one.case, observations, method), at_s, one.case.grid)
        true = one.case.fronts[number]
        axes.plot(*(true - (west, south)).T, ".", color="#0b3c8c", markersize=3, label="true front")
        axes.plot(*(front - (west, south)).T, ".", color="#c62828", markersize=2, label="simulated")
        lit = one.case.model.sources  # type: ignore[attr-defined]
        lit = lit[lit[:, 2] <= at_s]
        axes.plot(*(lit[:, :2] - (west, south)).T, "x", color="#888888", markersize=3, label="lit")
        if method:
            for state, (pen, name) in PENS.items():
                these = observations[observations[:, 3] == state, :2] - (west, south)
                axes.plot(*these.T, "o", color=pen, markersize=3.5, label=f"marked {name}")
        size = (east - west, north - south)
        axes.add_patch(Rectangle((0.0, 0.0), *size, fill=False, color="#888888", linestyle=":"))
        axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
        axes.set(xlim=(-40.0, east - west + 40.0), ylim=(-40.0, north - south + 40.0))
        axes.set_title(f"{title}: {error_m:.1f} m", fontsize=10)
    panels[-1].legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1.0), markerscale=1.5)
    figure.suptitle(f'fire "{one.case.name}", minute {SHOWN_MIN:g}; the square is the unit')
    figure.savefig(path)
