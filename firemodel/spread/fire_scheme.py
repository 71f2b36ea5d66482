"""Define the common base of all spread schemes: a burning fire, its states and its front."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import WHOLE, Floats, Mask, Place
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.notebook_object import NotebookObject
from firemodel.physics.fuels import NON_BURNABLE
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.front import earliest_neighbour, front_polygons, multipolygon, neighbours_of
from firemodel.spread.rate_options import SURFACE_ONLY, RateOptions

if TYPE_CHECKING:
    from firemodel.spread.firebrands import Firebrands

UNBURNED, BURNING, BURNED, CANNOT_BURN = 0, 1, 2, 3

Ignition = tuple[int, int, float]  # row, column, time in s


class Burning(NamedTuple):
    """An initial fire that the model continues (see ``burning``)."""

    at_s: float
    arrival_s: Floats  # (y, x) arrival times; infinity in unburned cells
    front: Floats  # (k, 2) points on the front as float (row, column), at most a cell apart
    area: Any = None  # mapped burned area, if there is one; shapely, in the landscape's CRS


class StartArea(NamedTuple):
    """The mapped burned area of an initial fire, as a shapely geometry in the landscape's CRS."""

    area: Any
    at_s: float


class Closing(NamedTuple):
    """Cells that cannot burn from a given time on, such as a section of a control line."""

    at_s: float
    cells: NDArray[np.int64]  # (k) indices of the flattened cells


