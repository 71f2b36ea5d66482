"""Defines the routes of the fire: fronts, forecasts, overlays, corrections and weather."""

import asyncio
from collections.abc import Sequence
from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Request, Response

from firemodel.errors import FireModelError
from mission_service.interfaces import examples
from mission_service.interfaces.api.context import ApiContext
from mission_service.interfaces.api.openapi import V1, file, json, route
from mission_service.interfaces.api.perimeter_routes import read_in_process
from mission_service.interfaces.api.responses import (
    ApiError,
    answer,
    body_of,
    encode,
    json_body,
)
from mission_service.interfaces.maps import fronts, overlay, perimeter_export
from mission_service.interfaces.maps.mercator import outline_of
from mission_service.interfaces.maps.perimeter_import import LARGEST_BYTES
from mission_service.interfaces.maps.upload_worker import Done, Job
from mission_service.requests import Correct

GEOJSON = "application/geo+json"
PREVIEWED = ("correct", "erase", "undo", "redo")
LONGEST_S = 1e7
FAR_S = 3600.0
Seconds = Annotated[float | None, Query(ge=-LONGEST_S, le=LONGEST_S, allow_inf_nan=False)]
Minutes = Annotated[float, Query(ge=0, le=LONGEST_S / 60, allow_inf_nan=False)]
SomeMinutes = Annotated[
    float | None, Query(ge=-LONGEST_S / 60, le=LONGEST_S / 60, allow_inf_nan=False)
]
UPLOADS = (
    "application/geo+json",
    "application/vnd.google-earth.kml+xml",
    "application/vnd.google-earth.kmz",
    "application/zip",
)


def add(routes: APIRouter, api: ApiContext) -> None:
    """Add the routes ``/fire``, ``/weather`` and those of the terrain."""
    _add_shapes(routes, api)
    _add_images(routes, api)
    _add_corrections(routes, api)


def _add_shapes(routes: APIRouter, api: ApiContext) -> None:
    """Add the routes of fronts, contours and probabilities, computed in threads, as GeoJSON."""
    land = api.context.landscape

    def now_s() -> float:
        return api.context.clock.now_us / 1e6

    def time_s(
        at_s: Seconds = None, in_s: Seconds = None, in_min: SomeMinutes = None
    ) -> float | None:
        """Return the mission time in the query, if any."""
        if sum(each is not None for each in (at_s, in_s, in_min)) > 1:
            raise ApiError(422, "specify only one of at_s, in_s and in_min")
        if in_min is not None:
            in_s = 60.0 * in_min
        return at_s if in_s is None else now_s() + in_s

    Time = Annotated[float | None, Depends(time_s)]  # noqa: N806

    @routes.get(
        f"{V1}/fire/front", **route("look", "Burned area at a time.", json(examples.FRONT, GEOJSON))
    )
    async def front(given_s: Time) -> Response:
        when_s = now_s() if given_s is None else given_s
        found = await api.context.forecasts.arrival(when_s)
        shape, start = fronts.front_geojson, found.start_area
        return await _shape(api, shape, found.arrival_s, land, when_s, now_s(), start_area=start)

    @routes.get(
        f"{V1}/fire/contours",
        **route("look", "Expected fronts after the given minutes.", json(examples.FRONTS, GEOJSON)),
    )
    async def contours(
        in_min: Annotated[list[Minutes], Query(max_length=12)] = [30.0, 60.0],  # noqa: B006
    ) -> Response:
        times_s = [now_s() + 60.0 * each for each in in_min]
        found = await api.context.forecasts.arrival(max(times_s, default=now_s()))
        shape, start = fronts.contours_geojson, found.start_area
        return await _shape(api, shape, found.arrival_s, land, times_s, now_s(), start_area=start)

    @routes.get(
        f"{V1}/fire/uncertainty",
        **route(
            "look",
            "Areas burned at a time with a probability of 10, 50 and 90 %.",
            json(examples.FRONTS, GEOJSON),
        ),
    )
    async def uncertainty(given_s: Time) -> Response:
        at_s = now_s() + FAR_S if given_s is None else given_s
        probability = await api.context.forecasts.probability(at_s)
        return await _shape(api, fronts.probability_geojson, probability, land, at_s, now_s())

    @routes.get(
        f"{V1}/fire/perimeters.geojson",
        **route("look", "Perimeter with the field names of WFIGS.", json(examples.FRONTS, GEOJSON)),
    )
    async def perimeters(given_s: Time) -> Response:
        when_s = now_s() if given_s is None else given_s
        found = await api.context.forecasts.arrival(when_s)
        scenario = api.context.scenario
        return await _shape(
            api,
            perimeter_export.perimeter_geojson,
            found.arrival_s,
            land,
            when_s,
            name=scenario.name,
            written_unix_ms=api.wall_us() // 1000,
            prescribed=scenario.burn_flown is not None,
            time_zero=scenario.time_zero,
            start_area=found.start_area,
        )


async def _shape(api: ApiContext, shape: Any, *args: Any, **keywords: Any) -> Response:
    """Return a GeoJSON response; compute and encode the shape in a thread."""
    content = await api.run_in_thread(lambda: encode(shape(*args, **keywords)))
    return Response(content, media_type=GEOJSON)


