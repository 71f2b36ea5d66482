"""A cellular fire that people set right: pens, eraser, undo, and another wind.

The fire without corrections burns on beside the corrected one, so that an undo brings it back.
Whatever changes, the corrected fire is begun again at that moment from arrival times set right.
Of more than ``MAX_STEPS`` corrections and erasures the older half is settled: it becomes part of
the fire without corrections, is no longer listed and can no longer be undone.
"""

import copy
from collections.abc import Callable, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from firemodel.landscape.landscape import Landscape
from firemodel.landscape.rasterise import cells_of
from firemodel.physics.weather import WeatherStream
from firemodel.spread.burning import burning_from_arrival
from firemodel.spread.fire import Burning, Fire
from mission_service.events import (
    Corrected,
    CrewEvent,
    Erased,
    Redone,
    Undone,
    WindTold,
)
from mission_service.fire.correction_log import CorrectionLog, Held, marks_held, not_erased

Floats = NDArray[np.float64]

AHEAD_S = 3600.0  # what the fire does so far ahead tells how marks there reach back
MARKS_APART_CELLS = 1.0
MAX_STEPS = 256  # the time of a correction grows with the marks to fit

MOST_MARKS = 150  # a fit takes as long as the cube of their number

Begin = Callable[[Burning, WeatherStream], Fire]


class CorrectedFire:
    """Folds what people say into fires begun again; ``begin`` makes one from what burns."""

    def __init__(self, landscape: Landscape, begin: Begin) -> None:
        self.log = CorrectionLog()
        self._landscape = landscape
        self._begin = begin
        self._base: Fire | None = None  # without corrections, while there are some

    def all_of(self, fire: Fire) -> list[Fire]:
        """The fire, and the one without corrections: what is lit burns in both."""
        if self._base is None:
            return [fire]
        self._base.advance(fire.time_s)
        return [fire, self._base]

    def told(self, event: CrewEvent, fire: Fire) -> Fire:
        """The fire from now on; the same object if nothing has changed.

        Raises FireModelError for what cannot be; nothing is changed then.
        """
        match event:
            case WindTold():
                # A restarted fire needs no earlier weather, so the stream stays short for weeks.
                stream = fire.weather.blown(event.speed_m_s, event.from_deg, fire.time_s)
                stream = stream.since(fire.time_s)
                if self._base is None:
                    return self._begin(burning_now(fire), stream)
                self._base.advance(fire.time_s)
                base = self._begin(burning_now(self._base), stream)
                found, self._base = self._set_right(base, self.log.held()), base
                return found
            case Corrected() | Erased() | Undone() | Redone():
                log = copy.deepcopy(self.log)
                if not log.take(event):
                    return fire
                base = self.all_of(fire)[-1]
                if len(log.steps) > MAX_STEPS:
                    base = self._set_right(base, log.settle(MAX_STEPS // 2))
                found = self._set_right(base, log.held())
                self.log, self._base = log, None if found is base else base
                return found
            case _:
                return fire

    def _set_right(self, base: Fire, held: Sequence[Held]) -> Fire:
        """A fire with what holds of corrections; the same object where nothing does."""
        spacing_m = MARKS_APART_CELLS * self._landscape.cell_size_m
        marks = few_of(marks_held(held, self._landscape, spacing_m))
        if not len(marks):
            return base
        ahead = copy.deepcopy(base)
        ahead.advance(base.time_s + AHEAD_S)
        from firemodel.assimilation.corrected_cells import corrected_arrival  # SciPy takes a while

        arrival_s = corrected_arrival(ahead.arrival_time_s, self._landscape, marks)
        arrival_s = as_drawn(arrival_s, held, self._landscape)
        burning = burning_from_arrival(arrival_s, self._landscape, base.time_s)
        return self._begin(burning, base.weather)


def few_of(marks: Floats) -> Floats:
    """``MOST_MARKS`` of marks (n, 4) at most, evenly: enough to set the fire around them right.

    The cells that were drawn are as they were drawn all the same (``as_drawn``).
    """
    if len(marks) <= MOST_MARKS:
        return marks
    return marks[np.round(np.linspace(0, len(marks) - 1, MOST_MARKS)).astype(np.int64)]


def burning_now(fire: Fire) -> Burning:
    """What burns of a fire at its time."""
    return burning_from_arrival(fire.arrival_time_s, fire.landscape, fire.time_s)


def as_drawn(arrival_s: Floats, held: Sequence[Held], landscape: Landscape) -> Floats:
    """Arrival times (y, x) with the cells that were drawn as they were drawn, to the letter.

    A fit weighs marks against each other and the model; who has drawn over a cell means that cell.
    Later strokes are over earlier ones. Of an area that burns only its edge is meant.
    """
    found = arrival_s.copy()
    for each in held:
        cells = _cells_drawn(each, landscape)
        at_s, there = each.correction.marked_at_us / 1e6, tuple(cells.T)
        match each.correction.state:
            case "unburned":
                found[there] = np.maximum(found[there], np.nextafter(at_s, np.inf))
            case "burned":
                found[there] = np.minimum(found[there], at_s)
            case _:
                found[there] = at_s
    return found


def _cells_drawn(held: Held, landscape: Landscape) -> NDArray[np.int32]:
    """The cells (n, 2) of a stroke, less those that were erased."""
    told = held.correction
    places = landscape.xy_of_places(told.points)
    shape: BaseGeometry = shapely.Point(places[0])
    if told.shape == "line":
        shape = shapely.LineString(places)
    elif told.shape == "polygon":
        area = shapely.Polygon(places)
        shape = area.exterior if told.state == "burning" else area
    cells = cells_of([shape], landscape)
    centres_m = np.column_stack(landscape.xy_of(*cells.T.astype(float)))
    return cells[not_erased(centres_m, held.erasures, landscape)]
