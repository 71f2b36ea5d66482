"""Apply images, reports, ignitions and wind to the best estimate, which is a single fire. Pure.

Applying an input (``Mosaic``, ``LateImage``, ``Ignited``, ``Reported``) takes from milliseconds to
a second, which is too long for the event loop. Therefore, ``after`` works on a copy and may run in
a thread.
"""

import copy
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, Mask, Place, window_at
from firemodel.assimilation.front_lines import FrontLine, front_distances, front_lines
from firemodel.assimilation.learned_inputs import SPEED, TURN, LearnedInputs
from firemodel.assimilation.observation import BURNED, UNSEEN, Observation
from firemodel.assimilation.unfounded_cells import unfounded_cells
from firemodel.assimilation.written_image import with_image
from firemodel.landscape.landscape import Landscape
from firemodel.physics.fuels import NON_BURNABLE
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.fire_scheme import Fire
from mission_service.config.scenario import Scenario
from mission_service.events import (
    AnyOperatorEvent,
    EstimatedFront,
    FireObserved,
    RasterObserved,
    WindSet,
)
from mission_service.fire.corrected_fire import CorrectedFire, drawn_at_s
from mission_service.fire.late_observation import rewritten, with_observation, with_wind
from mission_service.fire.observed_window import (
    Window,
    states_in,
    window_around,
    window_of_change,
)
from mission_service.fire.report_confirmation import Confirmation
from mission_service.fire.reported_observations import (
    CORRECTION_SD_M,
    Smoke,
    behind_smoke,
    note_of,
    observation_of,
    refuse_contradicted,
)
from mission_service.fire.run_ensemble import Lit, RunEnsemble, WeatherSet
from mission_service.fire.scenario_fire import begun_again, reported_fire
from mission_service.fire.sightings import Mosaic, Sightings

MIN_INPUT_CHANGE = 0.02  # smaller changes in the learned inputs are not applied to the fire
OWN_DRAWS = 2  # seed, so that a random scheme does not draw the same numbers as the simulated fire


class LateImage(NamedTuple):
    """An image that was received long after its time."""

    now_s: float
    seen: Observation


class Ignited(NamedTuple):
    """Cells (row, column) that were lit at ``at_s``."""

    now_s: float
    at_s: float
    cells: Sequence[tuple[int, int]]


class Reported(NamedTuple):
    """An operator's report, and the earlier smoke reports."""

    now_s: float
    event: AnyOperatorEvent
    smoke: Sequence[Smoke] = ()


Input = Mosaic | LateImage | Ignited | Reported


class Change(NamedTuple):
    """The changes made by an input.

    Attributes:
        window: A window around the cells changed by a report, for planners.
        contradicted: A window around corrections removed by images, for planners.
        add: Adds the input to the ensemble.
        note: A text for the sender if part of the report changes nothing; otherwise empty.
    """

    window: Window | None = None
    contradicted: Window | None = None
    add: Callable[[RunEnsemble], None] | None = None
    note: str = ""


NOTHING = Change()


