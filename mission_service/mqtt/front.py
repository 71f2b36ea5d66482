"""The fire's front now, as GeoJSON."""

import asyncio
from functools import partial

import msgspec

from firemodel.landscape import Landscape
from mission_service.maps.believed import BelievedForecasts
from mission_service.maps.forecast import Forecasts
from mission_service.maps.fronts import front_geojson
from mission_service.mqtt.topics import FRONT


async def front_at(
    at_us: int, forecasts: Forecasts | BelievedForecasts, landscape: Landscape
) -> bytes:
    """The area burned now; contours are drawn in a thread."""
    at_s = at_us / 1e6
    found = await forecasts.arrival(at_s)
    draw = partial(
        front_geojson, found.arrival_s.copy(), landscape, at_s, at_s, start_area=found.start_area
    )
    feature = await asyncio.to_thread(draw)
    return msgspec.json.encode({"schema": FRONT.schema, "at_us": at_us, **feature})
