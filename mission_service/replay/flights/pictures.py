"""Draws the report's figures: map, timeline, heights, observation of the front, missions."""

import io
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from firemodel.outputs.arrival_map import frame_around, start_map
from firemodel.outputs.graticule import km_of
from mission_service.ground_distance import M_PER_DEG
from mission_service.replay.flights.run_analysis import RunAnalysis, VehicleAnalysis, places_of
from mission_service.replay.flights.run_figures import above_terrain_m
from mission_service.runtime.run_outputs import VEHICLE_COLOURS

Floats = NDArray[np.float64]
Places = Callable[[Any, Any], tuple[Any, Any]]  # converts lat, lon to km on the axes

MAX_MISSIONS = 6  # more missions would hide the map, so none is drawn
GAP_US = 10_000_000
MAX_LABELS = 8  # with more reversals, their positions have no labels
DIFFERS = "#d500f9"
CLOCKWISE, ANTICLOCKWISE = "#0b6fb8", "#c75000"
MODE_COLOURS = (
    "#8dd3c7", "#ffffb3", "#bebada", "#fb8072", "#80b1d3", "#fdb462", "#b3de69", "#fccde5",
)  # fmt: skip


def png(figure: Figure) -> bytes:
    """Return a figure as the bytes of a PNG file; equal figures result in equal bytes."""
    data = io.BytesIO()
    figure.savefig(data, format="png", metadata={"Software": None})
    return data.getvalue()


def _new(rows: int, height: float, width: float = 11.0) -> tuple[Figure, list[Any]]:
    figure = Figure(figsize=(width, height), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, list(np.ravel(figure.subplots(rows, 1, squeeze=False, sharex=True)))


def coloured(run: RunAnalysis) -> list[tuple[str, VehicleAnalysis]]:
    """Return each vehicle with its colour, the same in all figures."""
    count = len(run.vehicles)
    return list(zip(VEHICLE_COLOURS * count, run.vehicles.values(), strict=False))


# Map ------------------------------------------------------------------------------------------


def draw_map(run: RunAnalysis) -> Figure:
    """Draw the fire, tracks, missions, reversals, drops and flight against the planner's choice."""
    figure, axes, places = _ground(run)
    handles: list[Any] = []
    for colour, vehicle in coloured(run):
        if len(vehicle.track):
            handles += _draw_vehicle(axes, run, vehicle, colour, places)
    by_label: dict[str, Any] = {handle.get_label(): handle for handle in handles}
    axes.set_title(run.name, parse_math=False)
    figure.set_layout_engine("compressed", rect=(0.0, 0.0, 1.0, 0.98))  # room for the title
    axes.legend(
        handles=list(by_label.values()), ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.07),
        fontsize=9,
    )  # fmt: skip
    return figure


def _ground(run: RunAnalysis) -> tuple[Figure, Any, Places]:
    """Return a figure, its axes in km with the fire, if any, and the transform from lat, lon."""
    points = np.concatenate([each.track[:, 1:3] for each in run.vehicles.values()])
    if run.fire is not None:
        land = run.fire.landscape
        flown_m = np.stack(land.xy_of_lat_lon(*points.T), axis=1) if len(points) else None
        frame = frame_around(land, run.fire.arrival_s, flown_m)
        figure, axes = start_map(land, run.fire.arrival_s, frame)
        return figure, axes, partial(km_of, land)
    figure = Figure(figsize=(9.5, 9), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    home = points[0] if len(points) else np.zeros(2)
    east = M_PER_DEG * np.cos(np.deg2rad(home[0]))

    def around_home(lat: Any, lon: Any) -> tuple[Any, Any]:
        return (lon - home[1]) * east / 1e3, (lat - home[0]) * M_PER_DEG / 1e3

    axes.set(xlabel="east of its start (km)", ylabel="north of its start (km)")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.3)
    return figure, axes, around_home


