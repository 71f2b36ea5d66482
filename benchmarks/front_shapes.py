"""Fronts of many shapes under ``informative``: ``benchmarks.front_shapes KIND FIRST LAST``.

One vehicle flies as in ``benchmarks.informative_routes`` over fires with wrong wind in the model.
Kinds: ``bay`` (a strip of slow fuel across the spread), ``fingers``, ``island``, ``merging`` (two
fires that merge), ``spots`` (a fire with three spot fires). The benchmark prints for each fire:

- error: the mean symmetric distance between the estimated and the true front in cells; beside it
  that of ``predictive``, which estimates one front on 360 bearings;
- age: for each true front (outer or inner) longer than 200 m, the longest time since a part of it
  was in view, divided by the duration of a tour of all these fronts at the vehicle's speed (their
  lengths, and twice the minimum spanning tree of the gaps between them). A new front counts from
  one tour after its appearance. The 95th percentile and the largest value are printed;
- path: the share of the flight along fronts that is more than 30 m from the estimated front, and
  the largest distance in m;
- legs: flights from front to front, and those that cross burned ground although the shortest way
  on a grid over unburned ground is less than 20 % longer.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import click
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion, label, maximum_filter
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree
from scipy.spatial.distance import cdist

from benchmarks.informative_routes import (
    Case,
    Flight,
    distances,
    each_fire,
    shaped_case,
    without_small_holes,
)
from mission_service.experiments.islam_hu.ideal_flight import IN_VIEW, REACH, fly
from mission_service.experiments.islam_hu.measured_wind import MeasuredWind
from mission_service.experiments.islam_hu.predictive_flight import predictive_planner

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

KINDS = ("bay", "fingers", "island", "merging", "spots")
MIN_FRONT_M = 200.0
NEAR_CELLS = 4  # a front cell is seen if ground within this distance of it is in view
OFF_PATH_M = 30.0
MAX_DETOUR = 0.2
# Shortest paths on a grid with 16 neighbours are up to 2.8 % too long.
GRID_TOO_LONG = 1.028
MIN_CROSSED_CELLS = 2.0
STEPS = ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1))


class ShapeResult(NamedTuple):
    """Results of one flight; ages are in tours, path distances in m."""

    name: str
    error_cells: float
    star_error_cells: float
    age_95: float
    age_most: float
    off_path: float
    path_most_m: float
    legs: int
    wrong_legs: int


class TrueFront(NamedTuple):
    """A true front: its cells (n, 2) and its length in cells."""

    cells: NDArray[np.int64]
    length_cells: float


def fronts_of(burned: Mask, cell_m: float) -> list[TrueFront]:
    """Return the outer and inner fronts that are longer than ``MIN_FRONT_M``."""
    burned = without_small_holes(burned)
    fires, fire_count = label(burned, np.ones((3, 3)))
    open_ground, open_count = label(~burned)
    outside = open_ground[0, 0]
    found = []
    for fire, ground in (
        *((fires == each, open_ground == outside) for each in range(1, fire_count + 1)),
        *((burned, open_ground == each) for each in range(1, open_count + 1) if each != outside),
    ):
        edge = fire & binary_dilation(ground)
        cells = np.argwhere(edge)
        length = _length_of(cells)
        if length * cell_m > MIN_FRONT_M:
            found.append(TrueFront(cells, length))
    return found


def _length_of(cells: NDArray[np.int64]) -> float:
    """Return the length of a line of cells: that of its minimum spanning tree."""
    if len(cells) < 2:
        return 0.0
    return float(minimum_spanning_tree(cdist(cells, cells)).sum())


def tour_cells(fronts: Sequence[TrueFront]) -> float:
    """Return the length of a tour of fronts: the fronts, and twice the gaps between them."""
    gaps = np.array([[cdist(a.cells, b.cells).min() for b in fronts] for a in fronts])
    between = 2.0 * float(minimum_spanning_tree(np.maximum(gaps, 1e-6)).sum())
    return sum(front.length_cells for front in fronts) + between


def around_cells(unburned: Mask, start: Floats, goal: Floats) -> float:
    """Return the length of the shortest way between two positions over unburned cells."""
    rows, cols = unburned.shape
    number = np.arange(unburned.size).reshape(unburned.shape)
    sources, targets, lengths = [], [], []
    for down, right in STEPS:
        top, left = slice(0, rows - down), slice(max(-right, 0), cols - max(right, 0))
        low, far = slice(down, rows), slice(max(right, 0), cols + min(right, 0))
        free = unburned[top, left] & unburned[low, far]
        sources.append(number[top, left][free])
        targets.append(number[low, far][free])
        lengths.append(np.full(int(free.sum()), math.hypot(down, right)))
    graph = coo_array(
        (np.concatenate(lengths), (np.concatenate(sources), np.concatenate(targets))),
        shape=(unburned.size, unburned.size),
    ).tocsr()
    begin, end = (_nearest_cell(unburned, place) for place in (start, goal))
    away = dijkstra(graph, directed=False, indices=number[begin])[number[end]]
    return float(away + math.dist(begin, start) + math.dist(end, goal))


def _nearest_cell(unburned: Mask, place: Floats) -> tuple[int, int]:
    cells = np.argwhere(unburned)
    row, col = cells[int(np.hypot(*(cells - place).T).argmin())]
    return int(row), int(col)


def crossed_cells(burned: Mask, start: Floats, goal: Floats) -> float:
    """Return the length of a straight leg over burned cells that are not at a front."""
    inside = binary_erosion(burned)
    count = max(int(math.dist(start, goal) * 4), 1)
    places = np.rint(np.linspace(start, goal, count)).astype(int)
    places = places[((places >= 0) & (places < burned.shape[0])).all(axis=1)]
    return float(inside[places[:, 0], places[:, 1]].sum()) / 4.0


class ShapedFlight(Flight):
    """A flight of ``informative`` that is compared with the true fronts at each minute."""

    def __init__(self, case: Case) -> None:
        super().__init__(case, laps=False)
        self.seen_at_s: Floats = np.full(case.truth.arrival_s.shape, self.at_s)
        self.ages: list[float] = []
        self.path_cells: list[float] = []
        self.legs = self.wrong_legs = 0
        self._between = False

    def _observe(self) -> None:
        super()._observe()
        row, col = (round(value) for value in self.place)
        rows, cols = (np.argwhere(IN_VIEW) + np.array([row - REACH, col - REACH])).T
        inside = (rows >= 0) & (cols >= 0)
        inside &= (rows < self.seen_at_s.shape[0]) & (cols < self.seen_at_s.shape[1])
        self.seen_at_s[rows[inside], cols[inside]] = self.at_s

    def _move(self) -> None:
        super()._move()
        between = self.planner.goal is not None
        if between and not self._between:
            self._check_leg()
        self._between = between
        if not between and self.planner.phase == "monitor":
            self.path_cells.append(self.planner.distance_to_front(*self.place))

    def _check_leg(self) -> None:
        """Count a leg that begins, and whether it should lead around burned ground."""
        self.legs += 1
        burned = without_small_holes(self.estimate.fire.burned())
        start, goal = self.place, self.planner.goal
        assert goal is not None
        crossed = sum(crossed_cells(burned, *each) for each in _steps_to(self.path, start, goal))
        if crossed > MIN_CROSSED_CELLS:
            around = around_cells(~binary_erosion(burned), start, goal) / GRID_TOO_LONG
            self.wrong_legs += around < (1.0 + MAX_DETOUR) * math.dist(start, goal)

    def _errors(self) -> tuple[tuple[float, float], ...]:
        truth = self.case.truth
        fronts = fronts_of(truth.burned(self.at_s), truth.landscape.cell_size_m)
        tour_s = tour_cells(fronts) * truth.landscape.cell_size_m / truth.speed_m_s
        near_s = maximum_filter(self.seen_at_s, 2 * NEAR_CELLS + 1)
        # A front counts from one tour after its begin.
        older = truth.burned(self.at_s - tour_s)
        for front in fronts:
            rows, cols = front.cells.T
            if older[max(rows.min() - 1, 0) : rows.max() + 2, cols.min() : cols.max() + 1].any():
                self.ages.append(float(self.at_s - near_s[rows, cols].min()) / tour_s)
        return super()._errors()


def _steps_to(path: Floats, start: Floats, goal: Floats) -> Iterator[tuple[Floats, Floats]]:
    """Yield the straight parts of a path until the point nearest to the goal."""
    end = int(np.hypot(*(path - goal).T).argmin())
    places = [start, *path[: end + 1]]
    yield from pairwise(places)


def star_error(case: Case) -> float:
    """Return the mean symmetric distance of the front that ``predictive`` estimates, in cells."""
    truth = case.truth
    planner = predictive_planner(case.model)
    rows, cols = np.indices(truth.arrival_s.shape)
    found: list[float] = []
    due_s = truth.deploy_s + 900.0

    def compare(at_s: float, row: int, col: int) -> None:
        nonlocal due_s
        if at_s < due_s or planner.phase != "monitor":
            return
        due_s = at_s + 60.0
        north, east = planner.map.centre_row - rows, cols - planner.map.centre_col
        bearing = np.rint(np.degrees(np.arctan2(east, north))).astype(int) % 360
        estimated = np.hypot(north, east) <= planner.shape(row, col)[bearing]
        found.append(distances(estimated, truth.burned(at_s))[0])

    measured = MeasuredWind(case.model.weather, 1)
    fly(truth, planner, hull=False, measured=measured, before=compare)
    return float(np.mean(found))


def flown(kind: str, seed: int) -> ShapeResult:
    """Return the results of one fire."""
    case = shaped_case(kind, seed)
    flight = ShapedFlight(case)
    errors, *_ = flight.run()
    away_m = np.array(flight.path_cells) * case.truth.landscape.cell_size_m
    return ShapeResult(
        case.name,
        errors.mean,
        star_error(case),
        float(np.percentile(flight.ages, 95)),
        max(flight.ages),
        float((away_m > OFF_PATH_M).mean()),
        float(away_m.max()),
        flight.legs,
        flight.wrong_legs,
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the results of each fire, and their means and maxima."""
    results: list[ShapeResult] = []
    header = "fire: error / of predictive; age 95 %/most; off path, most m; legs, wrong"
    for found in each_fire(__doc__, KINDS, flown, header, arguments):
        results.append(found)
        click.echo(
            f"{found.name:12} {found.error_cells:5.2f}/{found.star_error_cells:5.2f}  "
            f"age {found.age_95:.2f}/{found.age_most:.2f}  "
            f"path {found.off_path:6.2%} {found.path_most_m:4.0f} m  "
            f"legs {found.legs:3} {found.wrong_legs}"
        )
    ratios = [each.error_cells / each.star_error_cells for each in results]
    click.echo(
        f"error / predictive: mean {np.mean(ratios):.2f}, worst {max(ratios):.2f}; "
        f"age: 95 % {np.mean([each.age_95 for each in results]):.2f}, "
        f"most {max(each.age_most for each in results):.2f}; "
        f"off path {np.mean([each.off_path for each in results]):.2%}; "
        f"wrong legs {sum(each.wrong_legs for each in results)} "
        f"of {sum(each.legs for each in results)}"
    )


if __name__ == "__main__":
    main()
