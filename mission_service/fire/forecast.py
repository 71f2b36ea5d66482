"""Compute forecasts of the estimated fire in a thread on request, and keep the latest one."""

import asyncio
import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from firemodel.assimilation.estimate_forecast import Cells, Forecast
from firemodel.assimilation.fire_estimate import FireEstimate
from firemodel.errors import FireModelError
from firemodel.spread.fire_scheme import StartArea
from mission_service.fire.run_ensemble import RunEnsemble, processed
from mission_service.fire.run_estimate import RunEstimate

__all__ = ["LONGEST_S", "Arrival", "Forecasts", "forecast_once"]

# Forecast lengths; a request is rounded up to one of them.
LENGTHS_S = (3600.0, 3 * 3600.0, 6 * 3600.0)
LONGEST_S = LENGTHS_S[-1]
# Forecasts are longer by this, so that they also serve later requests for "now plus three hours".
FURTHER_S = 1200.0
PRESENT_S = 10.0  # times no further ahead count as now: the estimate lags behind the clock
OLD_S = 180.0  # a forecast of this age in mission time is recomputed
FOLLOW_EVERY_S = 5.0  # real-time interval at which queued inputs are processed
# Times after a forecast's start for which the arrival at places is computed.
_STEPS_MIN = (range(60), range(60, 180, 5), range(180, 361, 10))
ARRIVAL_STEPS_S = tuple(60.0 * minutes for steps in _STEPS_MIN for minutes in steps)
REST_S = 10.0  # minimum real time between two forecasts, unless operators changed the fire

Floats = NDArray[np.float64]
Result = TypeVar("Result")


class Arrival(NamedTuple):
    """The arrival times of a fire: estimated in the past, forecast in the future."""

    at_s: float  # time of the forecast
    until_s: float  # end of the forecast, at least the requested time
    arrival_s: Floats  # (y, x); later than until_s only next to the fire
    version: int
    start_area: StartArea | None = None  # area of the initial fire, for fronts


class _Made(NamedTuple):
    """A forecast of the ensemble (None if nothing burns), and the joined arrival times."""

    forecast: Forecast | None
    arrival: Arrival


class Forecasts:
    """The forecasts of the estimate returned by ``estimate_of()``.

    ``version_of()`` changes with each correction of the fire. Forecasts are computed only on
    request. All computation runs in one thread, in which kernels release the GIL; the same thread
    processes the queued inputs of the ensemble. Concurrent requests share one computation. One
    object must not be used in several event loops.
    """

    def __init__(
        self, estimate_of: Callable[[], RunEstimate], version_of: Callable[[], int]
    ) -> None:
        self._estimate_of, self._version_of = estimate_of, version_of
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="forecast")
        self.took_s = 0.0  # computing time of the last forecast in s
        self._newest: _Made | None = None
        self._begun_s = -math.inf  # start of the newest forecast's computation, in real time
        self._length_s = 0.0  # greatest length requested so far
        self._work: asyncio.Task[None] | None = None
        self._processing = asyncio.Lock()

    async def arrival(self, until_s: float) -> Arrival:
        """Return the arrival times until ``until_s`` or later.

        If ``until_s`` is not in the future, these are the current fire's times; future times are
        ensemble medians. Raises FireModelError if ``until_s`` is not finite or more than
        ``LONGEST_S`` from now.
        """
        fire = self._estimate_of().fire
        _check(until_s, fire.time_s)
        if until_s <= fire.time_s + PRESENT_S:
            arrival_s = fire.expected_s()
            return Arrival(fire.time_s, fire.time_s, arrival_s, self._version_of(), fire.start_area)
        return (await self._fresh(until_s)).arrival

    async def probability(self, at_s: float) -> Floats:
        """Return the probability (y, x) that each cell has burned by a time.

        For past times and now, the probability is 0 or 1. Raises FireModelError like ``arrival``.
        """
        fire = self._estimate_of().fire
        _check(at_s, fire.time_s)
        if at_s <= fire.time_s + PRESENT_S:
            return (fire.arrival_time_s <= at_s).astype(np.float64)
        forecast, arrival = await self._fresh(at_s)
        return await self._in_thread(partial(_probability, arrival, forecast, at_s))

    async def arrival_quantiles_s(
        self, places: Sequence[Cells], shares: Sequence[float], for_s: float
    ) -> tuple[float, Floats]:
        """Return the end of a forecast, and the times (k, n) when the fire reaches places.

        Args:
            places: The cells of each of n places, as flat grid indices; at least one each.
            shares: k probabilities that the fire has arrived by these times.
            for_s: Length of the forecast from now.

        Returns:
            The end of the forecast, and the times; infinity if the fire does not arrive by then.
            Where it has arrived, they are the estimated time of arrival. Raises FireModelError like
            ``arrival``.
        """
        now_s = self._estimate_of().fire.time_s
        _check(now_s + for_s, now_s)
        forecast, arrival = await self._fresh(now_s + for_s)
        until_s = min(now_s + for_s, arrival.until_s)
        work = partial(_quantiles_s, arrival, forecast, places, shares, until_s)
        return until_s, await self._in_thread(work)

    def close(self) -> None:
        """Cancel running computations."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    async def _in_thread(self, work: Callable[[], Result]) -> Result:
        return await asyncio.get_running_loop().run_in_executor(self._thread, work)

    async def _fresh(self, until_s: float) -> _Made:
        requested_s = asyncio.get_running_loop().time()
        while not self._serves(until_s, requested_s):
            if self._work is None or self._work.done():
                self._work = asyncio.create_task(self._compute(until_s))
            # A cancelled request does not cancel the computation, which other requests may await.
            await asyncio.shield(self._work)
        assert self._newest is not None
        return self._newest

    def _serves(self, until_s: float, requested_s: float) -> bool:
        newest = self._newest
        if newest is None or newest.arrival.until_s < until_s:
            return False
        if self._begun_s >= requested_s:
            return True
        if newest.arrival.version != self._version_of():
            return False
        old = self._estimate_of().fire.time_s - newest.arrival.at_s > OLD_S
        return not old or asyncio.get_running_loop().time() - self._begun_s < REST_S

    async def follow(self) -> None:
        """Process the ensemble's inputs soon after they arrive, until cancelled.

        Without this coroutine, the first forecast has to process all inputs.
        """
        while True:
            await asyncio.sleep(FOLLOW_EVERY_S)
            estimate = self._estimate_of()
            await self._processed_until(estimate.ensemble, estimate.fire.time_s)

    async def _processed_until(self, ensemble: RunEnsemble, at_s: float) -> FireEstimate:
        """Process the ensemble's inputs up to a given time in the thread; return the ensemble."""
        async with self._processing:
            before, inputs = ensemble.processed, ensemble.inputs_until(at_s)
            if not inputs:
                return before
            after = await self._in_thread(partial(processed, before, inputs))
            ensemble.replace(before, after, len(inputs))
            return after

    async def _compute(self, until_s: float) -> None:
        loop = asyncio.get_running_loop()
        begun_s, version, estimate = loop.time(), self._version_of(), self._estimate_of()
        fire, ensemble = estimate.fire, estimate.ensemble
        now_s, arrival_s = fire.time_s, fire.expected_s()
        self._length_s = max(self._length_s, _length_s(until_s - now_s))
        until_s = now_s + self._length_s + FURTHER_S
        after = await self._processed_until(ensemble, now_s)
        forecast = await self._in_thread(partial(_forecast, after, now_s, until_s))
        if forecast is not None:
            arrival_s = await self._in_thread(partial(_joined, arrival_s, forecast, now_s))
        arrival = Arrival(now_s, until_s, arrival_s, version, fire.start_area)
        self._newest, self._begun_s = _Made(forecast, arrival), begun_s
        self.took_s = loop.time() - begun_s


