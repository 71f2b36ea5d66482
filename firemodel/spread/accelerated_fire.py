"""Simulate new fires that accelerate (``acceleration``), in any scheme without random spread.

The fraction of the steady rate depends only on the time since ignition. An accelerating fire is
therefore computed as one without acceleration, and a clock converts its times. Each ignition time
has its own fire, in which the weather changes at times on that fire's clock. A cell burns when the
first of these fires reaches it. A fire that was already burning at the start (a mapped perimeter)
is not new and has no acceleration.

Spot fires burn on the clock of the fire that emitted the firebrands, with a delay
(``schemes.SPOT_FIRE_DELAY_S``).

Cells that touch and are lit at the same time form a line source; all others are point sources.
"""

import copy
import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from firemodel.arrays import WHOLE, Floats, Mask, Place
from firemodel.compiled import compiled, kernel
from firemodel.physics import acceleration
from firemodel.physics.acceleration import LINE_PER_S, POINT_PER_S
from firemodel.physics.weather import Weather
from firemodel.spread.fire_scheme import Burning, Fire, Ignition
from firemodel.spread.front import neighbours_of

_time_since = kernel(acceleration.time_since_s)


class Clock(NamedTuple):
    """The clock of a fire that was lit at ``at_s``.

    ``per_s`` is the constant a in 1/s, or infinity for a fire that does not accelerate."""

    at_s: float
    per_s: float

    def steady_s(self, time_s: float) -> float:
        """Return the clock's time in s at the given time; the two are equal until ignition."""
        if time_s <= self.at_s or self.per_s == math.inf:
            return time_s
        return self.at_s + acceleration.steady_time_s(time_s - self.at_s, self.per_s)

    def times_s(self, steady_s: Floats) -> Floats:
        """Return the times (n) in s that correspond to times on the clock."""
        if self.per_s == math.inf:
            return steady_s
        return np.asarray(_times(steady_s, self.at_s, self.per_s))

    def rate_share(self, time_s: Floats) -> Floats:
        """Return the fraction of the steady rate (n) reached at the given times (n)."""
        if self.per_s == math.inf:
            return np.ones_like(time_s)
        return acceleration.rate_share(np.maximum(time_s - self.at_s, 0.0), self.per_s)


class ClockedFire(NamedTuple):
    """A fire that runs on a clock; ``counted`` (y, x) marks its burned cells counted so far."""

    fire: Fire
    clock: Clock
    counted: Mask