class Fire(NotebookObject, ABC):
    """A burning fire; its time in seconds only increases.

    ``arrival_time_s`` (y, x), float64, is the ignition time of each cell; unburned cells have
    infinity. The array is internal to the fire, not a copy. Callers must not write to this array.
    """

    landscape: Landscape
    weather: WeatherStream
    rate_options: RateOptions
    time_s: float
    start_area: StartArea | None  # area of an initial fire; None if the scheme uses only cells
    arrival_time_s: Floats
    firebrands: "Firebrands | None" = None  # only in schemes with ``emits_firebrands``
    _changes_s: list[float]  # times of the weather changes, then infinity
    _closings: tuple[Closing, ...] = ()  # later closings, in order of time
    _closed: tuple[Closing, ...] = ()  # closings in effect, each with the cells that it closed

    def __init__(
        self,
        landscape: Landscape,
        weather: WeatherStream,
        ignitions: Sequence[Ignition],
        burning: Burning | None,
        rate_options: RateOptions = SURFACE_ONLY,
    ) -> None:
        """Raise FireModelError for an invalid ignition, or for an initial fire on another grid."""
        self.landscape = landscape
        self.weather = weather
        self.rate_options = rate_options
        self.time_s = burning.at_s if burning else 0.0
        self.start_area = None
        if burning:
            check_burning(burning, landscape)
        check_ignitions(landscape, ignitions, self.time_s)

    @abstractmethod
    def _burn_until(self, to_time_s: float) -> None: ...

    def advance(self, to_time_s: float) -> None:
        """Burn until ``to_time_s``; the computing time is proportional to the newly burned area."""
        if not self.time_s <= to_time_s < np.inf:
            raise FireModelError(
                f"the fire is at {self.time_s} s and cannot advance to {to_time_s} s; "
                "use a later, finite time"
            )
        while self._closings and self._closings[0].at_s <= to_time_s:
            at_s = max(self._closings[0].at_s, self.time_s)
            self._burn_until(at_s)
            self.time_s = at_s
            self._close_by(at_s)
        self._burn_until(float(to_time_s))
        self.time_s = float(to_time_s)

    def add_closings(self, closings: Sequence[Closing]) -> None:
        """Add cells that cannot burn from given times on; cells that burn before are unaffected."""
        self._closings = tuple(sorted((*self._closings, *closings), key=lambda each: each.at_s))
        self.advance(self.time_s)

    def _close_by(self, at_s: float) -> None:
        count = sum(each.at_s <= at_s for each in self._closings)
        due, self._closings = self._closings[:count], self._closings[count:]
        cells = np.unique(np.concatenate([each.cells for each in due]))
        can_burn = ~np.isin(self.landscape.fuel_model.ravel()[cells], list(NON_BURNABLE))
        cells = cells[can_burn & (self.arrival_time_s.ravel()[cells] > at_s)]
        if cells.size:
            self._closed = (*self._closed, Closing(at_s, cells))
            mask = np.zeros(self.landscape.fuel_model.size, dtype=bool)
            mask[cells] = True
            self._close(mask.reshape(self.landscape.shape))

    @abstractmethod
    def _close(self, cells: Mask) -> None:
        """Make unburned cells (y, x) unburnable at ``time_s``."""

    @abstractmethod
    def _light(self, ignition: Ignition) -> None: ...

    def light(self, row: int, col: int, at_s: float) -> None:
        """Light a cell now or later; this has no effect if the cell has burned by then.

        Raises FireModelError for a past time, or for a cell that cannot burn.
        """
        check_ignitions(self.landscape, [(row, col, at_s)], self.time_s)
        self._light((int(row), int(col), float(at_s)))
        self.advance(self.time_s)

    @abstractmethod
    def copy(self) -> Self:
        """Return an independent copy of this fire; data that never changes is shared.

        Copying 500 x 500 cells takes a few ms.
        """

    def copy_over(self, used: Self) -> Self:
        """Return a copy of this fire that may reuse the arrays of a copy that is no longer needed.

        ``used``, a copy taken since this fire last changed, must not be used again. Schemes in
        which this saves time override this method.
        """
        return self.copy()

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """Return ``copy()``; a plain ``deepcopy`` would separate arrays that share memory."""
        return self.copy()

    @abstractmethod
    def perturb(
        self,
        wind_factor: float | Floats,
        turn_deg: float | Floats,
        spread_factor: float | Floats,
    ) -> None:
        """Change wind and spread rate from now on, relative to ``weather``.

        The wind speed is multiplied by ``wind_factor``, and the wind direction is turned clockwise
        by ``turn_deg``: numbers, or one number for each entry of ``weather_ahead``. The spread rate
        is multiplied by ``spread_factor``: a number, or an array (entries of ``weather_ahead``,
        burnable fuels in ascending order). An array with a third axis contains a factor for each
        term of the rates (``local_spread.Tables``).
        """

    def weather_ahead(self) -> tuple[Weather, ...]:
        """Return the weather entry in effect and the later entries that this scheme uses."""
        return self._entries_ahead(self.weather.changes())

    def _entries_ahead(self, entries: tuple[Weather, ...]) -> tuple[Weather, ...]:
        return entries[max(sum(entry.at_s <= self.time_s for entry in entries) - 1, 0) :]

    def on_clock(self, clock: Callable[[float], float]) -> Self:
        """Return a copy in which the weather changes at other times.

        ``clock`` converts the time of a change, and must leave times that have passed unchanged.
        """
        found = self.copy()
        found._changes_s = [clock(time_s) for time_s in self._changes_s]
        # Of entries that begin at the same time, only the last has an effect.
        entries = {clock(entry.at_s): entry for entry in self.weather.entries}
        found.weather = WeatherStream([replace(each, at_s=at_s) for at_s, each in entries.items()])
        return found

    def draw_from(self, rng: np.random.Generator) -> None:  # most schemes are deterministic
        """Use another generator for random draws from now on."""

    def expected_s(self) -> Floats:
        """Return the arrival times (y, x) of burned cells, and expected times next to the fire.

        All other cells are infinite. ``front`` is computed from these times.
        """
        return self._expected_s().copy()

    def burned(self) -> NDArray[np.bool_]:
        """Return the mask (y, x) of the cells that have ignited by ``time_s``."""
        return self.arrival_time_s <= self.time_s

    def burned_arrival_s(self) -> Floats:
        """Return the arrival times (y, x) of the cells ignited by ``time_s``, else infinity."""
        return np.where(self.burned(), self.arrival_time_s, np.inf)

    @property
    def burned_ha(self) -> float:
        """The burned area in hectares, counted in whole cells."""
        cells = int(np.count_nonzero(self.burned()))
        return cells * self.landscape.cell_size_m**2 / 1e4

    @property
    def interpolated_ha(self) -> float:
        """The burned area in hectares, interpolated within cells if the scheme has times there."""
        return self.burned_ha

    def state_at(self, time_s: float) -> NDArray[np.int8]:
        """Return each cell's state (y, x) at ``time_s``: UNBURNED, BURNING, BURNED or CANNOT_BURN.

        A cell is BURNING as long as one of its eight neighbours can still burn. Raises
        FireModelError if the fire has not been advanced to ``time_s`` yet.
        """
        self._check_past(time_s)
        cannot = np.isin(self.landscape.fuel_model, list(NON_BURNABLE))
        for closing in self._closed:
            if closing.at_s <= time_s:
                cannot.ravel()[closing.cells] = True
        burned = self.arrival_time_s <= time_s
        fresh = neighbours_of(~burned & ~cannot)
        state = np.where(burned, np.where(fresh, BURNING, BURNED), UNBURNED)
        return np.where(cannot & ~burned, CANNOT_BURN, state).astype(np.int8)

    def front(self, time_s: float) -> Any:
        """Return the burned area at ``time_s`` as a shapely MultiPolygon in the landscape's CRS.

        The edge of the area is interpolated between cell centres. Raises FireModelError if the fire
        has not been advanced to ``time_s`` yet.
        """
        self._check_past(time_s)
        return burned_area(self._expected_s(), self.landscape, time_s, self.start_area)

    def arrival_vectors(self, here: Place = WHOLE) -> Floats:
        """Return the last straight path to each cell as a vector (2, y, x) in m north and east.

        The result covers the window ``here``. By default the path comes from the neighbour that
        burned first. The vector is 0 where the fire was lit.
        """
        from_row, from_col = earliest_neighbour(self.arrival_time_s)
        return np.stack([from_row[here], -from_col[here]]) * self.landscape.cell_size_m

    def rate_share(self) -> float | Floats:
        """Return the fraction (y, x) of the steady rate that the fire has reached on arrival."""
        return 1.0

    def _expected_s(self) -> Floats:
        """Return the arrival times (y, x), with expected times of unburned cells if known."""
        return self.arrival_time_s

    def _check_past(self, time_s: float) -> None:
        if time_s > self.time_s:
            raise FireModelError(
                f"the fire is at {self.time_s} s; its state at {time_s} s is not computed yet"
            )