def _draw_vehicle(
    axes: Any, run: RunAnalysis, vehicle: VehicleAnalysis, colour: str, places: Places
) -> list[Any]:
    track, name = vehicle.track, vehicle.name
    x, y = places(track[:, 1], track[:, 2])
    handles = []
    for span in vehicle.differs:
        inside = (track[:, 0] >= span.from_us) & (track[:, 0] <= span.to_us)
        axes.plot(
            np.where(inside, x, np.nan), y, color=DIFFERS, linewidth=6, alpha=0.3,
            solid_capstyle="round",
        )  # fmt: skip
    if vehicle.differs:
        handles.append(
            Line2D([], [], color=DIFFERS, linewidth=6, alpha=0.3, label="against the planner")
        )
    missions = vehicle.flown.missions
    for _, items in missions if len(missions) <= MAX_MISSIONS else ():
        path = np.array(places_of(items)).reshape(-1, 2)
        axes.plot(
            *places(path[:, 0], path[:, 1]), color=colour, linestyle=":", marker=".", alpha=0.6
        )
        handles.append(
            Line2D([], [], color=colour, linestyle=":", marker=".", label=f"{name}: missions")
        )
    axes.plot(x, y, color="white", linewidth=2.2, alpha=0.7)
    axes.plot(x, y, color=colour, linewidth=1.2)
    handles.append(Line2D([], [], color=colour, label=f"{name}: track"))
    axes.plot(x[0], y[0], marker="s", color=colour, markeredgecolor="white", markersize=8)
    axes.annotate("start", (x[0], y[0]), xytext=(7, -11), textcoords="offset points", fontsize=8)
    labelled = len(vehicle.turned_back) <= MAX_LABELS
    for number, turn in enumerate(vehicle.turned_back):
        place = places(turn.lat_deg, turn.lon_deg)
        axes.plot(*place, marker="v", color="#e31a1c", markeredgecolor="white", markersize=10)
        if labelled:
            _label(axes, f"turns back, {run.since_s(turn.at_us):.0f} s", place, number)
    if vehicle.turned_back:
        handles.append(_mark("v", "#e31a1c", "turned back"))
    handles += _draw_decided(axes, run, vehicle, places)
    return handles + _draw_drops(axes, run, vehicle, places)


def _draw_decided(
    axes: Any, run: RunAnalysis, vehicle: VehicleAnalysis, places: Places
) -> list[Any]:
    """Mark the positions at which the vehicle's planner decided to turn back."""
    if run.fire is None or not run.fire.record.vehicles[vehicle.name].reversals:
        return []
    at = np.array([each[1:] for each in run.fire.record.vehicles[vehicle.name].reversals])
    style: dict[str, Any] = {
        "linestyle": "", "marker": "^", "color": "black", "markerfacecolor": "white",
        "markersize": 5, "label": "planner decides to turn back",
    }  # fmt: skip
    axes.plot(*places(at[:, 0], at[:, 1]), **style)
    return [Line2D([], [], **style)]


def _label(axes: Any, text: str, place: tuple[Any, Any], number: int) -> None:
    """Label a position on the side with more space, alternating between two heights."""
    west, east = axes.get_xlim()
    left = place[0] > west + 0.7 * (east - west)
    axes.annotate(
        text, place, xytext=(-9 if left else 9, 6 - 16 * (number % 2)), textcoords="offset points",
        ha="right" if left else "left", fontsize=9, fontweight="bold", color="#b00000",
        bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 1},
    )  # fmt: skip


def _draw_drops(axes: Any, run: RunAnalysis, vehicle: VehicleAnalysis, places: Places) -> list[Any]:
    planned = [each.planned[:2] for each in vehicle.drops if each.planned is not None]
    done = [each.done[1:3] for each in vehicle.drops if each.done is not None]
    record = None if run.fire is None else run.fire.record.vehicles[vehicle.name]
    if record is not None and record.drops:
        done = [each.lat_lon for each in record.drops if each.outcome == "done"]
        flown = {each.plan_hash for each in record.drops}
        planned = [
            (drop.lat_deg, drop.lon_deg)
            for key, plan in record.plans.items()
            if key in flown
            for drop in plan.drops
        ]
    handles = []
    styles: tuple[tuple[Any, dict[str, Any], str], ...] = (
        (planned, {"marker": "o", "markerfacecolor": "none", "markersize": 10}, "drop planned"),
        (done, {"marker": "*", "markersize": 8, "markeredgecolor": "white"}, "drop done"),
    )
    for points, style, label in styles:
        if points:
            at = np.array(points)
            axes.plot(*places(at[:, 0], at[:, 1]), linestyle="", color="#6a1b9a", **style)
            handles.append(Line2D([], [], linestyle="", color="#6a1b9a", label=label, **style))
    return handles


def _mark(marker: str, colour: str, label: str) -> Line2D:
    return Line2D(
        [], [], linestyle="", marker=marker, color=colour, markersize=10,
        markeredgecolor="white", label=label,
    )  # fmt: skip


# Timeline -------------------------------------------------------------------------------------


