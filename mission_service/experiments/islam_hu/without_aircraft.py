"""Errors of the fronts expected without any aircraft: persistence, and the model alone."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from firemodel.physics.weather import WeatherStream
from mission_service.experiments.fires import Burn, burn
from mission_service.replay.distance_error import TrueShape

Floats = NDArray[np.float64]


def front_errors(expected: Burn, fire: Burn, at_s: Floats) -> Floats:
    """Return the distance errors of an expected front: (k times, 360 bearings), in cells.

    The distances are those from the ignition of ``fire`` at each bearing in whole degrees.
    """
    shapes = [TrueShape(each.arrival_s, fire.ignition) for each in (expected, fire)]
    each = [[shape.distances_at(time_s) for time_s in at_s.tolist()] for shape in shapes]
    return np.abs(np.array(each[0]) - np.array(each[1]))


def persistent(fire: Burn) -> Burn:
    """Return a fire whose front remains where it is at deployment."""
    arrival_s = np.where(fire.burned(fire.deploy_s), fire.arrival_s, np.inf)
    return replace(fire, arrival_s=arrival_s)


def modelled(fire: Burn) -> Burn:
    """Return the fire that the model ``anyangle`` computes with the weather at the ignition."""
    weather = WeatherStream(fire.weather.entries[:1])
    return burn(
        *(f"model of {fire.name}", "anyangle", fire.landscape, weather),
        *(fire.ignition, fire.end_s, fire.speed_m_s, fire.deploy_s),
    )