class BestFire:
    """The estimated fire, its corrections, and the last sighting of each cell."""

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        """Begin with the scenario's reported fire."""
        self.fire = reported_fire(scenario, landscape)
        self.fire.draw_from(np.random.default_rng((scenario.seed, OWN_DRAWS)))
        self._landscape = landscape
        self._begin = partial(begun_again, scenario, landscape)
        self._corrected = CorrectedFire(landscape, self._begin)
        self._unburnable = np.isin(landscape.fuel_model, list(NON_BURNABLE))
        self._sightings = Sightings(landscape.shape)
        # Cells that planners have received as burned; images may since have removed these
        # corrections.
        self._reported = np.zeros(landscape.shape, dtype=bool)
        self._confirmation = Confirmation(landscape.shape)
        self._learned = LearnedInputs(landscape, self.fire.time_s, self.fire.rate_options)
        self._applied = self._learned.state  # the inputs that drive the fire
        self._weather = self.fire.weather  # of the last hours

    def estimated_fronts(self) -> tuple[EstimatedFront, ...]:
        """Return the fronts of the fire for planners, with rounded values."""
        fire, found = self.fire, []
        for front in self._front_lines():
            speed_sd_m_s = self._learned.speed_sds_m_s(
                front.ahead, front.speed_m_s, fire.weather, fire.time_s
            )
            listed = (
                *(_listed(front.row, 2), _listed(front.col, 2)),
                *(_listed(front.speed_m_s, 4), _listed(speed_sd_m_s, 4)),
                _listed(front.unseen_s, 0),
            )
            found.append(EstimatedFront(front.inner, *listed))
        return tuple(found)

    def _front_lines(self) -> list[FrontLine]:
        return front_lines(self.fire, self._sightings.seen_s, self._learned)

    @property
    def corrections(self) -> CorrectedFire:
        """The operators' corrections."""
        return self._corrected

    def copy(self) -> "BestFire":
        """Return an independent copy; on 500 x 500 cells this takes about 10 ms."""
        found = copy.copy(self)
        found.fire = self.fire.copy()
        found._corrected = self._corrected.copy()
        found._sightings, found._reported = self._sightings.copy(), self._reported.copy()
        found._confirmation = self._confirmation.copy()
        found._learned = self._learned.copy()
        return found

    def burn_until(self, at_s: float) -> None:
        """Advance the fire to a time; an earlier time has no effect."""
        if at_s > self.fire.time_s:
            self.fire.advance(at_s)

    def check(self, event: AnyOperatorEvent, smoke: Sequence[Smoke]) -> None:
        """Raise FireModelError for a report that is invalid, has no effect or is contradicted."""
        if isinstance(event, FireObserved | RasterObserved):
            self._reported_cells(event, smoke)
        else:
            self._corrected.check_report(event)

    def fold(self, each: Input) -> Change:
        """Apply an input and return the changes.

        Raises FireModelError for a report that cannot be used.
        """
        match each:
            case Mosaic():
                return self._write(each)
            case LateImage(now_s, seen):
                self.burn_until(now_s)
                self._place_in_time(seen)
                return Change(add=lambda ensemble: ensemble.add_late(seen))
            case Ignited(now_s, at_s, cells):
                self.burn_until(now_s)
                self._corrected.change(self.fire, partial(_lit, cells=cells, at_s=at_s))
                return Change(add=lambda ensemble: ensemble.add_input(Lit(now_s, at_s, cells)))
            case Reported(now_s, FireObserved() | RasterObserved() as event, smoke):
                return self._observe(event, now_s, smoke)
            case Reported(now_s, event):
                return self._correct(event, now_s)

    def _correct(self, event: AnyOperatorEvent, now_s: float) -> Change:
        self._corrected.check_report(event)
        self.burn_until(now_s)
        before = self.fire
        found = self._corrected.apply_report(event, before)
        if found is before:
            return NOTHING
        at_s = event.at_us / 1e6
        if isinstance(event, WindSet):
            self._learned.forget_wind()
            found = self._corrected.change(found, self._with_all_inputs)
            self._applied = self._learned.state
            self._weather = with_wind(self._weather, event.speed_m_s, event.from_deg, now_s)
            self.fire, weather = found, found.weather
            return Change(add=lambda ensemble: ensemble.add_input(WeatherSet(at_s, weather)))
        if self._corrected.is_corrected:  # a restarted fire, without learned inputs or images
            found = self._with_sightings(self._with_all_inputs(found))
        self.fire = found
        window = self._reported_change(before)
        if window is None:
            return NOTHING
        state = states_in(window.cells)
        seen = Observation(at_s, window.row, window.col, state, CORRECTION_SD_M)
        return Change(window, add=lambda ensemble: ensemble.add_input(seen))

    def _with_all_inputs(self, fire: Fire) -> Fire:
        """Apply the learned inputs to a fire that was started in the reported weather."""
        return _with_inputs(fire, self._learned.state, self._learned)

    def _reported_cells(
        self, event: FireObserved | RasterObserved, smoke: Sequence[Smoke]
    ) -> Observation:
        """Return a report's cells except those that operators drew at a later time.

        Raises FireModelError for a report that is contradicted.
        """
        found = behind_smoke(observation_of(event, self._landscape), smoke, "")
        drawn_s = drawn_at_s(self._corrected.log.held(), self._landscape)[found.where]
        state = np.where(drawn_s > found.at_s, UNSEEN, found.state).astype(np.uint8)
        found = found._replace(state=state)
        refuse_contradicted(found, self._sightings.state, self._sightings.seen_s)
        return found

    def _observe(
        self, event: FireObserved | RasterObserved, now_s: float, smoke: Sequence[Smoke]
    ) -> Change:
        reported = self._reported_cells(event, smoke)
        self.burn_until(now_s)
        burned = self.fire.expected_s() <= reported.at_s
        cell_m = self._landscape.cell_size_m
        seen, waiting = self._confirmation.surprising(reported, burned, cell_m)
        changes = bool((seen.state != UNSEEN).any())
        note = note_of(event, reported, waiting, changes)
        if not changes:
            return Change(note=note)
        before = self.fire
        self._place_in_time(seen)
        return Change(
            self._reported_change(before),
            add=lambda ensemble: ensemble.add_late(seen),
            note=note,
        )

    def _place_in_time(self, seen: Observation) -> None:
        """Change the fire to agree with an observation from the current or an earlier time."""
        change = partial(
            with_observation,
            seen=seen,
            unburnable=self._unburnable,
            begin=self._begin,
            weather=self._weather,
        )
        self.fire = self._corrected.change(self.fire, change)
        self.fire = self._with_sightings(self.fire, seen.at_s)
        self._sightings.add(seen)

    def _reported_change(self, before: Fire) -> Window | None:
        """Return the window of a change for planners, and store its burned cells."""
        window = window_of_change(before, self.fire)
        if window is not None:
            state = states_in(window.cells)
            self._reported[window_at(window.row, window.col, state.shape)] = state == BURNED
        return window

    def _write(self, mosaic: Mosaic) -> Change:
        """Write a period's images into the fire, both with and without corrections."""
        self.burn_until(mosaic.at_s)
        self._learn(mosaic)
        self._sightings.add_mosaic(mosaic)
        before, (_, here, state, seen_s, _) = self.fire, mosaic
        change = partial(self._rewritten, here=here, state=state, seen_s=seen_s)
        self.fire = self._corrected.change(before, change)
        return Change(
            contradicted=None if self.fire is before else self._removed(before),
            add=lambda ensemble: ensemble.add_image(mosaic.observation()),
        )

    def _learn(self, mosaic: Mosaic) -> None:
        """Update the learned inputs from the distances between observed and estimated front."""
        seen = front_distances(
            self._front_lines(), mosaic.here, mosaic.state, self._landscape.cell_size_m
        )
        self._learned.learn(*seen, self.fire.weather, mosaic.at_s)
        change = self._learned.state - self._applied
        if np.abs(change).max() >= MIN_INPUT_CHANGE:
            self._applied = self._learned.state
            with_inputs = partial(_with_inputs, change=change, learned=self._learned)
            self.fire = self._corrected.change(self.fire, with_inputs)

    def _removed(self, before: Fire) -> Window | None:
        """Return a window around the reported cells that are no longer burned, or None."""
        removed: Mask = self._reported & before.burned() & ~self.fire.burned()
        if not removed.any():
            return None
        self._reported &= ~removed
        return window_around(removed, self.fire)

    def _rewritten(self, fire: Fire, here: Place, state: NDArray[np.uint8], seen_s: Floats) -> Fire:
        """Return the fire after sightings in a window; ``fire`` itself if the sightings agree.

        ``state`` and ``seen_s`` (y, x) are the window's cell states and their times.
        """
        cell_m = self._landscape.cell_size_m
        found = with_image(fire.expected_s(), here, state, seen_s, cell_m, self._unburnable)
        if found is None:
            return fire
        arrival_s, changed = found
        removed = changed & (arrival_s > fire.time_s) & fire.burned()
        if removed.any():
            unfounded = unfounded_cells(
                fire.burned_arrival_s(),
                removed,
                self._sightings.state == BURNED,
                fire.arrival_vectors() / cell_m,
            )
            arrival_s[unfounded], changed = np.inf, changed | unfounded
        return rewritten(fire, arrival_s, changed, self._begin)

    def _with_sightings(self, fire: Fire, after_s: float = -math.inf) -> Fire:
        """Return a corrected fire that agrees with all sightings later than the corrections.

        Sightings up to ``after_s`` are ignored.
        """
        held = self._corrected.log.held()
        seen = self._sightings
        drawn_s = np.maximum(drawn_at_s(held, self._landscape), after_s)
        state = np.where(seen.seen_s > drawn_s, seen.state, UNSEEN)
        return self._rewritten(fire, window_at(0, 0, state.shape), state, seen.seen_s)


