"""Defines the routes of vehicles: states, tracks and importances."""

from typing import Annotated

from fastapi import APIRouter, Query, Response

from mission_service.interfaces import examples
from mission_service.interfaces.api.context import ApiContext
from mission_service.interfaces.api.importance import importance_of
from mission_service.interfaces.api.models import Importance
from mission_service.interfaces.api.openapi import V1, json, route, struct, structs
from mission_service.interfaces.api.responses import ApiError, answer, encode
from mission_service.runtime.published_states import VehicleState
from mission_service.runtime.track import track_geojson

MAX_POINTS = 5000
GEOJSON = "application/geo+json"


def add(routes: APIRouter, api: ApiContext) -> None:
    """Add the routes below ``/vehicles``."""

    @routes.get(f"{V1}/vehicles", **route("look", "All vehicles.", structs(VehicleState)))
    async def vehicles() -> Response:
        return answer(list(api.context.state_view.vehicles.values()))

    @routes.get(f"{V1}/vehicles/{{name}}", **route("look", "One vehicle.", struct(VehicleState)))
    async def vehicle(name: str) -> Response:
        return answer(api.vehicle(name))

    @routes.get(
        f"{V1}/vehicles/{{name}}/track",
        **route("look", "Track of the vehicle, once a second.", json(examples.TRACK, GEOJSON)),
    )
    async def track(
        name: str,
        after_us: Annotated[int, Query(description="Only points after this time.")] = -(2**53),
        limit: Annotated[int, Query(ge=2, le=MAX_POINTS)] = 3600,
    ) -> Response:
        api.vehicle(name)
        latest = api.context.state_view.statistics.vehicles[name].track[-limit:]
        points = [point for point in latest if point[0] > after_us]
        return Response(encode(track_geojson(name, points)), media_type=GEOJSON)

    @routes.get(
        f"{V1}/vehicles/{{name}}/importance",
        **route(
            "look",
            "Importance of each cell of the estimated front, behind and ahead of the vehicle.",
            struct(Importance),
        ),
    )
    async def importance(name: str) -> Response:
        found = importance_of(api.context, api.vehicle(name))
        if found is None:
            rule = api.context.scenario.planner.rule
            raise ApiError(404, f"{name}: no importance values yet, or the rule {rule} has none")
        return answer(found)