def burned_area(
    arrival_s: Floats, landscape: Landscape, at_s: float, start_area: StartArea | None = None
) -> Any:
    """Return the area burned by ``at_s`` as a shapely MultiPolygon in the landscape's CRS.

    Args:
        arrival_s: The arrival times (y, x), infinite where fire never arrives; times after
            ``at_s`` are used to interpolate the front between two cells.
        landscape: The grid of ``arrival_s``.
        at_s: Mission time.
        start_area: The area that had burned when the fire began (``Fire.start_area``), which is
            part of the result from that time on.
    """
    area = front_polygons(arrival_s, at_s, landscape)
    if start_area is None or at_s < start_area.at_s:
        return area
    return multipolygon(area.union(start_area.area))


def check_ignitions(landscape: Landscape, ignitions: Sequence[Ignition], from_s: float) -> None:
    """Raise FireModelError for ignitions off the grid, before ``from_s`` or in unburnable cells."""
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
    """Raise FireModelError if an initial fire contradicts the landscape or its own ``at_s``."""
    at_s, arrival_s, front, _ = burning
    if not np.isfinite(at_s):
        raise FireModelError(f"burning: at_s = {at_s} is not a time in seconds")
    check_shape(arrival_s, landscape)
    wrong = ~((arrival_s <= at_s) | (arrival_s == np.inf)) | (arrival_s == -np.inf)
    if wrong.any():
        row, col = divmod(int(np.argmax(wrong)), landscape.shape[1])
        raise FireModelError(
            f"burning: arrival_s is {arrival_s[row, col]} at row {row}, column {col} "
            f"({np.count_nonzero(wrong)} such cells); it must be at most at_s = {at_s}, or "
            "infinity in unburned cells"
        )
    if front.ndim != 2 or front.shape[1] != 2:
        raise FireModelError(
            f"burning: front has the shape {front.shape}, but must have (points, 2): row, column"
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
            f"burning: arrival has the shape {arrival_s.shape}, but the landscape "
            f"{landscape.shape}; the shapes must be equal"
        )
