"""What every spread scheme has in common: one burning fire, its states and its front."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.physics.fuels import NON_BURNABLE
from firemodel.physics.weather import WeatherStream
from firemodel.spread.front import earliest_neighbour, front_polygons, multipolygon, neighbours_of

UNBURNED, BURNING, BURNED, CANNOT_BURN = 0, 1, 2, 3

Floats = NDArray[np.float64]
Ignition = tuple[int, int, float]  # row, column, time in s


class Burning(NamedTuple):
    """A fire that is already there when the model takes over (see ``burning``)."""

    at_s: float
    arrival_s: Floats  # (y, x) infinity where it has not burned
    front: Floats  # (k, 2) points on the front as float (row, column), no further apart than a cell
    area: Any = None  # what has burned, if known better than by cells; shapely, landscape's CRS


class StartArea(NamedTuple):
    """What had burned of a fire taken over, as it was mapped; shapely, landscape's CRS."""

    area: Any
    at_s: float


class Fire(ABC):
    """One burning fire. Time is in seconds and only goes forward.

    ``arrival_time_s`` is float64 (y, x): when each cell caught fire, infinity where it has not yet.
    It is the fire's own array, not a copy: do not write to it.
    """

    landscape: Landscape
    weather: WeatherStream
    wind_limit: bool
    time_s: float
    start_area: StartArea | None  # of a fire taken over; None where the scheme has cells only
    arrival_time_s: Floats

    def __init__(
        self,
        landscape: Landscape,
        weather: WeatherStream,
        ignitions: Sequence[Ignition],
        burning: Burning | None,
        wind_limit: bool = False,
    ) -> None:
        """Raises FireModelError where nothing can burn, or for a fire that does not fit."""
        self.landscape = landscape
        self.weather = weather
        self.wind_limit = wind_limit
        self.time_s = burning.at_s if burning else 0.0
        self.start_area = None
        if burning:
            check_burning(burning, landscape)
        check_ignitions(landscape, ignitions, self.time_s)

    @abstractmethod
    def _burn_until(self, to_time_s: float) -> None: ...

    def advance(self, to_time_s: float) -> None:
        """Let it burn until ``to_time_s``; costs in proportion to what newly burns."""
        if not self.time_s <= to_time_s < np.inf:
            raise FireModelError(
                f"the fire is at {self.time_s} s and cannot go to {to_time_s} s; "
                "it only goes forward"
            )
        self._burn_until(float(to_time_s))
        self.time_s = float(to_time_s)

    @abstractmethod
    def _light(self, ignition: Ignition) -> None: ...

    def light(self, row: int, col: int, at_s: float) -> None:
        """Light a cell of the fire under way, now or later; one burned by then burns no more.

        Raises FireModelError for a time past, or where nothing can burn.
        """
        check_ignitions(self.landscape, [(row, col, at_s)], self.time_s)
        self._light((int(row), int(col), float(at_s)))
        self.advance(self.time_s)

    @abstractmethod
    def copy(self) -> Self:
        """The same fire, to go on apart from this one; what never changes is shared.

        Costs a few ms with 500 x 500 cells.
        """

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """As ``copy``: ``deepcopy`` would part arrays that share their memory."""
        return self.copy()

    @abstractmethod
    def perturb(self, wind_factor: float, turn_deg: float, spread_factor: float) -> None:
        """Have all wind from now on be so many times as strong and come from so much further
        clockwise than ``weather`` says, and fire spread so many times as fast besides.
        """

    def draw_from(self, rng: np.random.Generator) -> None:  # noqa: B027  # most leave nothing
        """Leave to another generator what is left to chance from now on."""

    def expected_s(self) -> Floats:
        """(y, x) when each cell burned and, next to the fire, when it is expected by now.

        Infinity elsewhere; from these times ``front`` is drawn.
        """
        return self._expected_s().copy()

    def burned(self) -> NDArray[np.bool_]:
        """Which cells burn or have burned by now (y, x)."""
        return self.arrival_time_s <= self.time_s

    @property
    def burned_ha(self) -> float:
        """The area burned by now, in whole cells."""
        cells = int(np.count_nonzero(self.burned()))
        return cells * self.landscape.cell_size_m**2 / 1e4

    def state_at(self, time_s: float) -> NDArray[np.int8]:
        """State of each cell (y, x) at a time: UNBURNED, BURNING, BURNED or CANNOT_BURN.

        A cell burns as long as it has a neighbour (of eight) left to burn. Raises FireModelError
        for a time that the fire has not come to.
        """
        self._check_past(time_s)
        cannot = np.isin(self.landscape.fuel_model, list(NON_BURNABLE))
        burned = self.arrival_time_s <= time_s
        fresh = neighbours_of(~burned & ~cannot)
        state = np.where(burned, np.where(fresh, BURNING, BURNED), UNBURNED)
        return np.where(cannot & ~burned, CANNOT_BURN, state).astype(np.int8)

    def front(self, time_s: float) -> Any:
        """Burned area at a time as a shapely MultiPolygon in the landscape's CRS.

        Its edge runs between the cells' centres, where the fire was at that time. Raises
        FireModelError for a time that the fire has not come to.
        """
        self._check_past(time_s)
        found = front_polygons(self._expected_s(), time_s, self.landscape)
        return with_start(found, self.start_area, time_s)

    def arrival_vectors(self) -> Floats:
        """Metres towards north and east (2, y, x) of the last straight way by which fire came.

        Here from the neighbour that burned first; 0 where it was lit.
        """
        from_row, from_col = earliest_neighbour(self.arrival_time_s)
        return np.stack([from_row, -from_col]) * self.landscape.cell_size_m

    def _expected_s(self) -> Floats:
        """(y, x) arrival times, of unburned cells too where they are known."""
        return self.arrival_time_s

    def _check_past(self, time_s: float) -> None:
        if time_s > self.time_s:
            raise FireModelError(f"the fire is at {self.time_s} s; it is not known at {time_s} s")


