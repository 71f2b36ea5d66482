"""Compute forecasts of the simulated fire in a thread on request, and keep the latest."""

import asyncio
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from firemodel.ensemble.uncertainty import Uncertainty
from firemodel.errors import FireModelError
from firemodel.spread.fire_scheme import Fire
from mission_service.fire.ensemble import (
    Arrival,
    EnsembleForecast,
    burned_ahead,
    ensemble_of,
    probability_at,
)

__all__ = ["LONGEST_S", "Arrival", "Forecasts"]

LENGTHS_S = (3600.0, 3 * 3600.0, 6 * 3600.0)  # from now; requests are rounded up to these
LONGEST_S = LENGTHS_S[-1]
# Added to the length, so that later requests for "now plus three hours" use the same forecast.
FURTHER_S = 1200.0
OLD_S = 180.0  # age in mission time at which a forecast is computed again
REST_S = 10.0  # minimum real time between two forecasts, unless operators changed the fire

Floats = NDArray[np.float64]
ForecastT = TypeVar("ForecastT", Arrival, EnsembleForecast)


class _Slot(Generic[ForecastT]):
    """The latest forecast of one kind, and the task that computes the next forecast."""

    def __init__(self, make: Callable[[Fire, float, int], ForecastT]) -> None:
        self.make: Callable[[Fire, float, int], ForecastT] = make
        self.newest: ForecastT | None = None
        self.begun_s = -math.inf  # real time
        self.length_s = 0.0  # longest requested so far
        self.work: asyncio.Task[None] | None = None


class Forecasts:
    """The forecasts of the fire that ``fire_of()`` returns.

    ``version_of()`` changes with each correction of that fire. Forecasts are computed only on
    request. The event loop waits while the fire is copied (3 ms with 500 x 500 cells). The rest of
    the computation runs in one thread, in which kernels release the GIL. Concurrent requests share
    one computation, and at most one computation of each kind runs at a time. One object must not be
    used in several event loops.
    """

    def __init__(
        self,
        fire_of: Callable[[], Fire],
        version_of: Callable[[], int],
        seed: int,
        uncertainty: Uncertainty | None = None,
    ) -> None:
        self._fire_of, self._version_of = fire_of, version_of
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="forecast")
        self._open = True
        self.took_s = 0.0  # computing time of the last forecast
        self._arrivals: _Slot[Arrival] = _Slot(
            lambda fire, until_s, version: burned_ahead(fire, until_s, version, seed)
        )
        self._ensembles: _Slot[EnsembleForecast] = _Slot(
            lambda fire, until_s, version: ensemble_of(
                fire, until_s, version, seed, uncertainty, lambda: self._open
            )
        )

    async def arrival(self, until_s: float) -> Arrival:
        """Return the arrival times until ``until_s`` or later.

        If ``until_s`` is in the past, these are the times of the present fire. Raises
        FireModelError if ``until_s`` is more than ``LONGEST_S`` from now or is not finite.
        """
        fire = self._fire_of()
        _check(until_s, fire.time_s)
        if until_s <= fire.time_s:
            arrival_s = fire.expected_s()
            return Arrival(fire.time_s, fire.time_s, arrival_s, self._version_of(), fire.start_area)
        return await self._fresh(self._arrivals, until_s)

    async def probability(self, at_s: float) -> Floats:
        """Return the probability (y, x) that each cell has burned by a time.

        For a past time the probability is 0 or 1. Raises FireModelError like ``arrival``.
        """
        fire = self._fire_of()
        _check(at_s, fire.time_s)
        if at_s <= fire.time_s:
            return (fire.arrival_time_s <= at_s).astype(np.float64)
        return probability_at(await self._fresh(self._ensembles, at_s), at_s)

    def close(self) -> None:
        """Cancel running computations."""
        self._open = False
        self._thread.shutdown(wait=False, cancel_futures=True)

    async def _fresh(self, slot: _Slot[ForecastT], until_s: float) -> ForecastT:
        requested_s = asyncio.get_running_loop().time()
        while not self._serves(slot, until_s, requested_s):
            if slot.work is None or slot.work.done():
                slot.work = asyncio.create_task(self._work(slot, until_s))
            # A cancelled request does not cancel the computation, which other requests may await.
            await asyncio.shield(slot.work)
        assert slot.newest is not None
        return slot.newest

    def _serves(self, slot: _Slot[ForecastT], until_s: float, requested_s: float) -> bool:
        newest = slot.newest
        if newest is None or newest.until_s < until_s:
            return False
        if slot.begun_s >= requested_s:
            return True
        if newest.version != self._version_of():
            return False
        old = self._fire_of().time_s - newest.at_s > OLD_S
        return not old or asyncio.get_running_loop().time() - slot.begun_s < REST_S

    async def _work(self, slot: _Slot[ForecastT], until_s: float) -> None:
        loop = asyncio.get_running_loop()
        begun_s, version, fire = loop.time(), self._version_of(), self._fire_of().copy()
        slot.length_s = max(slot.length_s, _length_s(until_s - fire.time_s))
        until_s = fire.time_s + slot.length_s + FURTHER_S
        forecast = await loop.run_in_executor(self._thread, slot.make, fire, until_s, version)
        slot.newest, slot.begun_s = forecast, begun_s
        self.took_s = loop.time() - begun_s


def _length_s(requested_s: float) -> float:
    return min((length_s for length_s in LENGTHS_S if length_s >= requested_s), default=requested_s)


def _check(at_s: float, now_s: float) -> None:
    if not math.isfinite(at_s):
        raise FireModelError(f"forecast: {at_s} s is not a time; give a finite number of seconds")
    if at_s > now_s + LONGEST_S:
        raise FireModelError(
            f"forecast: {at_s:.0f} s is {(at_s - now_s) / 3600:.1f} h from now; "
            f"{LONGEST_S / 3600:g} h is the maximum"
        )
