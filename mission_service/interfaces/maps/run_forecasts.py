"""Provides the forecasts and the front of a run."""

import asyncio
from functools import partial
from typing import TYPE_CHECKING, Any

from mission_service.fire.forecast import Forecasts
from mission_service.interfaces.maps.fronts import front_geojson

if TYPE_CHECKING:
    from mission_service.fire.burn_forecast import EstimatedForecasts
    from mission_service.fire.estimated_fire import EstimatedFire
    from mission_service.runtime.run_context import RunContext


def forecasts_of(context: "RunContext") -> "Forecasts | EstimatedForecasts":
    """Return the forecasts of the run's estimate or, in a burn, of the burn's estimated fire."""
    if context.estimated_fire is not None:
        from mission_service.fire.burn_forecast import EstimatedForecasts

        def estimated() -> "EstimatedFire":
            assert context.estimated_fire is not None
            return context.estimated_fire

        return EstimatedForecasts(estimated, context.landscape, lambda: context.clock.now_us / 1e6)
    return Forecasts(lambda: context.estimate, lambda: context.state_view.fire_version)


async def front_now(
    context: "RunContext", forecasts: "Forecasts | EstimatedForecasts"
) -> dict[str, Any]:
    """Return the area burned now, a GeoJSON Feature with ``at_us``, computed in a thread."""
    # The estimate may lag slightly behind the clock.
    at_us = min(context.clock.now_us, round(context.estimate.fire.time_s * 1e6))
    at_s = at_us / 1e6
    found = await forecasts.arrival(at_s)
    arrival_s, start_area = found.arrival_s.copy(), found.start_area
    draw = partial(front_geojson, arrival_s, context.landscape, at_s, at_s, start_area=start_area)
    return {"at_us": at_us, **await asyncio.to_thread(draw)}
