"""Correct a cellular fire using operators' drawings, erasures, undo and wind reports.

The fire without corrections is simulated in parallel, so that it can be restored by an undo. After
each correction, the corrected fire is restarted at the time of the correction, from corrected
arrival times. If there are more than ``MAX_STEPS`` corrections and erasures, the older half becomes
part of the fire without corrections, is no longer listed and cannot be undone.
"""

import copy
from collections.abc import Callable, Sequence

import msgspec
import numpy as np

from firemodel.arrays import Floats
from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.burning import burning_from_arrival
from firemodel.spread.fire_scheme import Burning, Fire
from mission_service.events import AnyOperatorEvent, Corrected, Erased, Redone, Undone, WindSet
from mission_service.fire.correction_log import (
    CorrectionLog,
    Held,
    observations_held,
    observations_of_correction,
)
from mission_service.fire.late_observation import Begin
from mission_service.fire.reported_observations import observation_of

AHEAD_S = 3600.0  # before a fit, the fire is forecast this far for observations ahead of it
OBSERVATION_SPACING_CELLS = 1.0
MAX_STEPS = 256  # the computing time of a correction grows with the number of observations
MAX_OBSERVATIONS = 150  # the computing time of a fit grows with the cube of this number


class CorrectedFire:
    """The corrections of a fire from operators' reports.

    ``begin`` starts a fire at a time, from its state (None if nothing has burned) and weather.
    """

    def __init__(self, landscape: Landscape, begin: Begin) -> None:
        self.log = CorrectionLog()
        self._landscape = landscape
        self._begin = begin
        self._spacing_m = OBSERVATION_SPACING_CELLS * landscape.cell_size_m
        # The fire without corrections; None while there are no corrections.
        self._base: Fire | None = None

    def copy(self) -> "CorrectedFire":
        """Return an independent copy."""
        found = copy.copy(self)  # ``apply_report`` replaces the log and does not modify it
        found._base = None if self._base is None else self._base.copy()
        return found

    @property
    def is_corrected(self) -> bool:
        """Whether the fire differs from the fire without corrections."""
        return self._base is not None

    def check_report(self, event: AnyOperatorEvent) -> None:
        """Raise FireModelError for a report that has no effect or an unusable shape."""
        self.log.refuse_no_effect(event)
        if isinstance(event, Corrected):
            observations_of_correction(event, self._landscape, self._spacing_m)

    def change(self, fire: Fire, change: Callable[[Fire], Fire]) -> Fire:
        """Apply a change to the fire and to the fire without corrections; return the changed fire.

        Each ignition and each image is such a change.
        """
        if self._base is not None:
            self._base = change(self._base_at(fire))
        return change(fire)

    def apply_report(self, event: AnyOperatorEvent, fire: Fire) -> Fire:
        """Apply a report; return the changed fire, or ``fire`` itself if nothing changes.

        Raises FireModelError, and changes nothing, for a report that is invalid or has no effect.
        """
        match event:
            case WindSet():
                # A restarted fire needs no earlier weather, so the stream stays short in long runs.
                stream = fire.weather.blown(event.speed_m_s, event.from_deg, fire.time_s)
                stream = stream.since(fire.time_s)
                if self._base is None:
                    return self._in_weather(fire, stream)
                base = self._in_weather(self._base_at(fire), stream)
                try:
                    found = self._set_right(base, self.log.held())
                except FireModelError:  # nothing or everything burns; the wind changes nevertheless
                    found = self._in_weather(fire, stream)
                self._base = base
                return found
            case Corrected() | Erased() | Undone() | Redone():
                self.log.refuse_no_effect(event)
                log = copy.deepcopy(self.log)
                log.apply(event)
                base = self._base_at(fire)
                if len(log.steps) > MAX_STEPS:
                    base = self._set_right(base, log.settle(MAX_STEPS // 2))
                found = self._set_right(base, log.held())
                self.log, self._base = log, None if found is base else base
                return found
            case _:
                return fire

    def _in_weather(self, fire: Fire, stream: WeatherStream) -> Fire:
        """Return a fire that continues in other weather."""
        if isinstance(fire, AnyAngleFire):  # a restart would lose progress within the cells
            model = self._begin(None, stream, fire.time_s)
            assert isinstance(model, AnyAngleFire)
            return fire.continued(model)
        return self._begin(burning_now(fire), stream, fire.time_s)

    def _base_at(self, fire: Fire) -> Fire:
        """Return the fire without corrections at the time of ``fire``."""
        if self._base is None:
            return fire
        self._base.advance(fire.time_s)
        return self._base

    def _set_right(self, base: Fire, held: Sequence[Held]) -> Fire:
        """Return the corrected fire, or ``base`` itself if the corrections have no observation."""
        observations = thinned(observations_held(held, self._landscape, self._spacing_m))
        if not len(observations):
            return base
        ahead = copy.deepcopy(base)
        ahead.advance(base.time_s + AHEAD_S)
        # Importing SciPy is slow.
        from firemodel.assimilation.corrected_cells import corrected_arrival

        arrival_s = ahead.arrival_time_s
        if np.isfinite(arrival_s).any():
            arrival_s = corrected_arrival(arrival_s, self._landscape, observations)
        arrival_s = as_drawn(arrival_s, held, self._landscape)
        burning = burning_from_arrival(arrival_s, self._landscape, base.time_s)
        return self._begin(burning, base.weather, base.time_s)


def thinned(observations: Floats) -> Floats:
    """Return at most ``MAX_OBSERVATIONS`` evenly chosen rows of observations (n, 4).

    This number of observations is enough to correct the surrounding fire; ``as_drawn`` sets all
    drawn cells exactly.
    """
    if len(observations) <= MAX_OBSERVATIONS:
        return observations
    return observations[
        np.round(np.linspace(0, len(observations) - 1, MAX_OBSERVATIONS)).astype(np.int64)
    ]


def burning_now(fire: Fire) -> Burning | None:
    """Return the burning state of a fire at its current time, or None if nothing has burned."""
    if not fire.burned().any():
        return None
    return burning_from_arrival(fire.arrival_time_s, fire.landscape, fire.time_s)


def drawn_at_s(held: Sequence[Held], landscape: Landscape) -> Floats:
    """Return the latest time (y, x) for which each cell was drawn; -infinity if it never was."""
    found = np.full(landscape.shape, -np.inf)
    for each in held:
        drawn = observation_of(each.correction, landscape, each.erasures)
        part = found[drawn.where]
        part[drawn.state != UNSEEN] = np.maximum(part[drawn.state != UNSEEN], drawn.at_s)
    return found


def as_drawn(arrival_s: Floats, held: Sequence[Held], landscape: Landscape) -> Floats:
    """Return arrival times (y, x) in which every drawn cell has exactly the drawn state.

    A fit weighs the observations against each other and against the model, but a drawn cell counts
    as certain. Later corrections override earlier ones. The outline of a burning area burns at the
    time of the correction, and all cells inside have burned by then.
    """
    found = arrival_s.copy()
    for each in held:
        drawn = observation_of(each.correction, landscape, each.erasures)
        part, at_s = found[drawn.where], drawn.at_s
        burned, unburned = drawn.state == BURNED, drawn.state == UNBURNED
        part[unburned] = np.maximum(part[unburned], np.nextafter(at_s, np.inf))
        part[burned] = np.minimum(part[burned], at_s)
        if each.correction.state == "burning":
            front = observation_of(outline_of(each.correction), landscape, each.erasures)
            found[front.where][front.state == BURNED] = at_s
    return found


def outline_of(correction: Corrected) -> Corrected:
    """Return the outline of an area as a line, and any other correction unchanged."""
    if correction.shape != "polygon":
        return correction
    points = (*correction.points, correction.points[0])
    return msgspec.structs.replace(correction, shape="line", points=points)
