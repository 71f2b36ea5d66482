"""Classify heat that sensors observed as infrared interpreters do: intense, scattered, isolated.

The categories are those of NIROPS (National Infrared Operations) and of the NWCG event standard:
intense heat is a continuous area of burning ground, scattered heat an area with many separate heat
sources, and an isolated heat source a single one. An image in the journal shows for each cell
whether it has burned, not how hot it is. Therefore, ground counts as hot if an image from the last
hour shows it as burned at most half an hour after the estimated arrival of fire. Points that
sensors or people report as hot or burning in this hour count as heat everywhere.
"""

from typing import Any, NamedTuple

import numpy as np

from firemodel.arrays import Floats, Mask, window_at
from firemodel.assimilation.observation import BURNED, UNBURNED
from firemodel.landscape.landscape import Landscape
from mission_service.events import AnyEvent, FireObserved, Observed
from mission_service.fire.observed_window import states_in, without_speckles

INTENSE, SCATTERED = "IR Intense Heat", "IR Scattered Heat"
ISOLATED = "IR Isolated Heat Source"

LAST_S = 3600.0  # images from this period are used
GLOWING_S = 1800.0  # time for which ground is hot after the arrival of fire
INTENSE_CELLS = 6  # a connected group of at least this many hot cells is intense heat
SCATTERED_M, SCATTERED_SOURCES = 150.0, 3  # scattered: largest gap, smallest number of sources


class Heat(NamedTuple):
    """Hot ground by category, in the landscape's CRS (m)."""

    intense: list[Any]  # shapely polygons
    scattered: list[Any]  # shapely polygons
    isolated: list[Any]  # shapely points

    @property
    def is_empty(self) -> bool:
        """Whether no heat was observed."""
        return not (self.intense or self.scattered or self.isolated)


class ObservedHeat:
    """The cells and points that the sensors of a run observed as burned or hot."""

    def __init__(self, landscape: Landscape) -> None:
        self._landscape = landscape
        self._burned_s: Floats = np.full(
            landscape.shape, -np.inf
        )  # last time of an image with this burned cell
        self._points: list[tuple[float, float, float]] = []  # at_s, lat_deg, lon_deg
        self.first_s: float | None = None  # time of the first image
        self.last_s: float | None = None

    def apply(self, event: AnyEvent) -> None:
        """Process an event; only observations have an effect."""
        match event:
            case Observed(corrects=False, estimated=False, distrusted=False):
                self._add_image(event)
            case FireObserved(state="hot" | "burning", shape="points"):
                at_s = event.seen_at_us / 1e6
                self._points += [(at_s, lat, lon) for lat, lon in event.points]

    def _add_image(self, event: Observed) -> None:
        at_s = event.at_us / 1e6
        self.first_s = at_s if self.first_s is None else min(self.first_s, at_s)
        self.last_s = at_s if self.last_s is None else max(self.last_s, at_s)
        state = states_in(without_speckles(event).cells)
        here = self._burned_s[window_at(event.row, event.col, state.shape)]
        here[state == BURNED] = at_s
        here[state == UNBURNED] = -np.inf

    def heat(self, arrival_s: Floats, at_s: float) -> Heat:
        """Return the heat at the given time, using the estimated fire's arrival times (y, x)."""
        seen_s = self._burned_s
        hot = (seen_s >= at_s - LAST_S) & (seen_s <= at_s) & (seen_s - arrival_s <= GLOWING_S)
        places = [each[1:] for each in self._points if at_s - LAST_S <= each[0] <= at_s]
        return classified(hot, self._landscape.xy_of_places(places), self._landscape)


def classified(hot: Mask, points_m: Floats, landscape: Landscape) -> Heat:
    """Return hot cells (y, x) and hot points (n, 2; m) by category."""
    from scipy.ndimage import label
    from shapely import MultiPoint, Point, box, get_parts, union_all

    groups, count = label(hot, structure=np.ones((3, 3)))
    sizes = np.bincount(groups.ravel(), minlength=count + 1)
    large = np.flatnonzero(sizes >= INTENSE_CELLS)
    large = large[large != 0]
    half_m = landscape.cell_size_m / 2.0
    intense = []
    for group in large:
        x_m, y_m = landscape.xy_of(*np.nonzero(groups == group))
        squares = box(x_m - half_m, y_m - half_m, x_m + half_m, y_m + half_m)
        intense += [part for part in get_parts(union_all(squares)) if not part.is_empty]
    small = hot & ~np.isin(groups, large)
    x_m, y_m = landscape.xy_of(*np.nonzero(small))
    places = np.concatenate([np.column_stack([x_m, y_m]), points_m])
    whole = union_all(intense)
    sources = [Point(place) for place in places.tolist() if not whole.intersects(Point(place))]
    scattered, isolated = [], []
    reach = union_all([source.buffer(SCATTERED_M / 2.0) for source in sources])
    for part in get_parts(reach):
        inside = [source for source in sources if part.intersects(source)]
        if len(inside) >= SCATTERED_SOURCES:
            area = MultiPoint(inside).convex_hull.buffer(half_m, cap_style="square")
            scattered.append(area)
        else:
            isolated += inside
    return Heat(intense, scattered, isolated)
