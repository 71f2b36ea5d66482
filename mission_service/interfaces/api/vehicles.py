"""Routes of vehicles: positions, tracks, importances and orders."""

from collections.abc import Awaitable, Callable
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from mission_service.core import requests
from mission_service.interfaces.api import examples
from mission_service.interfaces.api.answers import ApiError, answer, encode
from mission_service.interfaces.api.context import Api
from mission_service.interfaces.api.described import V1, body, json, route, struct, structs
from mission_service.interfaces.api.importance import importance_of
from mission_service.interfaces.api.states import Importance, Told
from mission_service.runtime.picture import VehicleState
from mission_service.runtime.track import track_geojson

MOST_POINTS = 5000
GEOJSON = "application/geo+json"
ORDERS: dict[str, tuple[type[requests.Request], str]] = {
    "hold": (requests.Hold, "Loiter where it is until somebody says otherwise."),
    "resume": (requests.Resume, "Fly on by the planner, after hold, return or abort."),
    "return": (requests.Return, "Fly home."),
    "start": (requests.Start, "Arm and fly the mission on board."),
}
NAME = "All vehicles: `all`."


def add(routes: APIRouter, api: Api) -> None:
    """Add ``/vehicles`` and the orders of ``ORDERS``."""

    @routes.get(
        f"{V1}/vehicles", **route("look", "All vehicles.", structs(VehicleState, examples.VEHICLE))
    )
    async def vehicles() -> Response:
        return answer(list(api.hub.picture.vehicles.values()))

    @routes.get(
        f"{V1}/vehicles/{{name}}",
        **route("look", "One vehicle.", struct(VehicleState, examples.VEHICLE)),
    )
    async def vehicle(name: str) -> Response:
        return answer(api.vehicle(name))

    @routes.get(
        f"{V1}/vehicles/{{name}}/track",
        **route("look", "Where it was, once a second.", json(examples.TRACK, GEOJSON)),
    )
    async def track(
        name: str,
        after_us: Annotated[int, Query(description="Only what is later.")] = -(2**53),
        limit: Annotated[int, Query(ge=2, le=MOST_POINTS)] = 3600,
    ) -> Response:
        api.vehicle(name)
        latest = api.hub.record.vehicles[name].track[-limit:]
        points = [point for point in latest if point[0] > after_us]
        return Response(encode(track_geojson(name, points)), media_type=GEOJSON)

    @routes.get(
        f"{V1}/vehicles/{{name}}/importance",
        **route(
            "look",
            "What speaks for turning back and for going on, cell by cell of the believed front.",
            struct(Importance, examples.IMPORTANCE),
        ),
    )
    async def importance(name: str) -> Response:
        found = importance_of(api.hub, api.vehicle(name))
        if found is None:
            rule = api.hub.scenario.planner.rule
            raise ApiError(404, f"{name}: no importances yet, or the rule {rule} has none")
        return answer(found)

    def ordering(do: str) -> Callable[[str, Request], Awaitable[Response]]:
        async def order(name: str, request: Request) -> Response:
            if name != "all":
                api.vehicle(name)
            return await api.ask(request, do, vehicle="" if name == "all" else name)

        return order

    for do, (kind, summary) in ORDERS.items():
        described = route(
            "fly", f"{summary} {NAME}", struct(Told, examples.TOLD), body(kind, {}, ("vehicle",))
        )
        routes.add_api_route(
            f"{V1}/vehicles/{{name}}/{do}",
            ordering(do),
            methods=["POST"],
            operation_id=do,
            **described,
        )
