"""Estimate the fire of a run from camera images, operators' reports and the reported weather.

The estimate begins with the initial fire of the scenario, or without any fire, and is simulated by
the fire model. Camera images replace the estimate where they differ: all images of a period are
written into the estimate at once at the end of that period. Reports of operators correct the
estimate (``corrected_fire``). Interfaces and forecasts read this fire, and planners receive its
corrections; nothing here reads the simulated fire.

Equal events give equal estimates, bit for bit: images are written at fixed mission times, however
often the estimate is read.
"""

import contextlib
import math
from collections import deque
from collections.abc import Sequence
from functools import partial
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, Mask, Place, window_at
from firemodel.assimilation.observation import BURNED, UNSEEN, Observation
from firemodel.assimilation.written_image import with_image
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.physics.fuels import NON_BURNABLE
from firemodel.spread.fire_scheme import Fire
from mission_service.commands import AnyCommand
from mission_service.config.scenario import Scenario
from mission_service.events import (
    AnyEvent,
    Corrected,
    Erased,
    FireObserved,
    Observed,
    Redone,
    Telemetry,
    Undone,
    WindSet,
)
from mission_service.fire.camera_views import CameraViews, arrival_at
from mission_service.fire.corrected_fire import CorrectedFire, burning_now, drawn_at_s
from mission_service.fire.ignition_reports import ignition_reports_of
from mission_service.fire.late_observation import rewritten, with_observation
from mission_service.fire.observed_window import (
    Window,
    observation_in,
    states_in,
    window_around,
    window_of_change,
)
from mission_service.fire.reported_observations import (
    Confirmation,
    observation_of,
    refuse_contradicted,
)
from mission_service.fire.run_ensemble import Lit, RunEnsemble, WeatherSet
from mission_service.fire.scenario_fire import begun_again, cells_lit, reported_fire
from mission_service.fire.sightings import Mosaic, Sightings
from mission_service.fire.source_agreement import SourceAgreement

PERIOD_US = 30_000_000  # images are written into the estimate at multiples of this mission time
# Images older than the last written period by this are inserted at their own time.
LATE_US = 10_000_000
AHEAD_US = 5_000_000
MAX_WAITING = 20  # more unwritten periods are written even if the estimate is not read
CORRECTION_SD_M = 1.0  # standard deviation of drawn positions
OWN_DRAWS = 2  # the estimate of a random scheme must not predict the simulated fire's draws
# Events that change the estimate.
OF_FIRE = (Corrected, FireObserved, Erased, Undone, Redone, WindSet)


