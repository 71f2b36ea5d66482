"""Estimate the fire of a run from camera images, operators' reports and the reported weather.

The estimate begins with the scenario's initial fire, or without any fire, and is simulated using
the fire model. Camera images replace the estimate where the two differ: all images of a period are
written into the estimate at once at the end of that period. Operators' reports correct the estimate
(``corrected_fire``). Interfaces and forecasts read this fire, and planners receive its corrections;
this module does not read the simulated fire.

Equal events give equal estimates, bit for bit: events become inputs (``best_fire``), which are
applied in the order of the events. Images are written at fixed mission times, however often the
estimate is read, and a delay between an event and the application of its input changes nothing. In
a live run (``in_background``) a thread applies each input to a copy of the estimate (``next_work``,
``adopt``); until the copy is adopted, reads show the fire without the input.
"""

import contextlib
import logging
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import msgspec

from firemodel.assimilation.observation import Observation
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.spread.fire_scheme import Fire
from mission_service.commands import AnyCommand
from mission_service.config.scenario import Scenario
from mission_service.errors import in_words
from mission_service.events import (
    AnyEvent,
    AnyOperatorEvent,
    Corrected,
    Erased,
    FireObserved,
    FrontsEstimated,
    Observed,
    RasterObserved,
    Redone,
    Telemetry,
    Undone,
    WindSet,
)
from mission_service.fire.best_fire import (
    BestFire,
    Folded,
    Ignited,
    Input,
    LateImage,
    Reported,
    after,
)
from mission_service.fire.camera_views import CameraViews, arrival_at
from mission_service.fire.ignition_reports import ignition_reports_of
from mission_service.fire.observed_window import Window
from mission_service.fire.reported_observations import (
    MAX_SMOKE,
    Smoke,
    behind_smoke,
    checked_report,
    compared_source,
    observation_of,
    smoke_of,
)
from mission_service.fire.run_ensemble import RunEnsemble
from mission_service.fire.scenario_fire import cells_lit
from mission_service.fire.sightings import Mosaic, Sightings
from mission_service.fire.source_agreement import SourceAgreement

PERIOD_US = 30_000_000  # images are written into the estimate at multiples of this mission time
# In this time, a vehicle flies about as far as its camera sees ahead. With a longer time, vehicles
# would fly around a front that their cameras have already shown to be wrong.
FRONTS_EVERY_US = 10_000_000
# Images older than the last written period by more than this are inserted at their time.
LATE_US = 10_000_000
AHEAD_US = 5_000_000
MAX_REPORTS = 64  # observations queued for the thread; further ones are refused
MAX_WAITING = 20  # queued periods; beyond, images are written even if nothing reads the estimate
OBSERVATIONS = (FireObserved, RasterObserved)
OF_FIRE = (Corrected, *OBSERVATIONS, Erased, Undone, Redone, WindSet)  # they change the estimate


log = logging.getLogger(__name__)


class UnusedReportError(FireModelError):
    """A report that is in the journal but changes nothing, because of ``reason``."""

    def __init__(self, reason: Exception) -> None:
        super().__init__(str(reason))
        self.reason = reason


