"""Simulate random spread with the cellular automaton of the virtual-agents paper (section 3.3).

At each update a burning cell ignites each unburned neighbour with the same probability p_spread.
The automaton uses only the landscape's shape and non-burnable cells (the paper has no such cells);
the weather has no effect.

The paper leaves these points open:

- The burning time of a cell. "Cells that were burning in the previous time step become burned"
  means ``burning_steps = 1``. With p_spread = 0.01, however, a cell would then ignite 0.04 other
  cells on average, and the fire would die out after one or two updates; the paper's fires burn for
  190 updates. By default a cell therefore burns until all its neighbours have burned.
- The neighbours of a cell. Here the neighbours are the four cells that share a side with the cell.
  With p_spread = 0.01 and the default burning time, fires of 460 and 2600 cells grow in 190 updates
  to 830 and 3430 cells on average; table 2 of the paper has about 800 and 3400. With eight
  neighbours, these fires would grow to 1670 and 5070 cells. With p_spread = 0.025, a fire of 1000
  cells grows to 2510 cells; table 2 has about 3050. The other interpretations that were tried
  (eight neighbours, 25 to 100 burning_steps, an initial shape grown with another probability) are
  not closer to all three sizes.
- The time between updates. 190 updates in 20 minutes are 6.3 s apart. The state does not change
  between two updates.
"""

import copy
import math
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, Mask
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.physics.fuels import NON_BURNABLE
from firemodel.physics.weather import WeatherStream
from firemodel.spread.fire_scheme import (
    BURNED,
    BURNING,
    CANNOT_BURN,
    UNBURNED,
    Burning,
    Fire,
    Ignition,
)
from firemodel.spread.front import front_polygons
from firemodel.spread.probabilistic_kernels import update