def with_start(area: Any, start: StartArea | None, time_s: float) -> Any:
    """A burned area at a time, with what a fire taken over had burned by then."""
    if start is None or time_s < start.at_s:
        return area
    return multipolygon(area.union(start.area))


def check_ignitions(landscape: Landscape, ignitions: Sequence[Ignition], from_s: float) -> None:
    """Raise FireModelError for the first ignition where or when nothing can burn."""
    rows, cols = landscape.shape
    for row, col, time_s in ignitions:
        if not (0 <= row < rows and 0 <= col < cols):
            raise FireModelError(f"ignition at row {row}, column {col}: outside the landscape")
        if not from_s <= time_s < np.inf:
            raise FireModelError(
                f"ignition at row {row}, column {col}: time {time_s} s must be {from_s:g} or later"
            )
        if int(landscape.fuel_model[row, col]) in NON_BURNABLE:
            raise FireModelError(
                f"ignition at row {row}, column {col}: fuel code "
                f"{landscape.fuel_model[row, col]} does not burn"
            )


def check_burning(burning: Burning, landscape: Landscape) -> None:
    """Raise FireModelError unless a fire that is there already fits the landscape and its time."""
    at_s, arrival_s, front, _ = burning
    if not np.isfinite(at_s):
        raise FireModelError(f"burning: at_s = {at_s} is not a time; give seconds")
    check_shape(arrival_s, landscape)
    wrong = ~((arrival_s <= at_s) | (arrival_s == np.inf)) | (arrival_s == -np.inf)
    if wrong.any():
        row, col = divmod(int(np.argmax(wrong)), landscape.shape[1])
        raise FireModelError(
            f"burning: arrival_s is {arrival_s[row, col]} at row {row}, column {col} "
            f"({np.count_nonzero(wrong)} such cells); it must be a time by at_s = {at_s}, or "
            "infinity where it has not burned"
        )
    if front.ndim != 2 or front.shape[1] != 2:
        raise FireModelError(
            f"burning: front is {front.shape}; it must be (points, 2): row, column"
        )
    off = ~(np.abs((front + 0.5) / landscape.shape - 0.5) <= 0.5).all(axis=1)
    if off.any():
        row, col = front[int(np.argmax(off))]
        raise FireModelError(
            f"burning: front has a point at row {row:g}, column {col:g}, off the landscape of "
            f"{landscape.shape} cells; leave it out"
        )


def check_shape(arrival_s: Floats, landscape: Landscape) -> None:
    """Raise FireModelError if arrival times are not on the landscape's grid."""
    if arrival_s.shape != landscape.shape:
        raise FireModelError(
            f"burning: arrival is {arrival_s.shape} cells, the landscape {landscape.shape}; both "
            "must be (rows, columns) of the same size"
        )