class RunEstimate:
    """The estimated fire of a run."""

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        """Begin with the scenario's initial fire.

        In a burn, operators' reports correct the estimate used in the burn's guidance, not this
        one.
        """
        self.landscape = landscape
        self.in_background = False  # ``next_work`` and ``adopt``, not reads, apply the inputs
        self._best = BestFire(scenario, landscape)
        self._waiting: deque[Input] = deque()  # if ``_in_work``, a thread applies the first input
        self._in_work = False
        self._accepts_reports = scenario.burn_flown is None
        self._ignitions = ignition_reports_of(scenario)
        self._views = CameraViews(scenario)
        no_cameras = scenario.simulation.fire is None or scenario.passes_image_files
        self._gives_views = no_cameras and self._accepts_reports
        self._gives_fronts = scenario.way.reads_fronts
        self._period_us = FRONTS_EVERY_US if self._gives_fronts else PERIOD_US
        self._fronts_due_us = -(2**63)
        self._images = Sightings(landscape.shape)  # of the current period
        self._due_us: int | None = None  # end of these images' period
        self._latest_us = round(scenario.start_s * 1e6)  # latest time of the events so far
        self._written_us = -(2**63)  # end of the last period with images
        self._ahead: Fire | None = None  # a copy at a time after the latest event
        self._contradicted: tuple[Window, ...] = ()  # windows not yet delivered
        self._smoke: tuple[Smoke, ...] = ()  # the last reports
        # The last checked report, and its cells.
        self._checked: tuple[FireObserved | RasterObserved, Observation] | None = None
        self.agreement = SourceAgreement(landscape.shape, landscape.cell_size_m)
        self.ensemble = RunEnsemble(scenario, landscape)
        self.defect = ""  # the last report that failed because of a defect, with the exception

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes for a snapshot; a thread's unfinished work is repeated later."""
        return {**vars(self), "in_background": False, "_in_work": False, "_checked": None}

    @property
    def fire(self) -> Fire:
        """The fire at the time of the last ``advance``, or a few seconds earlier."""
        return self._best.fire if self._ahead is None else self._ahead

    @property
    def is_behind(self) -> bool:
        """Whether inputs are queued."""
        return bool(self._waiting)

    def waits_for(self, report: AnyOperatorEvent) -> bool:
        """Return whether a report is queued."""
        return any(isinstance(each, Reported) and each.event is report for each in self._waiting)

    def end_background(self) -> None:
        """From now on, apply queued inputs at each read; discard the work of a thread."""
        self.in_background = self._in_work = False

    def advance(self, at_us: int) -> None:
        """Advance the fire to this mission time; an earlier time has no effect.

        If the time is long after the latest event, only a copy is advanced, because earlier events
        may still arrive. Thus the estimate does not depend on when it is read.
        """
        if not self._catch_up(min(at_us, self._latest_us)):
            return
        self._ahead = None
        if at_us > self._latest_us + AHEAD_US:
            self._ahead = self._best.fire.copy()
            self._ahead.advance(at_us / 1e6)

    def _catch_up(self, at_us: int) -> bool:
        """Apply the queued inputs and advance the fire to the given time, at most ``_latest_us``.

        If inputs are queued for a thread (``in_background``), do nothing and return False.
        """
        if self._waiting and self.in_background:
            return False
        self._fold_all()
        self._best.burn_until(at_us / 1e6)
        return True

    def _fold_all(self) -> None:
        while self._waiting:
            self._fold_first()

    def _fold_first(self) -> Folded:
        first = self._waiting[0]
        if isinstance(first, Mosaic):  # no copy needed, because a mosaic cannot be refused
            found = Folded(self._best, self._best.fold(first), None)
        else:
            found = after(self._best, first)
        self._adopt(found)
        return found

    def next_work(self) -> Callable[[], Folded] | None:
        """Return a function that applies the next input, for a thread; None without queued inputs.

        The function's result must be passed to ``adopt`` before the next call.
        """
        if not self._waiting:
            return None
        self._in_work = True
        return partial(after, self._best, self._waiting[0])

    def adopt(self, found: Folded) -> AnyOperatorEvent | None:
        """Replace the fire with the result of ``next_work``; return the report that it applied."""
        first = self._waiting[0]
        self._in_work = False
        self._adopt(found)
        return first.event if isinstance(first, Reported) else None

    def _adopt(self, found: Folded) -> None:
        first = self._waiting.popleft()
        if isinstance(first, Reported) and not isinstance(found.unused, FireModelError | None):
            self._note_defect(first.event, found.unused)
        self._best, self._ahead, change = found.best, None, found.change
        if change.contradicted is not None:
            self._contradicted = (*self._contradicted, change.contradicted)
        if change.add is not None:
            change.add(self.ensemble)
            if self.ensemble.is_long():
                self.ensemble.forget_before_mark(self._best.fire)

    def _note_defect(self, event: AnyOperatorEvent, error: Exception) -> None:
        """Store and log an unexpected exception raised for a valid report."""
        kind, sender, at_s = type(event).__name__, event.by or "an operator", event.at_us / 1e6
        self.defect = (
            f"a report ({kind}) from {sender} at {at_s:.3f} s is not used: {in_words(error)}; this "
            "is a defect, please send the traceback in the log to the developers"
        )
        log.error("%s", self.defect, exc_info=error)

    def _queue(self, new: Input) -> None:
        """Add an input; images of a period are applied later, all other inputs at once."""
        self._waiting.append(new)
        if not self.in_background and not isinstance(new, Mosaic):
            self._fold_all()

    def view(self, fix: Telemetry) -> Observed | None:
        """Return the part of the estimate that a vehicle's camera would show if an image is due.

        The result is None off the landscape, while inputs are queued, in a run with a simulated
        fire (which cameras observe), and in a burn (whose guidance has its own estimate).
        """
        if not (self._gives_views and self._views.is_due(fix)):
            return None
        return self.seen_from(fix)

    def seen_from(self, fix: Telemetry, wider_cells: float = 0.0) -> Observed | None:
        """Return the result of ``view``, even if no image is due.

        ``wider_cells`` is added to the camera footprint on each side.
        """
        self._on_time(fix)
        if not self._catch_up(fix.at_us):
            return None
        found = self._views.seen_from(fix, self._best.fire, wider_cells)
        return None if found is None else msgspec.structs.replace(found, estimated=True)

    def fronts(self, fix: Telemetry) -> FrontsEstimated | None:
        """Return the estimate's fronts if planners use fronts and an update is due.

        The result is None while inputs are queued.
        """
        if not (self._gives_fronts and fix.at_us >= self._fronts_due_us):
            return None
        return self.fronts_at(fix)

    def fronts_at(self, fix: Telemetry) -> FrontsEstimated | None:
        """Return the result of ``fronts``, even if no update is due.

        The fronts are those at the time of the latest event, which may be another vehicle's: a read
        may already have advanced the fire to this time.
        """
        self._on_time(fix)
        if not self._catch_up(self._latest_us):
            return None
        return FrontsEstimated(fix.at_us, fix.vehicle, self._best.estimated_fronts())

    def arrival_s(self, row: int, col: int) -> float | None:
        """Return the estimate's arrival time at a cell; None if unburned or off the grid."""
        return arrival_at(self._best.fire, row, col)

    def contradicted(self) -> tuple[Window, ...]:
        """Return the windows around corrections removed by images.

        Planners need these windows because they received the removed corrections earlier. A window
        is omitted once an event has delivered it.
        """
        return self._contradicted

    def corrections(self) -> list[dict[str, Any]]:
        """Return the status of operators' corrections in effect."""
        return self._best.corrections.log.status()

    def on_event(self, event: AnyEvent) -> None:
        """Process an image, an ignition, a completed drop or a change in position reliability."""
        self._on_time(event)
        self._views.on_event(event)
        if isinstance(event, Observed):
            if event.corrects:
                self._delivered(event)
            elif not event.estimated:
                seen = observation_of(event, self.landscape)
                seen = behind_smoke(seen, self._smoke, seen.source)
                self.agreement.add_image(seen)
                if not event.distrusted:
                    self._on_image(seen, event.at_us)
        elif isinstance(event, FrontsEstimated):
            self._fronts_due_us = event.at_us - event.at_us % FRONTS_EVERY_US + FRONTS_EVERY_US
        elif (reported := self._ignitions.reported_in(event)) is not None:
            self._end_period(self._latest_us)
            cells = cells_lit(reported.points, self.landscape)
            self._queue(Ignited(self._latest_us / 1e6, reported.at_s, cells))

    def _delivered(self, event: Observed) -> None:
        """Remove the window of a delivered event.

        A replay applies inputs as late as possible. Before this event, it must apply the inputs
        that had been applied in the live run.
        """
        if not self.in_background:
            self._fold_all()
        of_event = Window(event.row, event.col, event.cells)
        self._contradicted = tuple(each for each in self._contradicted if each != of_event)

    def on_command(self, command: AnyCommand) -> None:
        """Process a drop."""
        self._ignitions.on_command(command)

    def check(self, event: AnyEvent) -> None:
        """Raise FireModelError for an operator's report that cannot be used; modify nothing.

        While inputs are queued for a thread (``in_background``), some such reports are not
        recognised.
        """
        if not isinstance(event, OF_FIRE):
            return
        if isinstance(event, OBSERVATIONS):
            if not self._accepts_reports:
                raise FireModelError(
                    'observe: a burn uses only cameras and corrections; use "correct"'
                )
            if len(self._waiting) >= MAX_REPORTS:
                raise FireModelError(
                    f"{len(self._waiting)} observations are waiting for the estimate; send this "
                    "one again later, and reduce the rate"
                )
            checked = event, checked_report(event, self.landscape)
        else:
            checked = None
        # ``_catch_up`` turns the images of past periods into sightings.
        if self._accepts_reports and self._catch_up(self._latest_us):
            self._best.check(event, self._smoke)
        self._checked = checked

    def preview(self, reports: Sequence[AnyOperatorEvent]) -> Callable[[], tuple[Fire, Fire]]:
        """Return a function, for a thread, that computes the fire before and after some reports.

        The estimate does not change. The function raises the exception caused by a report that
        cannot be used. Raises FireModelError in a burn, where reports correct the estimate used in
        the burn's guidance.
        """
        if not self._accepts_reports:
            raise FireModelError("a burn has no preview of corrections")
        now_s = max(self._latest_us, *(report.at_us for report in reports)) / 1e6
        images = self._images.copy().taken(self._latest_us / 1e6)
        before = [*self._waiting, *([] if images is None else [images])]
        changes = [Reported(now_s, report, self._smoke) for report in reports]
        return partial(_previewed, self._best.copy(), before, changes)

    def apply_report(self, event: AnyEvent) -> Window | None:
        """Apply an operator's report; return a window around the changed cells, or None.

        If a thread applies the inputs (``in_background``), the report is queued, and the result is
        None.

        Raises UnusedReportError for a report that changes nothing because it cannot be used.
        """
        self._on_time(event)
        checked, self._checked = self._checked, None
        if not (self._accepts_reports and isinstance(event, OF_FIRE)):
            return None
        if isinstance(event, FireObserved) and event.state == "smoke":
            self._smoke = (*self._smoke[1 - MAX_SMOKE :], smoke_of(event, self.landscape))
            return None
        if isinstance(event, OBSERVATIONS):
            is_checked = checked is not None and checked[0] is event
            seen = checked[1] if checked and is_checked else observation_of(event, self.landscape)
            self._compare(seen._replace(source=compared_source(event)))
        self._end_period(self._latest_us)
        self._waiting.append(Reported(self._latest_us / 1e6, event, self._smoke))
        if self.in_background:
            return None
        while len(self._waiting) > 1:
            self._fold_first()
        found = self._fold_first()
        if found.unused is not None:
            raise UnusedReportError(found.unused) from found.unused
        return found.change.window

    def _compare(self, seen: Observation) -> None:
        """Compare the cells of a report with other sources.

        Raises UnusedReportError if the source of the report contradicts the others.
        """
        seen = behind_smoke(seen, self._smoke, "")
        self.agreement.add_report(seen)
        if seen.source in self.agreement.distrusted:
            reason = self.agreement.contradictions()[seen.source]
            raise UnusedReportError(FireModelError(reason))

    def apply_history(self, event: AnyEvent) -> Window | None:
        """Apply an event from a journal; return a window around the changed cells, or None."""
        found = None
        with contextlib.suppress(UnusedReportError):
            found = self.apply_report(event)
        if self._gives_views and isinstance(event, Telemetry):
            self._views.is_due(event)
        self.on_event(event)
        return found

    def _on_time(self, event: AnyEvent) -> None:
        """End the image period if an event is later than its end."""
        self._latest_us, self._ahead = max(self._latest_us, event.at_us), None
        if self._due_us is not None and self._latest_us >= self._due_us:
            self._end_period(self._due_us)

    def _on_image(self, seen: Observation, at_us: int) -> None:
        if at_us < self._written_us - LATE_US:
            self._queue(LateImage(self._latest_us / 1e6, seen))
            return
        self._images.add(seen)
        if self._due_us is None:
            self._due_us = self._latest_us - self._latest_us % self._period_us + self._period_us
        if len(self._waiting) > MAX_WAITING:
            self._catch_up(self._latest_us)

    def _end_period(self, at_us: int) -> None:
        """Queue the images of the current period as one input at its end."""
        mosaic = self._images.taken(at_us / 1e6)
        self._due_us, self._written_us = None, at_us
        if mosaic is not None:
            self._queue(mosaic)


def _previewed(
    best: BestFire, before: Sequence[Input], reports: Sequence[Reported]
) -> tuple[Fire, Fire]:
    """Return the fire after the inputs ``before``, and after the reports following them."""
    for each in before:
        best = after(best, each).best
    best.burn_until(reports[-1].now_s)
    changed = best
    for report in reports:
        found = after(changed, report)
        if found.unused is not None:
            raise found.unused
        changed = found.best
    return best.fire, changed.fire
