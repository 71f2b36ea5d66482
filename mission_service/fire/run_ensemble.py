"""Track the fire of a run with an ensemble, which also estimates wind and spread rates.

The ensemble (``firemodel.assimilation.fire_estimate``) needs a lot of computing time, so its inputs
are collected in a list, which a thread processes when a forecast is requested. Equal inputs give
equal ensembles, no matter how many inputs are processed at each request.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from firemodel.arrays import Floats
from firemodel.assimilation.observation import BURNED, Observation
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import WeatherStream
from firemodel.spread.burning import burning_from_arrival
from firemodel.spread.fire_scheme import Burning, Fire
from firemodel.spread.schemes import SCHEMES
from mission_service.config.scenario import Scenario
from mission_service.fire.scenario_fire import (
    burning_of,
    closings_of,
    estimate_errors,
    ignitions_of,
    weather_of,
)

if TYPE_CHECKING:
    from firemodel.assimilation.fire_estimate import FireEstimate

IMAGES_PERIOD_S = 120.0
INPUTS_PER_MARK = 60  # the number of periods in two hours
ADVANCED_EVERY_S = 600.0  # maximum interval between inputs; forecasts then have little to compute


class Lit(NamedTuple):
    """Cells (row, column) that were lit at ``at_s``, as reported at ``known_s``."""

    known_s: float
    at_s: float
    cells: Sequence[tuple[int, int]]


class WeatherSet(NamedTuple):
    """The reported weather from a given time on."""

    at_s: float
    weather: WeatherStream


class Images(NamedTuple):
    """The images of a period, sorted by time; the ensemble is advanced once for all of them."""

    at_s: float
    seen: Sequence[Observation]


class _Mark(NamedTuple):
    """A state of the estimated fire after a number of inputs."""

    inputs: int
    weather: WeatherStream
    at_s: float
    arrival_s: Floats  # (y, x)

    def burning(self, landscape: Landscape) -> Burning | None:
        """Return the burning state, or None if nothing has burned."""
        if not (self.arrival_s <= self.at_s).any():
            return None
        return burning_from_arrival(self.arrival_s, landscape, self.at_s)


Input = Images | Observation | Lit | WeatherSet


def _time_of(each: Input) -> float:
    """Return the time by which inputs are sorted."""
    return each.known_s if isinstance(each, Lit) else each.at_s


class RunEnsemble:
    """The inputs of the ensemble, and the ensemble after the processed inputs.

    A snapshot of a run contains only the inputs, which are then processed again.
    """

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        """Begin with the scenario's initial fire; later ignitions are inputs."""
        self._scenario, self._landscape = scenario, landscape
        self._begun_from: _Mark | None = None  # None for the beginning of the run
        self._mark: _Mark | None = None
        self._processed: FireEstimate | None = None  # created when first needed
        self._count = 0  # number of processed inputs
        lit = sorted(ignitions_of(scenario, landscape), key=lambda each: each[2])
        self._inputs: list[Input] = []
        self._images: list[Observation] = []  # images of the current period
        self._last_s = 0.0  # time of the last input
        self._scheduled = [Lit(at_s, at_s, [(row, col)]) for row, col, at_s in lit]

    @property
    def processed(self) -> "FireEstimate":
        """The ensemble after the inputs processed so far; it must not be modified."""
        if self._processed is None:
            scenario, landscape = self._scenario, self._landscape
            if self._begun_from is None:
                start = (weather_of(scenario), burning_of(scenario, landscape))
            else:
                start = (self._begun_from.weather, self._begun_from.burning(landscape))
            self._processed = new_estimate(scenario, landscape, *start)
        return self._processed

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes for a snapshot, without the ensemble's fires."""
        return {**vars(self), "_processed": None, "_count": 0}

    def add_image(self, new: Observation) -> None:
        """Add an image, which must not be earlier than the previous input."""
        self._end_period_by(new.at_s, exclusive=True)
        self._images.append(new)
        self._end_period_by(new.at_s)

    def add_input(self, new: Observation | Lit | WeatherSet) -> None:
        """Add another input, which must not be earlier than the previous input."""
        at_s = _time_of(new)
        self._end_period_by(at_s)
        self._end_period(at_s)
        self._inputs.append(new)

    def add_late(self, new: Observation) -> None:
        """Insert an observation at its time, which may be earlier than that of other inputs.

        If later inputs have already been processed, the ensemble processes all inputs again.
        """
        if new.at_s >= self._last_s:
            self.add_input(new)
            return
        later = (number for number, each in enumerate(self._inputs) if _time_of(each) > new.at_s)
        place = next(later, len(self._inputs))
        self._inputs.insert(place, new)
        if self._mark is not None and place < self._mark.inputs:
            self._mark = self._mark._replace(inputs=self._mark.inputs + 1)
        if place < self._count:
            self._processed, self._count = None, 0

    def inputs_until(self, at_s: float) -> list[Input]:
        """Return the unprocessed inputs up to a given time.

        The result contains neither images of the current period nor later ignitions of the
        scenario.
        """
        self._end_period_by(at_s)
        self._add_due(at_s)
        return self._inputs[self._count :]

    def _end_period_by(self, at_s: float, exclusive: bool = False) -> None:
        """End the image period if it ends before ``at_s`` or, unless exclusive, at ``at_s``."""
        if not self._images:
            return
        end_s = math.ceil(self._images[0].at_s / IMAGES_PERIOD_S) * IMAGES_PERIOD_S
        if end_s < at_s or (end_s == at_s and not exclusive):
            self._end_period(end_s)

    def _end_period(self, at_s: float) -> None:
        self._add_due(at_s)
        self._last_s = at_s
        if self._images:
            self._inputs.append(Images(at_s, self._images))
            self._images = []

    def _add_due(self, at_s: float) -> None:
        """Add the scenario's ignitions, and empty periods, up to a given time."""
        while self._scheduled and self._scheduled[0].at_s <= at_s:
            self._inputs.append(self._scheduled.pop(0))
        while self._last_s + ADVANCED_EVERY_S <= at_s:
            self._last_s += ADVANCED_EVERY_S
            self._inputs.append(Images(self._last_s, ()))

    def is_long(self) -> bool:
        """Return whether ``forget_before_mark`` is due."""
        kept = 0 if self._mark is None else self._mark.inputs
        return len(self._inputs) - kept >= INPUTS_PER_MARK

    def forget_before_mark(self, fire: Fire) -> None:
        """Delete the inputs before the last mark, and set a new mark with this state of the fire.

        Without this, a long run's inputs would fill the memory. Their effect on the ensemble
        remains, but only until a restart of the service.
        """
        mark = self._mark
        if mark is not None:
            del self._inputs[: mark.inputs]
            self._begun_from = mark
            self._processed = None if self._count < mark.inputs else self._processed
            self._count = max(self._count - mark.inputs, 0)
        self._mark = _Mark(len(self._inputs), fire.weather, fire.time_s, fire.arrival_time_s.copy())

    def replace(self, before: "FireEstimate", after: "FireEstimate", count: int) -> None:
        """Replace the ensemble ``before`` with ``after`` unless it has already been replaced."""
        if self.processed is before:
            self._processed = after
            self._count += count