def _add_images(routes: APIRouter, api: ApiContext) -> None:
    """Add the routes of overlays and terrain for the map."""
    land = api.context.landscape

    async def until(until_s: float | None) -> Any:
        now_s = api.context.clock.now_us / 1e6
        when_s = now_s + FAR_S if until_s is None else until_s
        return when_s, await api.context.forecasts.arrival(when_s)

    @routes.get(
        f"{V1}/fire/arrival.png",
        **route("look", "Arrival times as a transparent overlay.", file("image/png")),
    )
    async def arrival_png(until_s: Seconds = None) -> Response:
        when_s, found = await until(until_s)
        draw = partial(overlay.arrival_png, found.arrival_s, land, found.at_s, when_s)
        return Response(await api.run_in_thread(draw), media_type="image/png")

    legend = {"corners": [], "bounds": [], "scale": [{"at_s": 3600.0, "colour": "#ff0000"}]}

    @routes.get(
        f"{V1}/fire/arrival.json",
        **route("look", "Position and colours of the overlay.", json(legend)),
    )
    async def arrival_json(until_s: Seconds = None) -> Response:
        when_s, found = await until(until_s)
        frame = await api.run_in_thread(partial(overlay.overlay_frame, land))
        return answer({**frame, "scale": overlay.arrival_scale(found.at_s, when_s)})

    @routes.get(
        f"{V1}/terrain.json", **route("look", "TileJSON of the terrain.", json({"tileSize": 256}))
    )
    async def terrain() -> Response:
        return answer(await api.run_in_thread(api.tiles.describe))

    @routes.get(
        f"{V1}/terrain/{{z}}/{{x}}/{{y}}.png",
        **route("look", "Elevation in the Terrarium encoding.", file("image/png")),
    )
    async def tile(z: int, x: int, y: int) -> Response:
        found = None
        if 0 <= z <= 24 and 0 <= x < 2**z and 0 <= y < 2**z:
            found = await api.run_in_thread(partial(api.tiles.tile, z, x, y))
        if found is None:
            raise ApiError(404, f"no terrain in tile {z}/{x}/{y}"[:80])
        return Response(found, media_type="image/png")


def _add_corrections(routes: APIRouter, api: ApiContext) -> None:
    """Add the routes of corrections, perimeter uploads and the weather."""
    shown = {"application/json": {"schema": {"type": "array", "items": {"type": "object"}}}}

    @routes.get(
        f"{V1}/fire/corrections", **route("look", "Corrections of the fire by operators.", shown)
    )
    async def corrections() -> Response:
        return answer(api.context.fire()["corrections"])

    @routes.post(
        f"{V1}/fire/preview",
        **route(
            "correct",
            "The burned area before and after a correction, an erasure, undo or redo. Nothing is "
            "applied.",
            json(examples.FIRE_PREVIEW),
            json({"do": "correct", **Correct.example}),
        ),
    )
    async def preview(request: Request) -> Response:
        return await _previewed(api, request, [await json_body(request)])

    uploaded = {kind: {"schema": {"type": "string", "format": "binary"}} for kind in UPLOADS}
    accepted = json({"perimeter": examples.FRONT, "accepted": [examples.ACCEPTED]})

    @routes.post(
        f"{V1}/fire/perimeter",
        **route(
            "correct",
            "Correct the fire to the perimeter in this file; the service detects the format. With "
            "`preview=true` the reply is that of `/fire/preview`, and nothing is applied.",
            accepted,
            uploaded,
        ),
    )
    async def perimeter(
        request: Request,
        file_name: Annotated[str, Query(max_length=200)] = "the upload",
        preview: bool = False,
    ) -> Response:
        data = await body_of(request, LARGEST_BYTES)
        outline = [(float(lon), float(lat)) for lon, lat in outline_of(api.context.landscape)]
        async with api.uploads:
            found = await read_in_process(Job(data, file_name, outline))
        assert isinstance(found, Done)
        if preview:
            return await _previewed(api, request, found.corrections)
        replies: list[dict[str, Any]] = []
        for each in found.corrections:
            try:
                replies.append(await api.handle(request.state.user, each))
            except ApiError as error:
                number = f"outline {len(replies) + 1} of {len(found.corrections)}"
                text = f"{number}: {error}; the previous outlines were applied"
                raise ApiError(error.status, text if replies else str(error)) from None
            await asyncio.sleep(0)  # other tasks run between two requests
        return answer({"perimeter": found.perimeter, "accepted": replies})

    @routes.get(
        f"{V1}/weather",
        **route("look", "The current weather of the fire model.", json({"wind_from_deg": 225.0})),
    )
    async def weather() -> Response:
        context = api.context
        wind_set = context.state_view.wind_set
        return answer(
            {"at_us": context.clock.now_us, "weather": context.weather(), "wind_set": wind_set}
        )


async def _previewed(
    api: ApiContext, request: Request, corrections: Sequence[dict[str, Any]]
) -> Response:
    """Return the burned area before and after corrections. Raises ApiError."""
    if not all(each.get("do") in PREVIEWED for each in corrections):
        raise ApiError(422, f'preview: "do" must be one of {", ".join(PREVIEWED)}')
    reports = [api.event_of(request.state.user, each) for each in corrections]
    land, at_s = api.context.landscape, api.context.clock.now_us / 1e6
    try:
        compute = api.context.estimate.preview(reports)
    except FireModelError as error:
        raise ApiError(409, str(error)) from None

    def found() -> bytes:
        before, after = compute()
        arrival_s, start = after.arrival_time_s, after.start_area
        shape = fronts.front_geojson(arrival_s, land, at_s, at_s, start_area=start)
        areas = {"burned_ha_before": before.burned_ha, "burned_ha_after": after.burned_ha}
        return encode({**areas, "front": shape})

    try:
        content = await api.run_in_thread(found)
    except FireModelError as error:
        raise ApiError(422, str(error)) from None
    return Response(content, media_type="application/json")
