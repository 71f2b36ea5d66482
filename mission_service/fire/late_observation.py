"""Bring a fire in line with an observation of an earlier time. Pure."""

from collections.abc import Callable

import numpy as np

from firemodel.arrays import Floats, Mask
from firemodel.assimilation.observation import Observation
from firemodel.assimilation.written_image import with_image
from firemodel.physics.weather import WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.burning import burning_from_arrival
from firemodel.spread.fire_scheme import Burning, Fire

Begin = Callable[[Burning | None, WeatherStream, float], Fire]
EQUAL_S = 1.0  # smaller differences of arrival times are rounding


def with_observation(fire: Fire, seen: Observation, unburnable: Mask, begin: Begin) -> Fire:
    """Return a fire at its present time with an observation in it; ``fire`` itself if they agree.

    The fire is simulated twice from the time of the observation to the present, with and without
    the observed change. Only arrival times that differ are changed. Elsewhere the fire keeps its
    progress within the cells, which a restart would lose.

    Args:
        fire: The fire; it is not changed.
        seen: The observation; its time may be earlier than that of the fire, but not later.
        unburnable: (y, x) the cells of the grid that cannot burn.
        begin: Starts a fire from its state (None if nothing has burned) and weather at a time.
    """
    cell_m, arrival_s = fire.landscape.cell_size_m, fire.expected_s()
    late = fire if isinstance(fire, AnyAngleFire) and seen.at_s < fire.time_s else None
    known_s = arrival_s if late is None else np.where(arrival_s <= seen.at_s, arrival_s, np.inf)
    found = with_image(known_s, seen.where, seen.state, seen.at_s, cell_m, unburnable)
    if found is None:
        return fire
    new_s, changed = found
    if late is not None:
        without_s, with_s = (_burned_on(each, seen.at_s, late) for each in (known_s, new_s))
        sooner, later = with_s < without_s - EQUAL_S, with_s > without_s + EQUAL_S
        new_s = np.where(sooner, np.minimum(arrival_s, with_s), np.where(later, with_s, arrival_s))
        changed = new_s != arrival_s
    return rewritten(fire, new_s, changed, begin)


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


def _burned_on(arrival_s: Floats, at_s: float, fire: AnyAngleFire) -> Floats:
    """Return arrival times (y, x) until the present, for a fire with ``arrival_s`` at ``at_s``."""
    if not (arrival_s <= at_s).any():
        return np.full(arrival_s.shape, np.inf)
    found = fire.restarted(burning_from_arrival(arrival_s, fire.landscape, at_s))
    found.advance(fire.time_s)
    return found.expected_s()
