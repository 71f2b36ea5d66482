"""Defines the route for uploaded detector rasters; ``requests.py`` defines other reports."""

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response

from mission_service.interfaces import examples
from mission_service.interfaces.api.context import ApiContext
from mission_service.interfaces.api.models import RequestResult
from mission_service.interfaces.api.openapi import V1, file, route, struct
from mission_service.interfaces.api.perimeter_routes import read_in_process
from mission_service.interfaces.api.responses import answer, body_of
from mission_service.interfaces.maps.mercator import outline_of
from mission_service.interfaces.maps.perimeter_import import LARGEST_BYTES
from mission_service.interfaces.maps.upload_worker import RasterDone, RasterJob

PATH = f"{V1}/fire/observations/geotiff"
Number = Annotated[float | None, Query(allow_inf_nan=False)]


def add(routes: APIRouter, api: ApiContext) -> None:
    """Add the route for GeoTIFFs."""
    areas = {"burned_ha_before": 329.4, "burned_ha_after": 331.2}
    reply = {**examples.ACCEPTED, "event": "RasterObserved", "messages": [], **areas}

    @routes.post(
        PATH,
        **route(
            "observe",
            "Report the burned (1), unburned (0) and unseen (255) pixels of this GeoTIFF.",
            struct(RequestResult, reply),
            file("application/octet-stream"),
        ),
    )
    async def geotiff(
        request: Request,
        file_name: Annotated[str, Query(max_length=200)] = "the upload",
        source: Annotated[str | None, Query(max_length=80)] = None,
        age_s: Number = None,
        position_sd_m: Number = None,
        false_alarms_pct: Number = None,
        missed_pct: Number = None,
    ) -> Response:
        given: dict[str, Any] = {
            "source": source,
            "position_sd_m": position_sd_m,
            "false_alarms_pct": false_alarms_pct,
            "missed_pct": missed_pct,
        }
        data = await body_of(request, LARGEST_BYTES)
        outline = [(float(lon), float(lat)) for lon, lat in outline_of(api.context.landscape)]
        received_us = api.context.clock.now_us
        async with api.raster_uploads:
            found = await read_in_process(RasterJob(data, file_name, outline))
        assert isinstance(found, RasterDone)
        keys = {key: value for key, value in given.items() if value is not None}
        # The time that it took to read the file adds to the age of the observation.
        waited_s = max(api.context.clock.now_us - received_us, 0) / 1e6
        keys["age_s"] = waited_s if age_s is None else age_s if age_s < 0.0 else age_s + waited_s
        return answer(await api.handle(request.state.user, {**found.request, **keys}))
