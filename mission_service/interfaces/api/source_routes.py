"""Defines the routes of the sources of observations: their contributions and footprints."""

from typing import Annotated

from fastapi import APIRouter, Query, Response

from mission_service.interfaces import examples
from mission_service.interfaces.api.context import ApiContext
from mission_service.interfaces.api.openapi import V1, json, route, structs
from mission_service.interfaces.api.responses import answer, encode
from mission_service.interfaces.maps.footprints import footprints_geojson
from mission_service.runtime.published_states import SourceState

GEOJSON = "application/geo+json"
LARGEST = 2**53
After = Annotated[int, Query(ge=0, le=LARGEST, description="The last `number` received.")]


def add(routes: APIRouter, api: ApiContext) -> None:
    """Add ``/fire/sources`` and ``GET /fire/observations``."""
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
