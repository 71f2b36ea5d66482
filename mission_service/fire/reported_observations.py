"""Convert images, reports and corrections to observed cells, and check reports. Pure."""

from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, Mask, bounds_of
from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN, Observation
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.rasterise import mask_of
from mission_service.events import Corrected, Erased, FireObserved, Observed, RasterObserved
from mission_service.fire.correction_log import drawn_shape, not_erased
from mission_service.fire.observed_window import observation_in
from mission_service.fire.raster_cells import raster_cells
from mission_service.requests import MAX_AGE_S

MAX_CONTRADICTED = 0.5  # of the cells shown in images or other reports
SHORTLY_S, SEVERAL_CELLS = 120.0, 5
MANY_TIMES = 20  # a report this many times larger is not refused for a few cells
# Fuel ignites at this temperature in the spread model (Rothermel 1972, Research Paper INT-115,
# heat of preignition). Cooler ground may be hot ash, or may be heated by the sun or by a nearby
# fire.
IGNITION_C = 320.0
COOL_FALSE_ALARMS = 0.5  # minimum below ``IGNITION_C``; any fraction requires a second report
CORRECTION_SD_M = 1.0  # operators' drawings are treated as certain
SMOKE_S = 600.0  # before and after a report of smoke
MAX_SMOKE = 100  # reports of smoke that are stored
TAK, TAK_STATION = "TAK", "cot:"  # the source of all TAK users, and the prefix of their stations
STATES = {
    "burned": BURNED,
    "burning": BURNED,
    "hot": BURNED,
    "unburned": UNBURNED,
    "smoke": UNSEEN,
}


def observation_of(
    event: Observed | FireObserved | RasterObserved | Corrected,
    landscape: Landscape,
    erasures: Sequence[Erased] = (),
) -> Observation:
    """Return the cells shown in an image, a report or a correction, with their time and errors.

    Args:
        event: The event. The inside of a burning area counts as burned.
        landscape: The landscape.
        erasures: The later erasures; the cells in their circles are not shown.

    Returns:
        The cells. An image has no detection errors, because a filter has removed them. The window
        is empty if a report contains no cell of the landscape.
    """
    if isinstance(event, Observed):
        return observation_in(event)
    if isinstance(event, RasterObserved):
        return _raster(event, landscape)
    mask = mask_of([drawn_shape(event, landscape)], landscape)
    here = bounds_of(mask) if mask.any() else (slice(0, 0), slice(0, 0))
    row, col = np.nonzero(mask[here])
    top, left = (int(each.start) for each in here)
    state = np.full(mask[here].shape, UNSEEN, dtype=np.uint8)
    if erasures:
        centres_m = np.column_stack(landscape.xy_of(row + float(top), col + float(left)))
        kept = not_erased(centres_m, erasures, landscape)
        row, col = row[kept], col[kept]
    state[row, col] = STATES[event.state]
    if isinstance(event, Corrected):
        at_s, source = event.marked_at_us / 1e6, f"{event.by} at {event.station}"
        return Observation(at_s, top, left, state, CORRECTION_SD_M, source=source)
    false_alarms = event.false_alarms
    if event.temperature_c is not None and event.temperature_c < IGNITION_C:
        false_alarms = max(false_alarms, COOL_FALSE_ALARMS)
    return Observation(
        event.seen_at_us / 1e6,
        top,
        left,
        state,
        event.position_sd_m,
        event.missed,
        false_alarms,
        sender_of(event),
    )


def _raster(event: RasterObserved, landscape: Landscape) -> Observation:
    return Observation(
        event.seen_at_us / 1e6,
        *raster_cells(event, landscape),
        event.position_sd_m,
        event.missed,
        event.false_alarms,
        sender_of(event),
    )


def sender_of(event: FireObserved | RasterObserved) -> str:
    """Return the name of a report's source; it differs from all cameras' names."""
    return f"{event.source} of {event.by}" if event.source else f"{event.by} at {event.station}"


def compared_source(event: FireObserved | RasterObserved) -> str:
    """Return the source name under which a report is compared with other sources.

    All reports from TAK count as one source, because TAK does not identify its users. Otherwise, a
    single sender with several names would be a majority.
    """
    return TAK if event.station.startswith(TAK_STATION) else sender_of(event)