def forecast_once(estimate: RunEstimate, for_s: float) -> tuple[Arrival, Floats | None]:
    """Return the arrival times of an estimate and its forecast, and the burn probability (y, x).

    Args:
        estimate: The estimate, without queued inputs. Its ensemble is not modified.
        for_s: The length of the forecast; 0 for none.

    Returns:
        The arrival times, and the probability at the end of the forecast (None without a forecast).
    """
    fire, ensemble = estimate.fire, estimate.ensemble
    now_s, arrival_s = fire.time_s, fire.expected_s()
    end_s, forecast = now_s + for_s, None
    if for_s:
        after = processed(ensemble.processed, ensemble.inputs_until(now_s))
        # Probabilities also depend on arrivals soon after the end.
        forecast = _forecast(after, now_s, end_s + FURTHER_S)
    if forecast is not None:
        arrival_s = _joined(arrival_s, forecast, now_s)
    arrival = Arrival(now_s, end_s, arrival_s, 0, fire.start_area)
    return arrival, _probability(arrival, forecast, end_s) if for_s else None


def _probability(arrival: Arrival, forecast: Forecast | None, at_s: float) -> Floats:
    """Return the probability (y, x) that each cell has burned; 1 where the estimate has burned."""
    burned = (arrival.arrival_s <= arrival.at_s).astype(np.float64)
    if forecast is None:
        return burned
    return np.maximum(forecast.burn_probability(max(at_s, forecast.at_s)), burned)


def _forecast(estimate: FireEstimate, now_s: float, until_s: float) -> Forecast | None:
    if not estimate.begun:
        return None
    found = estimate.copy()
    if now_s > found.time_s:
        found.advance(now_s)
    return found.forecast(until_s)


def _quantiles_s(
    arrival: Arrival,
    forecast: Forecast | None,
    places: Sequence[Cells],
    shares: Sequence[float],
    until_s: float,
) -> Floats:
    """Return the times (k, n) when the fire reaches places (``arrival_quantiles_s``)."""
    past_s = np.array([arrival.arrival_s.flat[cells].min() for cells in places])
    if forecast is None:
        ahead_s = np.full((len(shares), len(places)), np.inf)
    else:
        steps = (forecast.at_s + each for each in ARRIVAL_STEPS_S)
        times_s = [each for each in steps if each <= until_s]
        ahead_s = forecast.at_places(places).arrival_quantiles_s(shares, times_s)[:, 0]
    return np.where(past_s <= arrival.at_s, past_s, ahead_s)


def _joined(arrival_s: Floats, forecast: Forecast, now_s: float) -> Floats:
    """Return the arrival times (y, x): the estimate's up to now, the forecast's afterwards."""
    later_s = np.maximum(forecast.median_arrival_s(), np.nextafter(now_s, np.inf))
    return np.where(arrival_s <= now_s, arrival_s, later_s)


def _length_s(requested_s: float) -> float:
    return min((length_s for length_s in LENGTHS_S if length_s >= requested_s), default=requested_s)


def _check(at_s: float, now_s: float) -> None:
    if not math.isfinite(at_s):
        raise FireModelError(
            f"forecast: {at_s} s is not a time; specify a finite number of seconds"
        )
    if at_s > now_s + LONGEST_S:
        raise FireModelError(
            f"forecast: {at_s:.0f} s is {(at_s - now_s) / 3600:.1f} h from now; "
            f"the limit is {LONGEST_S / 3600:g} h"
        )
