"""The forecasts and the front of a run."""

import asyncio
from functools import partial
from typing import TYPE_CHECKING, Any

from mission_service.fire.forecast import Forecasts
from mission_service.interfaces.maps.fronts import front_geojson

if TYPE_CHECKING:
    from mission_service.fire.estimated import EstimatedFire
    from mission_service.fire.estimated_forecast import EstimatedForecasts
    from mission_service.runtime.hub import Hub


def forecasts_of(hub: "Hub") -> "Forecasts | EstimatedForecasts":
    """Of the fire that burns; in a burn of the one that its plans are made on."""
    if hub.believed is not None:
        from mission_service.fire.estimated_forecast import (
            EstimatedForecasts,  # not for all who start
        )

        def believed() -> "EstimatedFire":
            assert hub.believed is not None
            return hub.believed

        return EstimatedForecasts(believed, hub.landscape, lambda: hub.clock.now_us / 1e6)
    return Forecasts(lambda: hub.world.fire, lambda: hub.picture.fire_version, hub.scenario.seed)


async def front_now(hub: "Hub", forecasts: "Forecasts | EstimatedForecasts") -> dict[str, Any]:
    """The area burned now, a GeoJSON Feature with ``at_us``; drawn in a thread."""
    # What burns may be a moment behind the clock.
    at_us = min(hub.clock.now_us, round(hub.world.fire.time_s * 1e6))
    at_s = at_us / 1e6
    found = await forecasts.arrival(at_s)
    arrival_s, start_area = found.arrival_s.copy(), found.start_area
    draw = partial(front_geojson, arrival_s, hub.landscape, at_s, at_s, start_area=start_area)
    return {"at_us": at_us, **await asyncio.to_thread(draw)}