def new_estimate(
    scenario: Scenario,
    landscape: Landscape,
    weather: WeatherStream,
    burning: Burning | None = None,
) -> "FireEstimate":
    """Return an ensemble with a scenario's settings, and with an initial fire if there is one."""
    # Imports SciPy, which is slow; a run without forecasts needs no ensemble.
    from firemodel.assimilation.fire_estimate import EstimateSettings, FireEstimate

    return FireEstimate(
        landscape,
        weather,
        settings=EstimateSettings(
            scenario.estimate.members, scenario.seed, estimate_errors(scenario)
        ),
        burning=burning,
        closings=closings_of(scenario, landscape),
        **{each: getattr(scenario.fire, each) for each in SCHEMES["anyangle"].arguments},
    )


def processed(estimate: "FireEstimate", inputs: Sequence[Input]) -> "FireEstimate":
    """Return the ensemble after inputs in order of time; ``estimate`` is not modified."""
    found = estimate.copy()
    for each in inputs:
        match each:
            case Images():
                if found.begun:
                    found.advance(max(each.at_s, found.time_s))
                for image in each.seen:
                    _see(found, image)
            case Observation():
                _see(found, each)
            case Lit():
                found.light(each.cells, each.at_s)
            case WeatherSet():
                found.set_weather(each.weather, each.at_s)
    return found


def _see(estimate: "FireEstimate", seen: Observation) -> None:
    """Assimilate an observation; the first observed burned cells start the fire."""
    if estimate.begun:
        estimate.assimilate(seen)
        return
    row, col = np.nonzero(seen.state == BURNED)
    if row.size:
        cells = zip((row + seen.top).tolist(), (col + seen.left).tolist(), strict=True)
        estimate.light(list(cells), max(seen.at_s, 0.0))
