"""Computes the present and the expected fronts of a run."""

import asyncio
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from mission_service.interfaces.maps.fronts import contours_geojson, front_geojson

if TYPE_CHECKING:
    from mission_service.runtime.run_context import RunContext


async def front_now(context: "RunContext") -> dict[str, Any]:
    """Return the area burned now, a GeoJSON Feature with ``at_us``, computed in a thread."""
    # The estimate may lag slightly behind the clock.
    at_us = min(context.clock.now_us, round(context.estimate.fire.time_s * 1e6))
    at_s = at_us / 1e6
    found = await context.forecasts.arrival(at_s)
    arrival_s, start_area = found.arrival_s.copy(), found.start_area
    draw = partial(front_geojson, arrival_s, context.landscape, at_s, at_s, start_area=start_area)
    return {"at_us": at_us, **await asyncio.to_thread(draw)}


async def expected_fronts(context: "RunContext", in_min: Sequence[float]) -> list[dict[str, Any]]:
    """Return the areas expected to have burned after the given minutes, as GeoJSON Features.

    The latest time comes first. The features are computed in a thread. Raises FireModelError if no
    forecast is possible.
    """
    now_s = context.clock.now_us / 1e6
    times_s = [now_s + 60.0 * each for each in in_min]
    found = await context.forecasts.arrival(max(times_s))
    shapes = partial(
        contours_geojson,
        found.arrival_s,
        context.landscape,
        times_s,
        now_s,
        start_area=found.start_area,
    )
    features: list[dict[str, Any]] = (await asyncio.to_thread(shapes))["features"]
    return features