class RunEstimate:
    """The estimated fire of a run."""

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        """Begin with the initial fire of the scenario.

        In a burn, operators' reports correct the estimate of the burn's guidance instead of this.
        """
        self.landscape = landscape
        self._fire = reported_fire(scenario, landscape)
        self._fire.draw_from(np.random.default_rng((scenario.seed, OWN_DRAWS)))
        self._begin = partial(begun_again, scenario, landscape)
        self._corrected = CorrectedFire(landscape, self._begin)
        self._accepts_reports = scenario.burn_flown is None
        self._ignitions = ignition_reports_of(scenario)
        self._views = CameraViews(scenario)
        self._gives_views = scenario.simulation.fire is None and self._accepts_reports
        self._unburnable = np.isin(landscape.fuel_model, list(NON_BURNABLE))
        self._images = Sightings(landscape.shape)  # sightings of the present period
        self._due_us: int | None = None  # end of the present period
        self._latest_us = round(scenario.start_s * 1e6)  # latest time of the events so far
        self._written_us = -(2**63)  # end of the last period with images
        self._ahead: Fire | None = None  # a copy for times after the latest event
        self._waiting: deque[Mosaic] = deque()  # past periods that are not written yet
        self._sightings = Sightings(landscape.shape)  # sightings of the whole run
        # Cells that planners received as burned in corrections; images may have removed them since.
        self._reported = np.zeros(landscape.shape, dtype=bool)
        self._contradicted: Window | None = None
        self._confirmation = Confirmation(landscape.shape)
        self.agreement = SourceAgreement(landscape.shape, landscape.cell_size_m)
        self.ensemble = RunEnsemble(scenario, landscape)

    @property
    def fire(self) -> Fire:
        """The fire at the time of the last ``advance``, or a few seconds earlier."""
        return self._fire if self._ahead is None else self._ahead

    def advance(self, at_us: int) -> None:
        """Advance the fire to this mission time, never backwards.

        Long after the latest event only a copy advances, because events of earlier times may
        follow. Therefore the estimate does not depend on the times at which it is read.
        """
        self._advance_until(min(at_us, self._latest_us))
        self._ahead = None
        if at_us > self._latest_us + AHEAD_US:
            self._ahead = self._fire.copy()
            self._ahead.advance(at_us / 1e6)

    def _advance_until(self, at_us: int) -> None:
        """Write the images of past periods and advance the fire, at most to ``_latest_us``."""
        while self._waiting:
            self._write(self._waiting.popleft())
        self._burn_until(at_us / 1e6)

    def view(self, fix: Telemetry) -> Observed | None:
        """Return the part of the estimate that a vehicle's camera would show, if an image is due.

        The result is None off the landscape. The result is also None in a run with a simulated
        fire, which cameras observe, and in a burn, which has an estimate of its own.
        """
        if not (self._gives_views and self._views.is_due(fix)):
            return None
        return self.seen_from(fix)

    def seen_from(self, fix: Telemetry, wider_cells: float = 0.0) -> Observed | None:
        """Return what ``view`` returns, whether an image is due or not.

        ``wider_cells`` is added to the footprint of the camera on each side.
        """
        self._on_time(fix)
        self._advance_until(fix.at_us)
        found = self._views.seen_from(fix, self._fire, wider_cells)
        return None if found is None else msgspec.structs.replace(found, estimated=True)

    def arrival_s(self, row: int, col: int) -> float | None:
        """Return the estimate's arrival time at a cell; None if unburned or off the grid."""
        return arrival_at(self._fire, row, col)

    def contradicted(self) -> Window | None:
        """Return the window around the corrections that images removed last, or None.

        Planners need it, because they received these corrections.
        """
        return self._contradicted

    def corrections(self) -> list[dict[str, Any]]:
        """Return the status of the operators' corrections in effect."""
        return self._corrected.log.status()

    def on_event(self, event: AnyEvent) -> None:
        """Process a camera's image, an ignition, a completed drop or a position's reliability."""
        self._on_time(event)
        self._views.on_event(event)
        if isinstance(event, Observed):
            if event.corrects:
                self._contradicted = None
            elif not event.estimated:
                seen = observation_in(event)
                self.agreement.add_image(seen)
                if not event.distrusted:
                    self._on_image(seen, event.at_us)
        elif (reported := self._ignitions.reported_in(event)) is not None:
            self._advance_to_latest()
            cells = cells_lit(reported.points, self.landscape)
            self._corrected.change(self._fire, partial(_lit, cells=cells, at_s=reported.at_s))
            self.ensemble.add_input(Lit(event.at_us / 1e6, reported.at_s, cells))
            self._limit_ensemble()

    def on_command(self, command: AnyCommand) -> None:
        """Process a drop."""
        self._ignitions.on_command(command)

    def apply_report(self, event: AnyEvent) -> Window | None:
        """Apply an operator's report, and return a window around the changed cells or None.

        Raises FireModelError, and changes nothing, for an invalid report.
        """
        self._on_time(event)
        if isinstance(event, FireObserved):
            return self._apply_observation(event)
        if not (self._accepts_reports and isinstance(event, OF_FIRE)):
            return None
        # Checked first: a refused report must not end the present period.
        self._corrected.check_report(event)
        self._advance_to_latest()
        before = self._fire
        found = self._corrected.apply_report(event, before)
        if found is before:
            return None
        at_s = event.at_us / 1e6
        if isinstance(event, WindSet):
            self._fire = found
            self.ensemble.add_input(WeatherSet(at_s, found.weather))
            self._limit_ensemble()
            return None
        self._fire = self._with_sightings(found)
        window = self._reported_change(before)
        if window is not None:
            state = states_in(window.cells)
            self.ensemble.add_input(
                Observation(at_s, window.row, window.col, state, CORRECTION_SD_M)
            )
            self._limit_ensemble()
        return window

    def _apply_observation(self, event: FireObserved) -> Window | None:
        """Apply a reported observation; return a window around the changed cells or None."""
        if not self._accepts_reports:
            raise FireModelError("observe: a burn uses cameras and corrections only; use correct")
        reported = observation_of(event, self.landscape)
        state = np.where(self._later_drawn(reported), UNSEEN, reported.state)
        reported = reported._replace(state=state.astype(np.uint8))
        self._advance_until(self._latest_us)  # images of past periods become sightings
        refuse_contradicted(reported, self._sightings.state, self._sightings.seen_s)
        self._advance_to_latest()
        burned = self._fire.expected_s() <= reported.at_s
        seen = self._confirmation.surprising(reported, burned, self.landscape.cell_size_m)
        if not (seen.state != UNSEEN).any():
            return None
        before = self._fire
        self._place_in_time(seen)
        return self._reported_change(before)

    def _place_in_time(self, seen: Observation) -> None:
        """Change the fire by an observation of the present or of an earlier time."""
        change = partial(
            with_observation, seen=seen, unburnable=self._unburnable, begin=self._begin
        )
        self._fire = self._corrected.change(self._fire, change)
        self._fire = self._with_sightings(self._fire, seen.at_s)
        self._sightings.add(seen)
        self.ensemble.add_late(seen)
        self._limit_ensemble()

    def _later_drawn(self, seen: Observation) -> Mask:
        """Return the cells (y, x) of a window that operators drew at a later time."""
        drawn_s = drawn_at_s(self._corrected.log.held(), self.landscape)
        return np.asarray(drawn_s[seen.where] > seen.at_s)

    def _reported_change(self, before: Fire) -> Window | None:
        """Return the window of a change for planners, and store its burned cells."""
        window = window_of_change(before, self._fire)
        if window is not None:
            state = states_in(window.cells)
            self._reported[window_at(window.row, window.col, state.shape)] = state == BURNED
        return window

    def apply_history(self, event: AnyEvent) -> Window | None:
        """Apply an event of a journal, and return a window around the changed cells or None."""
        found = None
        # A journal contains an invalid report if the run was killed before the report was removed.
        with contextlib.suppress(FireModelError):
            found = self.apply_report(event)
        if self._gives_views and isinstance(event, Telemetry):
            self._views.is_due(event)
        self.on_event(event)
        return found

    def _on_time(self, event: AnyEvent) -> None:
        """End the period of the images if an event is later."""
        self._latest_us, self._ahead = max(self._latest_us, event.at_us), None
        if self._due_us is not None and self._latest_us >= self._due_us:
            self._store_images(self._due_us)

    def _on_image(self, seen: Observation, at_us: int) -> None:
        if at_us < self._written_us - LATE_US:
            self._advance_until(self._latest_us)
            self._place_in_time(seen)
            return
        self._images.add(seen)
        if self._due_us is None:
            self._due_us = self._latest_us - self._latest_us % PERIOD_US + PERIOD_US
        if len(self._waiting) > MAX_WAITING:
            self._advance_until(self._latest_us)

    def _store_images(self, at_us: int) -> None:
        mosaic = self._images.taken(at_us / 1e6)
        self._due_us, self._written_us = None, at_us
        if mosaic is not None:
            self._waiting.append(mosaic)

    def _advance_to_latest(self) -> None:
        """Advance to an event that changes the fire; write the images before the event first."""
        self._store_images(self._latest_us)
        self._advance_until(self._latest_us)

    def _limit_ensemble(self) -> None:
        if self.ensemble.is_long():
            self.ensemble.forget_before_mark(self._fire.weather, burning_now(self._fire))

    def _burn_until(self, at_s: float) -> None:
        if at_s > self._fire.time_s:
            self._fire.advance(at_s)

    def _write(self, mosaic: Mosaic) -> None:
        """Write the images of a period into the fire with and without corrections."""
        self._burn_until(mosaic.at_s)
        self.ensemble.add_image(mosaic.observation())
        self._limit_ensemble()
        self._sightings.add_mosaic(mosaic)
        before, (_, here, state, seen_s, _) = self._fire, mosaic
        change = partial(self._rewritten, here=here, state=state, seen_s=seen_s)
        self._fire = self._corrected.change(before, change)
        if self._fire is before or not self._reported.any():
            return
        removed = self._reported & before.burned() & ~self._fire.burned()
        if removed.any():
            self._reported &= ~removed
            self._contradicted = window_around(removed, self._fire)

    def _rewritten(self, fire: Fire, here: Place, state: NDArray[np.uint8], seen_s: Floats) -> Fire:
        """Return the fire with sightings of a window in it; ``fire`` itself if they agree.

        ``state`` and ``seen_s`` (y, x) have a value for each cell of the window.
        """
        cell_m = self.landscape.cell_size_m
        found = with_image(fire.expected_s(), here, state, seen_s, cell_m, self._unburnable)
        if found is None:
            return fire
        return rewritten(fire, *found, self._begin)

    def _with_sightings(self, fire: Fire, after_s: float = -math.inf) -> Fire:
        """Return a corrected fire with the sightings in it that no later correction replaces.

        Sightings until ``after_s`` are ignored.
        """
        held = self._corrected.log.held()
        seen = self._sightings
        drawn_s = np.maximum(drawn_at_s(held, self.landscape), after_s)
        state = np.where(seen.seen_s > drawn_s, seen.state, UNSEEN)
        return self._rewritten(fire, window_at(0, 0, state.shape), state, seen.seen_s)


def _lit(fire: Fire, cells: Sequence[tuple[int, int]], at_s: float) -> Fire:
    """Light cells (row, column) of a fire at a time, or at the fire's present time if later."""
    for row, col in cells:
        fire.light(row, col, max(at_s, fire.time_s))
    return fire