class Folded(NamedTuple):
    """The result of ``after``: the fire, the changes and why a report was not used."""

    best: BestFire
    change: Change
    unused: Exception | None


def after(best: BestFire, each: Input) -> Folded:
    """Return the fire after an input; ``best`` is not modified.

    A report that raises an exception has no effect; otherwise, a journal with such a report would
    make every restart fail.
    """
    found = best.copy()
    try:
        return Folded(found, found.fold(each), None)
    except Exception as error:
        if isinstance(each, Reported):
            return Folded(best, NOTHING, error)
        raise


def _with_inputs(fire: Fire, change: Floats, learned: LearnedInputs) -> Fire:
    """Return a fire that continues with learned inputs, whose state changes by ``change``."""
    found = fire.copy()
    rates = np.exp(learned.fuel_log_rates(change))
    rates = np.broadcast_to(rates, (len(fire.weather_ahead()), rates.size))
    inputs = math.exp(change[SPEED]), math.degrees(change[TURN]), rates
    if isinstance(found, AnyAngleFire):
        found.perturb(*inputs, learned.cell_rates())
    else:
        found.perturb(*inputs)
    return found


def _lit(fire: Fire, cells: Sequence[tuple[int, int]], at_s: float) -> Fire:
    """Ignite cells (row, column) of a fire at ``at_s``, or now if ``at_s`` is in the past."""
    for row, col in cells:
        fire.light(row, col, max(at_s, fire.time_s))
    return fire


def _listed(values: Floats, digits: int) -> tuple[float, ...]:
    return tuple(np.round(values, digits).tolist())