def draw_timeline(run: RunAnalysis) -> Figure:
    """Draw modes, new missions, link losses and directions of travel, one strip per vehicle."""
    count = len(run.vehicles)
    figure, panels = _new(count, 1.2 + 1.5 * count)
    scale, unit = _scale(run.since_s(run.end_us))
    for axes, (_, vehicle) in zip(panels, coloured(run), strict=True):
        _draw_strip(axes, run, vehicle, scale)
        axes.set_title(_title(run, vehicle), loc="left", fontsize=10, parse_math=False)
    panels[-1].set_xlabel(f"since the flight began ({unit})")
    first = run.since_s(run.begin_us) / scale
    panels[-1].set_xlim(first, max(run.since_s(run.end_us) / scale, first + 1e-3))
    return figure


def _scale(duration_s: float) -> tuple[float, str]:
    return (3600.0, "h") if duration_s > 7200.0 else (60.0, "min") if duration_s > 900 else (1, "s")


def _draw_strip(axes: Any, run: RunAnalysis, vehicle: VehicleAnalysis, scale: float) -> None:
    flown, end_us = vehicle.flown, run.end_us

    def bars(row: int, states: Sequence[tuple[int, Any]], colours: dict[Any, Any]) -> None:
        ends = [at_us for at_us, _ in states[1:]] + [end_us]
        for (at_us, state), until_us in zip(states, ends, strict=False):
            if (colour := colours[state]) is not None:
                width = run.since_s(until_us) - run.since_s(at_us)
                span = [(run.since_s(at_us) / scale, width / scale)]
                axes.broken_barh(span, (row - 0.4, 0.8), facecolors=colour)

    modes = list(dict.fromkeys(name or "unknown" for _, name, _ in flown.modes))
    colours = dict(zip(modes, MODE_COLOURS * len(modes), strict=False))
    bars(0, [(at, name or "unknown") for at, name, _ in flown.modes], colours)
    colour_of = {True: CLOCKWISE, False: ANTICLOCKWISE, None: None}
    bars(1, vehicle.directions, colour_of)
    rows = ["mode", "flown"]
    if run.fire is not None and run.fire.follows_front:
        bars(2, vehicle.decided, colour_of)
        rows.append("planner")
    axes.set_yticks(range(len(rows)), rows)
    axes.set_ylim(len(rows) - 0.5, -0.9)
    for at_us in [*(at_us for at_us, _ in flown.missions), *flown.replaced_us]:
        axes.plot(run.since_s(at_us) / scale, -0.6, marker="v", color="black", markersize=4)
    for turn in vehicle.turned_back:
        axes.axvline(run.since_s(turn.at_us) / scale, color="#e31a1c", linewidth=1.2)
    for at_us, silent_us in flown.silences:
        since_s = run.since_s(at_us - silent_us) / scale
        axes.axvspan(since_s, run.since_s(at_us) / scale, color="red", alpha=0.25)
    handles: list[Any] = [Patch(color=colours[mode], label=mode) for mode in modes]
    handles += [
        Patch(color=CLOCKWISE, label="clockwise"),
        Patch(color=ANTICLOCKWISE, label="anticlockwise"),
        Line2D([], [], linestyle="", marker="v", color="black", markersize=4, label="new mission"),
        Line2D([], [], color="#e31a1c", label="turned back"),
    ]
    axes.legend(handles=handles, loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)


# Heights and observation ----------------------------------------------------------------------


def draw_heights(run: RunAnalysis) -> Figure:
    """Draw the altitude above sea level and, if the run has a landscape, the terrain below."""
    count = len(run.vehicles)
    figure, panels = _new(count, 0.8 + 2.0 * count)
    scale, unit = _scale(run.since_s(run.end_us))
    for axes, (colour, vehicle) in zip(panels, coloured(run), strict=True):
        since = (vehicle.track[:, 0] - run.zero_us) / 1e6 / scale
        altitude = vehicle.track[:, 3].copy()
        altitude[1:][np.diff(vehicle.track[:, 0]) > GAP_US] = np.nan  # interrupts the drawn line
        axes.plot(since, altitude, color=colour, linewidth=1.2, label="altitude")
        if vehicle.terrain_amsl_m is not None and np.isfinite(vehicle.terrain_amsl_m).any():
            low = float(np.nanmin(vehicle.terrain_amsl_m)) - 20.0
            axes.fill_between(since, low, vehicle.terrain_amsl_m, color="#a1887f", label="terrain")
        axes.set_ylabel("m above sea level")
        axes.set_title(_height_title(run, vehicle), loc="left", fontsize=10, parse_math=False)
        axes.grid(alpha=0.3)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
    panels[-1].set_xlabel(f"since the flight began ({unit})")
    return figure


