"""Forecast the estimated fire of a burn; the plans of the burn are based on this forecast."""

import asyncio
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from firemodel.assimilation.estimate_forecast import Cells
from firemodel.ellipses.point_observations import Simulation
from firemodel.landscape.landscape import Landscape
from mission_service.fire.estimated_fire import EstimatedFire
from mission_service.fire.forecast import Arrival

Floats = NDArray[np.float64]

# Relative standard deviation of the time since ignition without corrections: the combined
# uncertainty of spread and wind (firemodel/ensemble/uncertainty.py).
UNCORRECTED_SD = 0.37


class EstimatedForecasts:
    """The forecasts of an estimate that includes future arrival times.

    The interface is that of ``Forecasts``.
    """

    def __init__(
        self,
        estimate_of: Callable[[], EstimatedFire],
        landscape: Landscape,
        now_s: Callable[[], float],
    ) -> None:
        self._estimate_of = estimate_of
        self._landscape = landscape
        self._now_s = now_s
        self.took_s = 0.0  # as in ``Forecasts``; always 0, because no fire is simulated here
        self._arrival_s: tuple[int, Simulation | None, Floats] = (-1, None, np.empty(0))

    async def arrival(self, until_s: float) -> Arrival:
        """Return the arrival times of the current estimate."""
        version, _, arrival_s = await self._arrivals()
        return Arrival(self._now_s(), until_s, arrival_s, version)

    async def probability(self, at_s: float) -> Floats:
        """Return the probability (y, x) that fire has reached each cell by a time."""
        _, simulation, arrival_s = await self._arrivals()
        return await asyncio.to_thread(
            burn_probability, simulation, self._landscape, arrival_s, at_s
        )

    async def arrival_quantiles_s(
        self, places: Sequence[Cells], shares: Sequence[float], for_s: float
    ) -> tuple[float, Floats]:
        """Return the times when fire reaches places (``Forecasts.arrival_quantiles_s``)."""
        _, simulation, arrival_s = await self._arrivals()
        first = np.array([cells[int(np.argmin(arrival_s.flat[cells]))] for cells in places], int)
        until_s, median_s = self._now_s() + for_s, arrival_s.flat[first]
        sds_s = await asyncio.to_thread(_arrival_sds_s, simulation, self._landscape, arrival_s)
        sd_s = sds_s.flat[first]
        ahead_s = median_s + ndtri(np.asarray(shares))[:, None] * np.where(
            np.isfinite(median_s), np.maximum(sd_s, 1.0), 1.0
        )
        return until_s, np.where(ahead_s <= until_s, ahead_s, np.inf)

    async def follow(self) -> None:
        """Wait until cancelled; the estimate of a burn needs no processing."""
        await asyncio.Event().wait()

    def close(self) -> None:
        """Do nothing; a caller may close ``Forecasts`` or this object."""

    async def _arrivals(self) -> tuple[int, Simulation, Floats]:
        estimate = self._estimate_of()
        version, simulation = estimate.version, estimate.simulation
        found = self._arrival_s
        if found[0] != version or found[1] is not simulation:
            times_s = await asyncio.to_thread(arrival_times_s, simulation, self._landscape)
            found = self._arrival_s = (version, simulation, times_s)
        return version, simulation, found[2]


def arrival_times_s(simulation: Simulation, landscape: Landscape) -> Floats:
    """Return a simulation's arrival times (y, x) at the cell centres."""
    return simulation.ignition_time_s(_centres_m(landscape)).reshape(landscape.shape)


def burn_probability(
    simulation: Simulation, landscape: Landscape, arrival_s: Floats, at_s: float
) -> Floats:
    """Return the probability (y, x) that fire has reached each cell by a time.

    ``arrival_s`` is the result of ``arrival_times_s``.
    """
    sd_s = _arrival_sds_s(simulation, landscape, arrival_s)
    with np.errstate(invalid="ignore"):
        share = ndtr((at_s - arrival_s) / np.maximum(sd_s, 1.0))
    return np.where(np.isfinite(arrival_s), share, 0.0)


def _arrival_sds_s(simulation: Simulation, landscape: Landscape, arrival_s: Floats) -> Floats:
    """Return the standard deviations (y, x) of the arrival times."""
    # The paper's correction gives no standard deviations.
    sd_of = getattr(simulation, "sd_s", None)
    if sd_of is not None:
        found: Floats = sd_of(_centres_m(landscape)).reshape(arrival_s.shape)
        return found
    first_s = float(arrival_s.min())
    return UNCORRECTED_SD * (arrival_s - first_s if np.isfinite(first_s) else arrival_s)


def _centres_m(landscape: Landscape) -> Floats:
    """Return the coordinates (n, 2) of the cell centres, row by row."""
    row, col = np.indices(landscape.shape)
    return np.column_stack([np.asarray(each, float).ravel() for each in landscape.xy_of(row, col)])
