"""Keep track of the corrections in effect after drawing, erasing, undo and redo. Pure."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from firemodel.assimilation.map_drawing import observations_of
from firemodel.ellipses.point_observations import BURNED, BURNING, UNBURNED
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.events import AnyEvent, Corrected, Erased, FireObserved, Redone, Undone
from mission_service.ground_distance import distance_m

Step = Corrected | Erased
Floats = NDArray[np.float64]
STATES = {"burned": BURNED, "burning": BURNING, "unburned": UNBURNED}


class Held(NamedTuple):
    """A correction that is in effect outside the circles of all later ``erasures``."""

    correction: Corrected
    erasures: tuple[Erased, ...]


class CorrectionLog:
    """The steps in effect and the undone steps, shared by all operators.

    A step is a correction or an erasure. An erasure removes only earlier corrections. Undo reverts
    the last step, and redo restores the last undone step. A new step clears the undone steps.
    Without a step to undo or to redo, undo and redo have no effect.
    """

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self.taken_back: list[Step] = []  # undone steps, in the order of undo

    def refuse_no_effect(self, event: AnyEvent) -> None:
        """Raise FireModelError if there is no step to undo or redo or no correction to erase."""
        match event:
            case Undone() if not self.steps:
                raise FireModelError("nothing to undo")
            case Redone() if not self.taken_back:
                raise FireModelError("nothing to redo")
            case Erased() if not self.held():
                raise FireModelError("no correction to erase")

    def apply(self, event: AnyEvent) -> bool:
        """Process an event; return whether the corrections in effect have changed."""
        match event:
            case Corrected() | Erased():
                self.steps.append(event)
                self.taken_back.clear()
                return True
            case Undone() if self.steps:
                self.taken_back.append(self.steps.pop())
                return True
            case Redone() if self.taken_back:
                self.steps.append(self.taken_back.pop())
                return True
            case _:
                return False

    def held(self) -> tuple[Held, ...]:
        """Return the corrections in effect, in drawing order and without erased points."""
        found: list[Held] = []
        erasures: tuple[Erased, ...] = ()
        for step in reversed(self.steps):
            if isinstance(step, Erased):
                erasures = (step, *erasures)
            elif not _is_erased(step, erasures):
                found.append(Held(step, erasures))
        return tuple(reversed(found))

    def settle(self, count: int) -> tuple[Held, ...]:
        """Remove the first ``count`` steps; return their corrections that are in effect."""
        settled = {id(step) for step in self.steps[:count]}
        found = tuple(each for each in self.held() if id(each.correction) in settled)
        del self.steps[:count]
        return found

    def status(self) -> list[dict[str, Any]]:
        """Return the state, shape, operator, station and times of each correction in effect."""
        return [
            {
                "state": held.correction.state,
                "shape": held.correction.shape,
                "points": held.correction.points,
                "marked_at_s": held.correction.marked_at_us / 1e6,
                "by": held.correction.by,
                "station": held.correction.station,
                "at_s": held.correction.at_us / 1e6,
                "erasures": len(held.erasures),
            }
            for held in self.held()
        ]


def drawn_shape(report: Corrected | FireObserved, landscape: Landscape) -> BaseGeometry:
    """Return a report's points, line or polygon in the landscape's CRS."""
    places_m = landscape.xy_of_places(report.points)
    match report.shape:
        case "line":
            return shapely.LineString(places_m)
        case "polygon":
            islands = getattr(report, "islands", ())
            return shapely.Polygon(places_m, [landscape.xy_of_places(each) for each in islands])
        case "point" | "points":
            return shapely.MultiPoint(places_m)


def observations_of_correction(
    correction: Corrected, landscape: Landscape, spacing_m: float
) -> Floats:
    """Return the observations (n, 4) that a correction represents: x, y, at_s and state.

    Raises FireModelError for a shape that cannot be used.
    """
    places = landscape.xy_of_places(correction.points)
    at_s, state = correction.marked_at_us / 1e6, STATES[correction.state]
    return observations_of(correction.shape, places, at_s, state, spacing_m)


def observations_held(held: Sequence[Held], landscape: Landscape, spacing_m: float) -> Floats:
    """Return the observations (n, 4) of all corrections in effect, without erased observations."""
    found = [np.empty((0, 4))]
    for each in held:
        observations = observations_of_correction(each.correction, landscape, spacing_m)
        found.append(observations[not_erased(observations[:, :2], each.erasures, landscape)])
    return np.vstack(found)


def not_erased(
    places_m: Floats, erasures: Sequence[Erased], landscape: Landscape
) -> NDArray[np.bool_]:
    """Return the mask (n,) of the positions (n, 2) that lie outside the circles of all erasures."""
    places = zip(*landscape.lat_lon_of(places_m[:, 0], places_m[:, 1]), strict=True)
    return np.array(
        [not any(erases(erasure, *place) for erasure in erasures) for place in places], dtype=bool
    )


def erases(erasure: Erased, lat_deg: float, lon_deg: float) -> bool:
    """Return whether a position lies within the circle of an erasure."""
    middle = (erasure.lat_deg, erasure.lon_deg)
    return distance_m(middle, (lat_deg, lon_deg)) <= erasure.radius_m


def _is_erased(correction: Corrected, erasures: tuple[Erased, ...]) -> bool:
    """Return whether a correction is an erased point; a line or polygon is never fully erased."""
    return correction.shape == "point" and all(
        any(erases(erasure, *place) for erasure in erasures) for place in correction.points
    )
