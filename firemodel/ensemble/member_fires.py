"""Simulate the members of an ensemble: fires with the same initial state but different errors.

Members do not depend on each other and may be simulated in parallel. Functions that simulate
several members have the argument ``each``: ``map``, or the ``map`` method of a thread pool, with
which members are simulated in parallel because kernels release the GIL. The result does not depend
on ``each``.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, bounds_of
from firemodel.ensemble.draws import Draw
from firemodel.errors import FireModelError
from firemodel.physics.fuels import NON_BURNABLE
from firemodel.spread.behaviour import flame_length_m, front_behaviour
from firemodel.spread.fire_scheme import Fire, Ignition
from firemodel.spread.local_spread import (
    CROWN,
    HEAT,
    Tables,
    fuel_beds,
    perturbed,
    tables_of,
    terms_of,
    terrain_of,
    window_of,
)

Each = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]


class Window(NamedTuple):
    """The result of one member, in the smallest window that contains its burned cells."""

    top: int  # row and column of the window's north-west cell in the grid
    left: int
    after_s: NDArray[np.float32]  # (y, x) arrival in s after the start; infinity if unburned
    flame_m: NDArray[np.float32]  # (y, x) flame length at arrival; NaN if none after the start


class Start:
    """The common initial state of all members, and the spread rates that the members share.

    The fire at the start may already contain burned cells. ``Start`` does not change this fire.
    """

    def __init__(self, fire: Fire, ignitions: Sequence[Ignition] = ()) -> None:
        """Prepare the members of a fire.

        Args:
            fire: The fire at the start. Its ignitions are the same in all members.
            ignitions: (row, column, time in s) of further cells to ignite. In each member these
                cells are moved by the offset in the member's draw.
        """
        land, self.entries = fire.landscape, fire.weather_ahead()
        self.fire, self.ignitions = fire, tuple(ignitions)
        self.fuels = len(land.burnable_codes)
        self._beds = fuel_beds(land, self.entries)
        self._terrain = terrain_of(land, self.entries, fire.rate_options)
        self._tables = tables_of(land, self.entries, fire.rate_options)
        self._burnable = ~np.isin(land.fuel_model, list(NON_BURNABLE))
        self._burned = fire.burned()
        self._by_moisture: dict[float, Floats] = {}
        self._spare: deque[Fire] = deque()

    def member(self, draw: Draw, rng: np.random.Generator) -> Fire:
        """Return a member at the start; schemes that use random numbers take them from ``rng``."""
        try:
            fire = self.fire.copy_over(self._spare.pop())
        except IndexError:  # no spare arrays: all earlier members are still in use
            fire = self.fire.copy()
        fire.draw_from(rng)
        fire.perturb(draw.wind_factor, draw.turn_deg, self.rate_factors(draw))
        for row, col, at_s in self._moved(draw):
            fire.light(row, col, at_s)
        return fire

    def reuse(self, fire: Fire) -> None:
        """Reuse a member's arrays for a later member; ``fire`` must not be used again."""
        self._spare.append(fire)

    def window(self, fire: Fire, draw: Draw) -> Window:
        """Return the result of the member ``fire``, which was simulated with ``draw``."""
        burned = fire.burned()
        if not burned.any():
            nothing = np.empty((0, 0), dtype=np.float32)
            return Window(0, 0, nothing, nothing)
        here = bounds_of(burned)
        arrival_s = np.where(burned[here], fire.arrival_time_s[here], np.inf)
        came_s = np.where(self._burned[here], np.inf, arrival_s)
        paths = fire.arrival_vectors(here)
        share = np.broadcast_to(fire.rate_share(), burned.shape)[here]
        flame_m = self._flame_length_m(came_s, paths, share, here, draw)
        after_s = (arrival_s - self.fire.time_s).astype(np.float32)
        return Window(here[0].start, here[1].start, after_s, flame_m)

    def _flame_length_m(
        self,
        came_s: Floats,
        paths: Floats,
        share: Floats,
        here: tuple[slice, slice],
        draw: Draw,
    ) -> NDArray[np.float32]:
        """Return the flame length (y, x) in a window, NaN where fire did not arrive.

        ``share`` is the ``rate_share`` of the member's fire.
        """
        changed: Tables = perturbed(
            self._tables, 0, draw.wind_factor, draw.turn_deg, self.rate_factors(draw)
        )
        _, _, intensity, crown = front_behaviour(
            came_s.ravel(),
            paths.reshape(2, -1),
            np.array([-np.inf, *(entry.at_s for entry in self.entries[1:])]),
            np.ascontiguousarray(changed.terms[1:, :, HEAT]),
            window_of(self._terrain, self.fire.landscape.shape, here),
            changed._replace(terms=changed.terms[1:], wind=changed.wind[1:]),
            directions=False,
        )
        intensity = intensity * share.ravel()
        return np.asarray(flame_length_m(intensity, crown), np.float32).reshape(came_s.shape)

    def rate_factors(self, draw: Draw) -> Floats:
        """Return the factors of a member's rates (entries ahead, fuel beds, ``Tables.terms``)."""
        found = self._wet(draw.moisture_factor).copy()
        own = draw.spread_factor * np.array(draw.fuel_factors)[self._tables.fuel_of_bed]
        found[..., 0] *= own
        found[..., CROWN] *= own
        return found

    def _wet(self, factor: float) -> Floats:
        """Return the ratios of the terms (entries, fuel beds, 8) with more or less dead moisture.

        ``factor`` multiplies the moistures of dead fuel. Surface and crown fires respond
        differently, because crown fires spread in other fuel. Terms that are 0 or infinite do not
        depend on the moisture; their ratio is 1.
        """
        if factor not in self._by_moisture:
            land = self.fire.landscape
            entries = [entry.with_dead_moisture(factor) for entry in self.entries]
            dry = self._tables.terms
            wet = terms_of(land, self._beds, entries, self.fire.rate_options)
            some = (dry > 0.0) & np.isfinite(dry)
            self._by_moisture[factor] = np.divide(wet, dry, out=np.ones_like(dry), where=some)
        return self._by_moisture[factor]

    def _moved(self, draw: Draw) -> Iterator[Ignition]:
        """Yield the member's ignitions, moved by the offset unless the new cell cannot burn."""
        cell_m = self.fire.landscape.cell_size_m
        down, right = round(-draw.north_m / cell_m), round(draw.east_m / cell_m)
        rows, cols = self._burnable.shape
        for row, col, at_s in self.ignitions:
            to_row, to_col = row + down, col + right
            inside = 0 <= to_row < rows and 0 <= to_col < cols
            moves = inside and self._burnable[to_row, to_col]
            yield (to_row, to_col, at_s) if moves else (row, col, at_s)