def _height_title(run: RunAnalysis, vehicle: VehicleAnalysis) -> str:
    heights_m = above_terrain_m(vehicle)
    if heights_m is None or not np.isfinite(heights_m).any():
        return _title(run, vehicle)
    return f"{_title(run, vehicle)}: up to {np.nanmax(heights_m):.0f} m above terrain"


def _title(run: RunAnalysis, vehicle: VehicleAnalysis) -> str:
    return vehicle.name if run.name == vehicle.name else f"{run.name}, {vehicle.name}"


def draw_knowledge(runs: Sequence[RunAnalysis]) -> Figure | None:
    """Draw observation and estimation errors of the front; return None without a fire."""
    drawn = [run for run in runs if run.fire is not None and run.fire.samples]
    if not drawn:
        return None
    errors = any(run.fire is not None and run.fire.errors_m for run in drawn)
    figure, panels = _new(2 + errors, 2.4 * (2 + errors) + 0.4)
    scale, unit = _scale(max(run.since_s(run.end_us) for run in drawn))
    lines = [
        (f"{run.name}: {name}" if len(drawn) > 1 else name, run, name)
        for run in drawn
        for name in run.vehicles
    ]
    if errors:
        for (label, run, name), colour in zip(lines, VEHICLE_COLOURS * len(lines), strict=False):
            assert run.fire is not None
            points = np.array(run.fire.errors_m.get(name, [])).reshape(-1, 3)
            panels[0].plot(
                _since(run, points[:, 0]) / scale, points[:, 1], color=colour, label=label
            )
        panels[0].set_ylabel("distance error (m)\nmean over bearings")
        panels[0].legend(fontsize=8)
    for run, colour in zip(drawn, VEHICLE_COLOURS * len(drawn), strict=False):
        assert run.fire is not None
        samples = run.fire.samples
        since = _since(run, np.array([each.at_us for each in samples])) / scale
        label = run.name
        shares = [100.0 * each.recent_share for each in samples]
        panels[-2].plot(since, shares, color=colour, label=label)
        ages = np.array([[each.age_mean_s, each.age_worst_s] for each in samples]) / 60.0
        panels[-1].plot(since, ages[:, 0], color=colour, label=f"{label}: mean")
        panels[-1].plot(since, ages[:, 1], color=colour, linestyle=":", label=f"{label}: worst")
    panels[-2].set(ylabel="front observed\nin 10 min (%)", ylim=(-3, 103))
    panels[-1].set(ylabel="age of\nfront (min)", xlabel=f"since the flight began ({unit})")
    for axes in panels:
        axes.grid(alpha=0.3)
    for axes in panels[-2:]:
        axes.legend(fontsize=8)
    return figure


def _since(run: RunAnalysis, mission_us: Floats) -> Floats:
    since: Floats = (mission_us - run.mission.start_us) / 1e6
    return since + run.since_s(run.mission.begin_us)


def draw_changes(runs: Sequence[RunAnalysis]) -> Figure | None:
    """Draw the distributions of times between visits and of upload times, or return None."""
    visits = [(run.name, run.fire.revisits_s) for run in runs if run.fire and run.fire.revisits_s]
    sent = [
        (run.name, [(each.finished_us - each.at_us) / 1e6 for each in run.fire.uploads
                    if each.finished_us is not None and each.outcome == "accepted"])
        for run in runs
        if run.fire is not None and not run.fire.open_loop
    ]  # fmt: skip
    sent = [each for each in sent if each[1]]
    if not visits and not sent:
        return None
    figure = Figure(figsize=(11, 3.2), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    columns = [each for each in (visits, sent) if each]
    panels = np.ravel(figure.subplots(1, len(columns), squeeze=False))
    for axes, rows in zip(panels, columns, strict=True):
        for (name, values), colour in zip(rows, VEHICLE_COLOURS * len(rows), strict=False):
            ordered = np.sort(values)
            share = 100.0 * np.arange(1, len(ordered) + 1) / len(ordered)
            axes.step(ordered, share, where="post", color=colour, label=name)
        of_visits = rows is visits
        label = "time between visits to a place" if of_visits else "time from upload to acceptance"
        axes.set(xlabel=f"{label} (s)", ylabel="share (%)", ylim=(0, 101), xlim=(0, None))
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, loc="lower right")
    return figure
