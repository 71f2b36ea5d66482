"""Change a fire to agree with an observation from an earlier time. Pure."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from firemodel.arrays import Floats, Mask
from firemodel.assimilation.observation import Observation
from firemodel.assimilation.written_image import with_image
from firemodel.physics.weather import WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.burning import burning_from_arrival
from firemodel.spread.fire_scheme import Burning, Fire
from firemodel.spread.probabilistic import ProbabilisticFire
from mission_service.requests import MAX_AGE_S

Begin = Callable[[Burning | None, WeatherStream, float], Fire]
WINDS_APART_S = 60.0  # minimum interval between wind reports stored for late observations
EQUAL_S = 1.0  # smaller differences in arrival times are rounding errors


def with_observation(
    fire: Fire, seen: Observation, unburnable: Mask, begin: Begin, weather: WeatherStream
) -> Fire:
    """Return a fire after an observation; ``fire`` itself if both agree.

    The fire is simulated twice from the time of the observation to the present, with and without
    the observed change. Only arrival times that differ are changed. Elsewhere the fire keeps its
    progress within the cells, which a restart would lose. The result has the time of ``fire``.

    Args:
        fire: The fire; it is not modified.
        seen: The observation; its time may be earlier than that of the fire, but not later.
        unburnable: The grid cells (y, x) that cannot burn.
        begin: Starts a fire from its state (None if nothing has burned) and weather at the given
            time.
        weather: The weather since the time of the observation; the fire's weather may begin later.
    """
    cell_m, arrival_s = fire.landscape.cell_size_m, fire.expected_s()
    is_late = seen.at_s < fire.time_s
    known_s = np.where(arrival_s <= seen.at_s, arrival_s, np.inf) if is_late else arrival_s
    found = with_image(known_s, seen.where, seen.state, seen.at_s, cell_m, unburnable)
    if found is None:
        return fire
    new_s, changed = found
    if is_late:
        new_s = _burned_on(fire, known_s, new_s, seen.at_s, _Past(fire, weather, begin))
        changed = new_s != arrival_s
    return rewritten(fire, new_s, changed, begin)


class _Past:
    """Simulates fires from earlier times to the current time of a fire."""

    def __init__(self, fire: Fire, weather: WeatherStream, begin: Begin) -> None:
        self._fire, self._weather, self._begin = fire, weather, begin
        self._model: AnyAngleFire | None = None  # shares its tables with the fires
        if isinstance(fire, AnyAngleFire):
            self._model = fire
            if weather is not fire.weather:
                model = begin(None, weather, fire.time_s)
                assert isinstance(model, AnyAngleFire)
                self._model = model

    def burned_on(self, arrival_s: Floats, at_s: float) -> Floats:
        """Continue a fire with these arrival times (y, x) from ``at_s`` to the current time."""
        if not (arrival_s <= at_s).any():
            return np.full(arrival_s.shape, np.inf)
        burning = burning_from_arrival(arrival_s, self._fire.landscape, at_s)
        if self._model is None:
            found = self._begin(burning, self._weather, at_s)
        else:
            found = self._model.restarted(burning)
        found.advance(self._fire.time_s)
        return found.expected_s()


def _burned_on(fire: Fire, known_s: Floats, new_s: Floats, at_s: float, past: _Past) -> Floats:
    """Return a fire's arrival times (y, x) after a change of its state at ``at_s``.

    Args:
        fire: The fire at the current time.
        known_s: (y, x) the fire's arrival times until ``at_s``.
        new_s: (y, x) these times after the change.
        at_s: The time of the change.
        past: Simulates the fires to the current time.
    """
    arrival_s = fire.expected_s()
    if isinstance(fire, ProbabilisticFire):
        # Two random fires differ everywhere, so only the changed cells are re-simulated.
        before, after = known_s <= at_s, new_s <= at_s
        added_s = past.burned_on(np.where(after & ~before, new_s, np.inf), at_s)
        found = np.minimum(arrival_s, added_s)
        removed = before & ~after
        return np.where(removed, past.burned_on(new_s, at_s), found) if removed.any() else found
    without_s, with_s = past.burned_on(known_s, at_s), past.burned_on(new_s, at_s)
    sooner, later = with_s < without_s - EQUAL_S, with_s > without_s + EQUAL_S
    return np.where(sooner, np.minimum(arrival_s, with_s), np.where(later, with_s, arrival_s))


def with_wind(past: WeatherStream, speed_m_s: float, from_deg: float, at_s: float) -> WeatherStream:
    """Return the weather of the last hours including a wind report, for late observations.

    Of wind reports within ``WINDS_APART_S``, the result contains only the last.
    """
    found = past.blown(speed_m_s, from_deg, at_s).since(at_s - MAX_AGE_S)
    if len(found.entries) > 2 and at_s - found.entries[-2].at_s < WINDS_APART_S:
        *others, before, last = found.entries
        found = WeatherStream((*others, replace(last, at_s=before.at_s)))
    return found


def rewritten(fire: Fire, arrival_s: Floats, changed: Mask, begin: Begin) -> Fire:
    """Return a fire with other arrival times (y, x) in the cells ``changed``."""
    if not changed.any():
        return fire
    if not (arrival_s <= fire.time_s).any():
        return begin(None, fire.weather, fire.time_s)
    if isinstance(fire, AnyAngleFire):
        return fire.rewritten(arrival_s, changed)
    burning = burning_from_arrival(arrival_s, fire.landscape, fire.time_s)
    return begin(burning, fire.weather, fire.time_s)
