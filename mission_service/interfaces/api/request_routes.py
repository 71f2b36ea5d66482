"""Generates the routes of all requests that make events, from the table of requests."""

from collections.abc import Awaitable, Callable

import msgspec
from fastapi import APIRouter, Response
from fastapi import Request as HttpRequest

from mission_service.config.sections import ALL
from mission_service.core.request_events import ABORT, REQUESTS
from mission_service.interfaces import examples
from mission_service.interfaces.api.context import ApiContext
from mission_service.interfaces.api.models import RequestResult
from mission_service.interfaces.api.openapi import V1, body, route, struct
from mission_service.requests import Request, name_of, summary_of
from mission_service.runtime.request_handler import CHANGES_AREA


def add(routes: APIRouter, api: ApiContext) -> None:
    """Add the routes of all requests except the abort, which the access guard carries out."""
    for do, kind in REQUESTS.items():
        if do == ABORT:
            continue
        of_vehicle = "{name}" in kind.path
        for_all = of_vehicle and _has_optional_vehicle(kind)
        summary = summary_of(kind) + (f" All vehicles: `{ALL}`." if for_all else "")
        routes.add_api_route(
            f"{V1}{kind.path.replace('{do}', do)}",
            _vehicle_endpoint(api, do, for_all) if of_vehicle else _endpoint(api, do),
            methods=[kind.method],
            name=do,
            operation_id=kind.operation and kind.operation.format(do=do),
            **route(
                kind.role,
                summary,
                struct(RequestResult, _reply_to(kind)),
                body(kind, ("vehicle",) if of_vehicle else ()),
            ),
        )


def _endpoint(api: ApiContext, do: str) -> Callable[[HttpRequest], Awaitable[Response]]:
    async def ask(request: HttpRequest) -> Response:
        return await api.ask(request, do)

    return ask


def _vehicle_endpoint(
    api: ApiContext, do: str, for_all: bool
) -> Callable[[str, HttpRequest], Awaitable[Response]]:
    async def ask(name: str, request: HttpRequest) -> Response:
        vehicle = "" if for_all and name == ALL else api.vehicle(name).vehicle
        return await api.ask(request, do, vehicle=vehicle)

    return ask


def _has_optional_vehicle(kind: type[Request]) -> bool:
    return any(
        each.name == "vehicle" and not each.required for each in msgspec.structs.fields(kind)
    )


def _reply_to(kind: type[Request]) -> dict[str, object]:
    """Return an example of the reply to a request."""
    user = {"do": name_of(kind), "by": "anna", "station": "west"}
    event = msgspec.convert({**user, **kind.example}, kind).event(0)
    areas = {"burned_ha_before": 329.4, "burned_ha_after": 331.2}
    reply = {**examples.ACCEPTED, "event": type(event).__name__}
    return {**reply, "messages": [], **areas} if isinstance(event, CHANGES_AREA) else reply
