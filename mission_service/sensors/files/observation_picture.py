"""Draws the observed cells of a file on a map, with the position errors of reported points."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import window_at
from firemodel.assimilation.observation import BURNED, UNSEEN
from firemodel.landscape.landscape import Landscape
from firemodel.outputs.arrival_map import frame_around, save_map, set_title, start_map
from firemodel.outputs.whole_file import whole_file
from mission_service.events import FireObserved
from mission_service.fire.observed_window import states_in
from mission_service.fire.reported_observations import observation_of
from mission_service.sensors.files.file_contents import FileCells, FileContents, FileReport
from mission_service.sensors.thermal.frame_picture import (
    ALPHA,
    BURNED_COLOUR,
    CAMERA_COLOUR,
    SIGMAS,
    UNBURNED_COLOUR,
    draw_cells,
    km_from_corner,
)

NOTE = "Observations in a file. Not for navigation. Graticule WGS 84, arrow to true north."
MAX_CIRCLES = 1000


def states_of(contents: FileContents, landscape: Landscape) -> NDArray[np.uint8]:
    """Return the states (y, x) of the landscape's cells after all observations in a file."""
    found = np.full(landscape.shape, UNSEEN, dtype=np.uint8)
    for each in contents.observations:
        if isinstance(each, FileCells):
            top, left, state = each.row, each.col, states_in(each.cells)
        else:
            seen = observation_of(_event_of(each), landscape)
            top, left, state = seen.top, seen.left, seen.state
        here = found[window_at(top, left, state.shape)]
        here[state != UNSEEN] = state[state != UNSEEN]
    return found


def _event_of(report: FileReport) -> FireObserved:
    return FireObserved(
        0,
        *("", "", report.state, report.shape, report.points, 0),
        *(report.position_sd_m, report.false_alarms, report.source),
        islands=report.islands,
    )


def draw_contents(path: Path, landscape: Landscape, name: str, contents: FileContents) -> None:
    """Draw the observed cells, and the 90 % error circle of each reported point.

    Raises FireModelError if the file cannot be written.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Circle, Patch

    state = states_of(contents, landscape)
    shown = np.where(state == BURNED, 0.0, np.inf)
    shown = shown if np.isfinite(shown).any() else np.where(state == UNSEEN, np.inf, 0.0)
    frame = frame_around(landscape, shown, np.empty((0, 2)))
    figure, axes = start_map(landscape, np.full(landscape.shape, np.inf), frame)
    limits = axes.axis()
    draw_cells(axes, landscape, (0, 0), state)
    for x_m, y_m, radius_m in _circles(contents, landscape):
        place, radius_km = km_from_corner(landscape, x_m, y_m), radius_m / 1e3
        axes.add_patch(Circle(place, radius_km, fill=False, edgecolor=CAMERA_COLOUR, zorder=6))
    axes.axis(limits)
    axes.legend(
        handles=[
            Patch(color=BURNED_COLOUR, alpha=ALPHA, label="burned or burning"),
            Patch(color=UNBURNED_COLOUR, alpha=ALPHA, label="unburned"),
            Line2D([], [], color=CAMERA_COLOUR, label="position error of a point, 90 %"),
        ],
        loc="upper left",
        title="Observed",
    ).set_zorder(7)
    sources = ", ".join(dict.fromkeys(each.source for each in contents.observations))
    set_title(axes, name, f"{len(contents.observations)} observations · {sources[:100]}")
    axes.set_xlabel(NOTE, fontsize=9)
    with whole_file(path) as part:
        save_map(figure, part)


def _circles(contents: FileContents, landscape: Landscape) -> Iterator[tuple[float, float, float]]:
    """Yield x, y and radius (m) of the error circles of reported points, at most ``MAX_CIRCLES``.

    A circle contains the true position with a probability of 90 %.
    """
    left = MAX_CIRCLES
    for each in contents.observations:
        if isinstance(each, FileReport) and each.shape == "points":
            places_m = landscape.xy_of_places(each.points[:left])
            left -= len(places_m)
            for x_m, y_m in places_m:
                yield float(x_m), float(y_m), SIGMAS * each.position_sd_m