def burned_windows(
    start: Start,
    draws: Sequence[Draw],
    numbers: Iterable[int],
    until_s: float,
    seed: int,
    each: Each = map,
) -> Iterator[Window]:
    """Simulate members and yield the result of each.

    Args:
        start: The common initial state.
        draws: The draws of all members.
        numbers: The members to simulate, as indices of ``draws``.
        until_s: The time at which the simulation ends, in s.
        seed: The seed for schemes that use random numbers.
        each: ``map``, or the ``map`` method of a thread pool.

    Returns:
        The windows, in the order of ``numbers``. A window depends only on ``start``, ``until_s``,
        ``seed``, and the member's draw and number.
    """

    def burned(number: int) -> Window:
        # The seed (seed, 0) is used for a run without errors.
        rng = np.random.default_rng((seed, number + 1))
        fire = start.member(draws[number], rng)
        fire.advance(max(until_s, fire.time_s))
        found = start.window(fire, draws[number])
        start.reuse(fire)
        return found

    return iter(each(burned, numbers))


class Ensemble:
    """Fires that advance together and can be perturbed and resampled, as in a particle filter.

    A member of the any-angle scheme needs about 70 bytes per cell of the landscape.
    """

    def __init__(self, fires: Sequence[Fire]) -> None:
        """Create an ensemble of fires on the same landscape at the same time.

        The ensemble uses the given fires, not copies. Raises FireModelError if there are no fires,
        or if the fires differ in landscape or time.
        """
        if len({(id(fire.landscape), fire.time_s) for fire in fires}) != 1:
            raise FireModelError(
                "ensemble: must contain one or more fires on the same landscape and at the same "
                "time"
            )
        self.fires = list(fires)

    @property
    def time_s(self) -> float:
        """The current time of the members in s."""
        return self.fires[0].time_s

    def advance(self, to_time_s: float, each: Each = map) -> None:
        """Advance all members to a time. Raises FireModelError for an earlier time."""
        for _ in each(lambda fire: fire.advance(to_time_s), self.fires):
            pass

    def copy(self) -> Self:
        """Return an ensemble of copies."""
        return type(self)([fire.copy() for fire in self.fires])

    def perturb(
        self,
        number: int,
        wind_factor: float | Floats,
        turn_deg: float | Floats,
        spread_factor: float | Floats,
    ) -> None:
        """Change the wind and the spread rates of one member from now on; see ``Fire.perturb``."""
        self.fires[number].perturb(wind_factor, turn_deg, spread_factor)

    def resample(self, numbers: Sequence[int]) -> None:
        """Keep only the selected members; a member that is selected several times is copied.

        Args:
            numbers: Indices of current members, for example drawn according to weights.

        Raises:
            FireModelError: ``numbers`` is empty, or a number is not the index of a member.
        """
        unknown = [number for number in numbers if not 0 <= number < len(self.fires)]
        if unknown or not numbers:
            raise FireModelError(
                f"ensemble: cannot resample {unknown or 'nothing'}; use numbers from 0 to "
                f"{len(self.fires) - 1}"
            )
        taken: set[int] = set()
        found = []
        for number in numbers:
            found.append(self.fires[number].copy() if number in taken else self.fires[number])
            taken.add(number)
        self.fires = found

    def burn_probability(self) -> Floats:
        """Return the fraction (y, x) of members in which each cell has burned by ``time_s``."""
        burned = np.zeros(self.fires[0].landscape.shape)
        for fire in self.fires:
            burned += fire.burned()
        return burned / len(self.fires)