def checked_report(event: FireObserved | RasterObserved, landscape: Landscape) -> Observation:
    """Return the cells of a report.

    Raises FireModelError for a report that is too old or shows no cell of the landscape.
    """
    do = "raster" if isinstance(event, RasterObserved) else "observe"
    age_s = (event.at_us - event.seen_at_us) / 1e6
    if age_s > MAX_AGE_S:
        raise FireModelError(
            f"{do}: age_s = {age_s:g}: observations older than {MAX_AGE_S:g} s are not used"
        )
    found = observation_of(event, landscape)
    if not found.state.size:
        raise FireModelError(f"{do}: contains no cell of the landscape; check its position")
    if isinstance(event, RasterObserved) and not (found.state != UNSEEN).any():
        raise FireModelError(
            "raster: no cell of the landscape was seen; check its position. With missed_pct or "
            "false_alarms_pct, a cell needs five observed neighbours"
        )
    return found


class Smoke(NamedTuple):
    """Cells behind smoke at a given time, in images of ``source`` (if given) and all reports."""

    at_s: float
    source: str
    top: int  # row and column of the window's north-west cell
    left: int
    covered: Mask  # (y, x) of the window


def smoke_of(event: FireObserved, landscape: Landscape) -> Smoke:
    """Return the cells in a smoke report."""
    found = observation_of(msgspec.structs.replace(event, state="burned"), landscape)
    return Smoke(found.at_s, event.source, found.top, found.left, found.state != UNSEEN)


def behind_smoke(seen: Observation, smoke: Sequence[Smoke], source: str) -> Observation:
    """Return an observation in which unburned cells behind smoke are unseen.

    Args:
        seen: The observation.
        smoke: The smoke reports.
        source: The source of an image, or "" for a report. All smoke reports apply to a report.
    """
    hidden: Mask = np.zeros(seen.state.shape, dtype=bool)
    for each in smoke:
        if abs(each.at_s - seen.at_s) > SMOKE_S or source not in ("", each.source):
            continue
        row, col = np.nonzero(each.covered)
        row, col = row + each.top - seen.top, col + each.left - seen.left
        inside = (row >= 0) & (col >= 0) & (row < hidden.shape[0]) & (col < hidden.shape[1])
        hidden[row[inside], col[inside]] = True
    if not hidden.any():
        return seen
    state = np.where(hidden & (seen.state == UNBURNED), UNSEEN, seen.state).astype(np.uint8)
    return seen._replace(state=state)


def refuse_contradicted(seen: Observation, state: NDArray[np.uint8], seen_s: Floats) -> None:
    """Raise FireModelError for a report that contradicts most of the sightings of its cells.

    Burned cells must not have been seen as unburned at a later time; for more than a few cells,
    sightings shortly before that time also count. Unburned cells must not have been seen as burned
    before. A few contradicted cells of a large report do not count.

    Args:
        seen: The reported observation.
        state: (y, x) the last sighting of each cell of the grid.
        seen_s: (y, x) the times of these sightings.
    """
    state, seen_s = state[seen.where], seen_s[seen.where]
    burned, unburned = seen.state == BURNED, seen.state == UNBURNED
    since_s = seen.at_s - (SHORTLY_S if np.count_nonzero(burned) >= SEVERAL_CELLS else 0.0)
    wrong = burned & (state == UNBURNED) & (seen_s > since_s)
    wrong |= unburned & (state == BURNED) & (seen_s <= seen.at_s)
    agreed = (burned & (state == BURNED)) | (unburned & (state == UNBURNED))
    contradict, agree = np.count_nonzero(wrong), np.count_nonzero(agreed)
    shown = np.count_nonzero(seen.state != UNSEEN)
    if contradict < SEVERAL_CELLS and shown >= MANY_TIMES * contradict:
        return
    if contradict > MAX_CONTRADICTED * (contradict + agree):
        raise FireModelError(
            f"images or other reports contradict it in {contradict} of "
            f"{contradict + agree} cells that they show; check its position and age; a user with "
            'the role "correct" can change the fire there'
        )


def note_of(
    event: FireObserved | RasterObserved, reported: Observation, waiting: int, changes: bool
) -> str:
    """Return a line for the sender on why part of a report changes nothing, or an empty text.

    Args:
        event: The report.
        reported: The reported cells that are not behind smoke and were not drawn at a later time.
        waiting: The number of reported cells that require a second report.
        changes: Whether other cells change the estimate.
    """
    if waiting:
        return (
            f"cells that need a second report: {waiting}; send it again after 10 s or more, "
            "within 30 min, or report them with another sensor"
        )
    has_burned = isinstance(event, RasterObserved) and any("b" in row for row in event.rows)
    if has_burned and not (reported.state == BURNED).any():
        return "the majority filter removed its burned cells, because they are too few"
    if changes:
        return ""
    if not (reported.state != UNSEEN).any():
        return "changes nothing: smoke covers its cells, or they were corrected at a later time"
    return "changes nothing: it agrees with the estimate within two standard deviations"
