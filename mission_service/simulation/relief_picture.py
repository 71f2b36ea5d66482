"""Draws the plan of a watch as a timeline of aircraft and batteries."""

from pathlib import Path
from typing import TYPE_CHECKING

from firemodel.outputs.whole_file import whole_file
from mission_service.relief.watch import ReliefPlan, Watch

if TYPE_CHECKING:
    from matplotlib.axes import Axes

OUT, TASK, BACK = "#9ecae1", "#2171b5", "#c6b3dc"
FLOWN, EMPTY, CHARGING, READY = "#636363", "#d9d9d9", "#fdae6b", "#a1d99b"
LAPSE = "#d7191c"
ROW_IN, BAR = 0.3, 0.7
MAX_TICKS = 12
TICKS_MIN = (5, 10, 15, 30, 60, 120, 180, 240, 360, 720, 1440)

Bar = tuple[float, float]  # start and length, in hours


def draw_relief(path: Path, watch: Watch, plan: ReliefPlan, name: str, words: str) -> None:
    """Draw a row for each aircraft and each battery, with the lapses across all rows.

    Raises FireModelError if the file cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    batteries = [f"{pool} {n + 1}" for pool, count in watch.batteries for n in range(count)]
    rows = len(watch.aircraft) + len(batteries)
    figure = Figure(figsize=(12.0, ROW_IN * rows + 2.6), dpi=110)
    FigureCanvasAgg(figure)
    figure.set_layout_engine("constrained")
    ratios = [len(watch.aircraft), max(len(batteries), 1)]
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=ratios)
    end_s = plan.begins_s + watch.duration_s
    _draw_aircraft(above, watch, plan)
    _draw_batteries(below, batteries, plan, end_s)
    for axes in (above, below):
        for lapse in plan.lapses:
            axes.axvspan(
                lapse.start_s / 3600, lapse.end_s / 3600, color=LAPSE, alpha=0.2, lw=0, zorder=0
            )
        axes.invert_yaxis()
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(axis="x", color="#dddddd")
        axes.set_axisbelow(True)
    below.set_xlim(0.0, end_s / 3600)
    _set_ticks(below, end_s)
    below.set_xlabel("time since the first takeoff (h:min)")
    colours = {
        "flight out": OUT,
        "on task": TASK,
        "return, landing": BACK,
        "battery flown": FLOWN,
        "to be charged": EMPTY,
        "charging": CHARGING,
        "charged": READY,
    }
    handles = [Patch(color=colour, label=label) for label, colour in colours.items()]
    if plan.lapses:
        handles.append(Patch(color=LAPSE, alpha=0.2, label="too few on task"))
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=len(handles),
        frameon=False,
        fontsize=9,
        columnspacing=1.4,
    )
    figure.suptitle(f"{name}: {words}", fontsize=11, wrap=True)
    with whole_file(path) as part:
        figure.savefig(part, format="png")


def _draw_aircraft(axes: "Axes", watch: Watch, plan: ReliefPlan) -> None:
    for row, aircraft in enumerate(watch.aircraft):
        own = [each for each in plan.sorties if each.aircraft == aircraft.name]
        for colour, spans in (
            (OUT, [(each.takeoff_s, each.on_task_s) for each in own]),
            (TASK, [(each.on_task_s, each.leaves_s) for each in own]),
            (BACK, [(each.leaves_s, each.landing_s) for each in own]),
        ):
            axes.broken_barh(_bars(spans), (row - BAR / 2, BAR), facecolors=colour)
    axes.set_yticks(range(len(watch.aircraft)), [each.name for each in watch.aircraft])
    axes.set_ylim(-0.5, len(watch.aircraft) - 0.5)
    axes.tick_params(labelbottom=False)


def _draw_batteries(axes: "Axes", batteries: list[str], plan: ReliefPlan, end_s: int) -> None:
    for row, battery in enumerate(batteries):
        flown = [(s.takeoff_s, s.landing_s) for s in plan.sorties if s.battery == battery]
        charging = [(c.start_s, c.end_s) for c in plan.charges if c.battery == battery]
        charged_s = [0, *(end for _, end in charging)]
        takeoffs_s = [start for start, _ in flown]
        charged_from_s = [start for start, _ in charging] or [end_s] * len(flown)
        waiting = [(s, c) for (_, s), c in zip(flown, charged_from_s, strict=True) if s < c]
        if len(takeoffs_s) < len(charged_s):
            takeoffs_s.append(max(end_s, charged_s[-1]))
        ready = list(zip(charged_s, takeoffs_s, strict=True))
        for colour, spans in (
            (FLOWN, flown),
            (EMPTY, waiting),
            (CHARGING, charging),
            (READY, ready),
        ):
            axes.broken_barh(_bars(spans), (row - BAR / 2, BAR), facecolors=colour)
    axes.set_yticks(range(len(batteries)), batteries)
    axes.set_ylim(-0.5, max(len(batteries), 1) - 0.5)


def _bars(spans: list[tuple[int, int]]) -> list[Bar]:
    return [(start_s / 3600, (end_s - start_s) / 3600) for start_s, end_s in spans]


def _set_ticks(axes: "Axes", end_s: int) -> None:
    """Set ticks at whole minutes or hours, labelled as in the table."""
    minutes = end_s // 60
    step = next((each for each in TICKS_MIN if minutes // each <= MAX_TICKS), TICKS_MIN[-1])
    ticks = range(0, minutes + 1, step)
    axes.set_xticks([each / 60 for each in ticks], [f"{m // 60}:{m % 60:02d}" for m in ticks])
