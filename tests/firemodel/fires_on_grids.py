"""Small fires in even grass without wind, for tests of geometry."""

from collections.abc import Sequence

import numpy as np

from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire

CELL_M = 30.0


def grass(cells: int, unburnable: np.ndarray | None = None) -> Landscape:
    """Return level short grass, with bare ground in the mask ``unburnable`` (y, x)."""
    fuel = np.full((cells, cells), 1, np.int16)
    if unburnable is not None:
        fuel[unburnable] = 99
    return Landscape("EPSG:32611", 5e5, 4e6, CELL_M, fuel, np.zeros(fuel.shape, np.float32))


def calm() -> WeatherStream:
    """Return dry weather without wind."""
    return WeatherStream([Weather(0.0, 0.0, 0.0, 5.0, 6.0, 7.0, 60.0, 90.0)])


def even_fire(
    cells: int,
    *places: tuple[int, int],
    until_s: float = 0.0,
    unburnable: np.ndarray | None = None,
) -> AnyAngleFire:
    """Return a fire from cells (row, column), after a time or with a radius of 13 cells."""
    return _burned(grass(cells, unburnable), places, until_s)


def _burned(
    landscape: Landscape, places: Sequence[tuple[int, int]], until_s: float
) -> AnyAngleFire:
    fire = AnyAngleFire(landscape, calm(), [(*place, 0.0) for place in places])
    if until_s:
        fire.advance(until_s)
        return fire
    row, col = places[0]
    while not fire.burned()[row, col - 13]:
        fire.advance(fire.time_s + 600.0)
    return fire
