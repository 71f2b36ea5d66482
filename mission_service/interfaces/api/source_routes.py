"""Defines the routes of observation sources: contributions, footprints and images."""

from functools import partial
from typing import Annotated

from fastapi import APIRouter, Query, Response

from mission_service.interfaces import examples
from mission_service.interfaces.api.context import ApiContext
from mission_service.interfaces.api.openapi import V1, file, json, route, structs
from mission_service.interfaces.api.responses import ApiError, answer, encode
from mission_service.interfaces.maps.draped_images import MapImage, described
from mission_service.interfaces.maps.footprints import footprints_geojson
from mission_service.runtime.published_states import SourceState

GEOJSON = "application/geo+json"
LARGEST = 2**53
After = Annotated[int, Query(ge=0, le=LARGEST, description="The last `number` received.")]


def add(routes: APIRouter, api: ApiContext) -> None:
    """Add ``/fire/sources``, ``GET /fire/observations`` and ``/fire/images``."""
    context = api.context

    @routes.get(
        f"{V1}/fire/sources",
        **route(
            "look",
            "The contribution and the state of each source of observations.",
            structs(SourceState),
        ),
    )
    async def sources() -> Response:
        return answer(context.state_view.sources())

    @routes.get(
        f"{V1}/fire/observations",
        **route("look", "The latest observations.", json(examples.FOOTPRINTS, GEOJSON)),
    )
    async def observations(after: After = 0) -> Response:
        stored = context.state_view.statistics.sources.footprints
        new = [each for each in stored if each.number > after]
        content = await api.run_in_thread(
            lambda: encode(footprints_geojson(new, context.landscape))
        )
        return Response(content, media_type=GEOJSON)

    @routes.get(
        f"{V1}/fire/images",
        **route("look", "The latest images of the sensors, the newest last.", structs(MapImage)),
    )
    async def images() -> Response:
        return answer(
            [
                described(source, each, context.landscape)
                for source, images in context.service.sensors.images().items()
                for each in images
            ]
        )

    @routes.get(
        f"{V1}/fire/images/{{source}}/{{number}}.png",
        **route("look", "An image of a sensor on the ground, as an overlay.", file("image/png")),
    )
    async def image(source: str, number: int) -> Response:
        latest = context.service.sensors.images().get(source, ())
        for each in latest:
            if each.number == number:
                draw = partial(api.pictures.png, source, each)
                return Response(await api.run_in_thread(draw), media_type="image/png")
        raise ApiError(404, f"no image {number} of {source!r}"[:120])
