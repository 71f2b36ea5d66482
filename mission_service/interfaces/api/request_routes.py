"""Routes of all requests that become events, generated from the table of requests."""

from collections.abc import Awaitable, Callable

import msgspec
from fastapi import APIRouter, Response
from fastapi import Request as HttpRequest

from mission_service.core.request_events import ABORT, REQUESTS
from mission_service.interfaces import examples
from mission_service.interfaces.api.context import ApiContext
from mission_service.interfaces.api.models import RequestResult
from mission_service.interfaces.api.openapi import V1, body, route, struct
from mission_service.requests import Request, name_of, summary_of
from mission_service.runtime.request_handler import CHANGES_AREA

ALL = "all"  # in place of a vehicle's name, where a request may be for all of them


def add(routes: APIRouter, api: ApiContext) -> None:
    """Add the routes of all requests except the abort, which the guard carries out."""
    for do, kind in REQUESTS.items():
        if do == ABORT:
            continue
        of_vehicle = "{name}" in kind.path
        for_all = of_vehicle and _may_be_for_all(kind)
        summary = summary_of(kind) + (f" All vehicles: `{ALL}`." if for_all else "")
        routes.add_api_route(
            f"{V1}{kind.path.replace('{do}', do)}",
            _asking_vehicle(api, do, for_all) if of_vehicle else _asking(api, do),
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


def _asking(api: ApiContext, do: str) -> Callable[[HttpRequest], Awaitable[Response]]:
    async def ask(request: HttpRequest) -> Response:
        return await api.ask(request, do)

    return ask


def _asking_vehicle(
    api: ApiContext, do: str, for_all: bool
) -> Callable[[str, HttpRequest], Awaitable[Response]]:
    async def ask(name: str, request: HttpRequest) -> Response:
        if for_all and name == ALL:
            return await api.ask(request, do, vehicle="")
        return await api.ask(request, do, vehicle=api.vehicle(name).vehicle)

    return ask


def _may_be_for_all(kind: type[Request]) -> bool:
    fields = {each.name: each for each in msgspec.structs.fields(kind)}
    return not fields["vehicle"].required


def _reply_to(kind: type[Request]) -> dict[str, object]:
    """Return an example of a reply."""
    user = {"do": name_of(kind), "by": "anna", "station": "west"}
    event = msgspec.convert({**user, **kind.example}, kind).event(0)
    areas = {"burned_ha_before": 329.4, "burned_ha_after": 331.2}
    told = {**examples.ACCEPTED, "event": type(event).__name__}
    return {**told, "messages": [], **areas} if isinstance(event, CHANGES_AREA) else told