class ProbabilisticFire(Fire):
    """The automaton described in the module docstring.

    ``burned_out_s`` (y, x) is the time at which each cell stopped burning, and infinity before
    that. There is an update every ``update_s`` after the start. A cell that is lit between two
    updates, or at the time of an update, spreads from the next update on. Random numbers are
    generated only for burning cells, in an order that does not depend on the steps of ``advance``.
    """

    def __init__(
        self,
        landscape: Landscape,
        weather: WeatherStream,
        ignitions: Sequence[Ignition],
        burning: Burning | None = None,
        *,
        p_spread: float,
        update_s: float,
        rng: np.random.Generator,
        burning_steps: int | None = None,
    ) -> None:
        """Create a fire whose cells burn for ``burning_steps`` updates each.

        If ``burning_steps`` is None, a cell burns until all its neighbours have burned.

        Cells of an initial fire burn for the remaining updates, counted from their arrival times.
        Raises FireModelError for an ignition on a cell that cannot burn, or for an invalid number.
        """
        _check(p_spread, update_s, burning_steps)
        super().__init__(landscape, weather, ignitions, burning)
        self._start_s = self.time_s
        self._p_spread, self._every_s, self._rng = p_spread, update_s, rng
        self._burning_steps = burning_steps or 0
        self._updates = 0
        self._can_burn = ~np.isin(landscape.fuel_model, list(NON_BURNABLE))
        self.arrival_time_s = np.full(landscape.shape, np.inf)
        self.burned_out_s = np.full(landscape.shape, np.inf)
        self._ignitions = sorted(((t, row, col) for row, col, t in ignitions), reverse=True)
        self._cells = np.empty(0, dtype=np.int64)  # burning cells
        self._lasted = np.empty(0, dtype=np.int64)  # number of updates for which each has burned
        if burning:
            self._take_over(burning)
        self.advance(self.time_s)

    def _take_over(self, burning: Burning) -> None:
        burned = np.isfinite(burning.arrival_s)
        self.arrival_time_s[burned] = burning.arrival_s[burned]
        lasted = np.zeros(burned.shape, dtype=np.int64)
        lasted[burned] = (self.time_s - burning.arrival_s[burned]) // self._every_s
        fresh = np.pad(self._can_burn & ~burned, 1)
        continues = burned & self._can_burn
        if self._burning_steps:
            continues &= lasted < self._burning_steps
        else:
            continues &= fresh[:-2, 1:-1] | fresh[2:, 1:-1] | fresh[1:-1, :-2] | fresh[1:-1, 2:]
        self.burned_out_s[burned & ~continues] = self.time_s
        self._cells = np.flatnonzero(continues)
        self._lasted = lasted.ravel()[self._cells]

    def _light(self, ignition: Ignition) -> None:
        row, col, at_s = ignition
        self._ignitions.append((at_s, row, col))
        self._ignitions.sort(reverse=True)

    def copy(self) -> Self:
        """Return a copy with the random generator's state, so that both fires burn identically."""
        found = copy.copy(self)
        found.arrival_time_s = self.arrival_time_s.copy()
        found.burned_out_s = self.burned_out_s.copy()
        found._cells, found._lasted = self._cells.copy(), self._lasted.copy()
        found._ignitions = self._ignitions.copy()
        found._rng = copy.deepcopy(self._rng)
        return found

    def perturb(
        self,
        wind_factor: float | Floats,
        turn_deg: float | Floats,
        spread_factor: float | Floats,
    ) -> None:
        """Multiply p_spread by the (mean) ``spread_factor``, and ignore the other arguments."""
        rates = np.asarray(spread_factor)
        rates = rates[..., 0] if rates.ndim == 3 else rates
        self._p_spread = min(self._p_spread * float(np.mean(rates)), 1.0)

    def draw_from(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def _burn_until(self, to_time_s: float) -> None:
        while True:
            update_s = self._start_s + (self._updates + 1) * self._every_s
            ignition_s = self._ignitions[-1][0] if self._ignitions else math.inf
            if min(update_s, ignition_s) > to_time_s:
                return
            if update_s <= ignition_s:
                self._updates += 1
                self._update(update_s)
            else:
                self._ignite(*self._ignitions.pop())

    def _close(self, cells: Mask) -> None:
        self._can_burn = self._can_burn & ~cells

    def _ignite(self, at_s: float, row: int, col: int) -> None:
        if self.arrival_time_s[row, col] == np.inf and self._can_burn[row, col]:
            self.arrival_time_s[row, col] = at_s
            self._cells = np.append(self._cells, row * self.landscape.shape[1] + col)
            self._lasted = np.append(self._lasted, 0)

    def _update(self, at_s: float) -> None:
        count = self._cells.size
        cells, lasted = np.empty((2, 5 * count), dtype=np.int64)
        cells[:count], lasted[:count] = self._cells, self._lasted
        size = update(
            at_s,
            self._rng.random(4 * count) < self._p_spread,
            cells,
            lasted,
            count,
            self.arrival_time_s.ravel(),
            self.burned_out_s.ravel(),
            self._can_burn.ravel(),
            self.landscape.shape[1],
            self._burning_steps,
        )
        self._cells, self._lasted = cells[:size], lasted[:size]

    def state_at(self, time_s: float) -> NDArray[np.int8]:
        """Return the states as in ``Fire``; a cell is BURNING until its ``burned_out_s``."""
        self._check_past(time_s)
        state = np.where(self.burned_out_s <= time_s, BURNED, BURNING)
        unburned = np.where(self._can_burn, UNBURNED, CANNOT_BURN)
        return np.where(self.arrival_time_s <= time_s, state, unburned).astype(np.int8)

    def front(self, time_s: float) -> Any:
        """Return the burned area as in ``Fire``, with its edge always halfway between cells."""
        self._check_past(time_s)
        ago_s = np.where(self.arrival_time_s <= time_s, 1.0, -np.inf)
        return front_polygons(-ago_s, 0.0, self.landscape)


def _check(p_spread: float, update_s: float, burning_steps: int | None) -> None:
    if not 0.0 <= p_spread <= 1.0:
        raise FireModelError(f"p_spread = {p_spread} must be from 0 to 1")
    if not 0.0 < update_s < math.inf:
        raise FireModelError(f"update_s = {update_s} must be positive")
    if burning_steps is not None and burning_steps < 1:
        raise FireModelError(f"burning_steps = {burning_steps} must be 1 or more, or None")