class AcceleratedFire(Fire):
    """A fire with acceleration, as described in the module docstring."""

    def __init__(
        self,
        unlit: Fire,
        ignitions: Sequence[Ignition],
        old: Fire | None = None,
        burning: Burning | None = None,
    ) -> None:
        """Start from a fire without burned cells, which becomes part of this fire.

        Args:
            unlit: A fire of the scheme that has burned no cell.
            ignitions: (row, column, time in s) of each cell that is lit.
            old: The same fire with ``burning``, if there is an initial fire.
            burning: That initial fire.

        Raises:
            FireModelError: An ignition is invalid.
        """
        super().__init__(unlit.landscape, unlit.weather, ignitions, burning, unlit.rate_options)
        shape = self.landscape.shape
        self._unlit = unlit
        self._fires: list[ClockedFire] = []
        self.arrival_time_s = np.full(shape, np.inf)
        self._owner = np.full(shape, -1, dtype=np.int32)  # index of the fire that reached a cell
        self._pending = sorted(ignitions, key=lambda each: each[2], reverse=True)
        self._lit: list[tuple[int, int]] = []  # cells lit at the latest ignition time ...
        self._first_lit, self._lit_at_s = 0, -math.inf  # ... and the first of their fires
        if old is not None:
            self.start_area = old.start_area
            self._fires.append(ClockedFire(old, Clock(0.0, math.inf), np.zeros(shape, dtype=bool)))
        self.advance(self.time_s)

    def _light(self, ignition: Ignition) -> None:
        self._pending.append(ignition)
        self._pending.sort(key=lambda each: each[2], reverse=True)

    def copy(self) -> Self:
        found = copy.copy(self)
        found._unlit = self._unlit.copy()
        found._fires = [
            ClockedFire(each.fire.copy(), each.clock, each.counted.copy()) for each in self._fires
        ]
        found.arrival_time_s, found._owner = self.arrival_time_s.copy(), self._owner.copy()
        found._pending, found._lit = self._pending.copy(), self._lit.copy()
        return found

    def perturb(
        self,
        wind_factor: float | Floats,
        turn_deg: float | Floats,
        spread_factor: float | Floats,
    ) -> None:
        for fire in (self._unlit, *(each.fire for each in self._fires)):
            fire.perturb(wind_factor, turn_deg, spread_factor)

    def _close(self, cells: Mask) -> None:
        for fire in (self._unlit, *(each.fire for each in self._fires)):
            fire._close(cells)

    def weather_ahead(self) -> tuple[Weather, ...]:
        return self._unlit.weather_ahead()

    def draw_from(self, rng: np.random.Generator) -> None:
        self._unlit.draw_from(rng)
        for each in self._fires:  # the draws of a cell must not depend on the fire
            each.fire.firebrands = self._unlit.firebrands

    def _burn_until(self, to_time_s: float) -> None:
        while self._pending and self._pending[-1][2] <= to_time_s:
            at_s = self._pending[-1][2]
            self._spread_until(at_s)
            cells = []
            while self._pending and self._pending[-1][2] == at_s:
                row, col, _ = self._pending.pop()
                cells.append((row, col))
            self._ignite(cells, at_s)
        self._spread_until(to_time_s)

    def _spread_until(self, to_time_s: float) -> None:
        self._unlit.advance(to_time_s)
        for number in range(len(self._fires)):
            self._advance(number, to_time_s)

    def _advance(self, number: int, to_time_s: float) -> None:
        fire, clock, counted = self._fires[number]
        fire.advance(max(clock.steady_s(to_time_s), fire.time_s))
        new = np.nonzero(fire.burned() & ~counted)
        counted[new] = True
        # The limit corrects rounding errors.
        times_s = np.minimum(clock.times_s(fire.arrival_time_s[new]), to_time_s)
        first = times_s < self.arrival_time_s[new]
        here = new[0][first], new[1][first]
        self.arrival_time_s[here] = times_s[first]
        self._owner[here] = number

    def _ignite(self, cells: Sequence[tuple[int, int]], at_s: float) -> None:
        """Start the fires of the cells lit at ``at_s``, the current time of all fires."""
        fresh = [cell for cell in cells if self.arrival_time_s[cell] > at_s]
        if not fresh:
            return
        if at_s == self._lit_at_s:  # more cells lit at the same time: the fires are restarted
            fresh = [*self._lit, *fresh]
            del self._fires[self._first_lit :]
        self._lit, self._lit_at_s, self._first_lit = fresh, at_s, len(self._fires)
        lit = np.zeros(self.landscape.shape, dtype=bool)
        lit[tuple(np.array(fresh).T)] = True
        self.arrival_time_s[lit], self._owner[lit] = np.inf, -1
        line = lit & neighbours_of(lit)
        for source, per_s in ((line, LINE_PER_S), (lit & ~line, POINT_PER_S)):
            if not source.any():
                continue
            clock = Clock(at_s, per_s)
            fire = self._unlit.on_clock(clock.steady_s)
            for row, col in np.argwhere(source).tolist():
                fire.light(row, col, at_s)
            self._fires.append(ClockedFire(fire, clock, np.zeros_like(lit)))
            self._advance(len(self._fires) - 1, at_s)

    def arrival_vectors(self, here: Place = WHOLE) -> Floats:
        owner = self._owner[here]
        found = np.zeros((2, *owner.shape))
        for number, each in enumerate(self._fires):
            own = owner == number
            found[:, own] = each.fire.arrival_vectors(here)[:, own]
        return found

    def rate_share(self) -> Floats:
        found = np.ones(self.landscape.shape)
        for number, each in enumerate(self._fires):
            own = self._owner == number
            found[own] = each.clock.rate_share(self.arrival_time_s[own])
        return found

    def _expected_s(self) -> Floats:
        found = self.arrival_time_s.copy()
        for each in self._fires:
            expected_s = each.fire.expected_s()
            ahead = np.nonzero(np.isfinite(expected_s) & ~(found <= self.time_s))
            found[ahead] = np.minimum(found[ahead], each.clock.times_s(expected_s[ahead]))
        return found


@compiled
def _times(steady_s, at_s, per_s):  # type: ignore[no-untyped-def]
    """Return the times (n) in s that correspond to times on a clock.

    A loop is used, so that a result does not depend on the number of times."""
    found = np.empty_like(steady_s)
    for place in range(steady_s.size):
        found[place] = at_s + _time_since(steady_s[place] - at_s, per_s)
    return found
