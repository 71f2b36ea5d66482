"""Routes of the whole state, the live stream, the announcements and the abort."""

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from mission_service.interfaces import examples
from mission_service.interfaces.api.access.auth import ROLES, Who
from mission_service.interfaces.api.answers import ApiError, answer
from mission_service.interfaces.api.context import Api
from mission_service.interfaces.api.described import V1, WHO, route, struct, structs
from mission_service.interfaces.api.live import MOST_STREAMS, LiveStream
from mission_service.interfaces.api.planner import planner_of
from mission_service.interfaces.api.states import State, Told, land_of, status_of
from mission_service.runtime.published_states import NewsLine

LARGEST = 2**53
BY, STATION = WHO["by"]["description"], WHO["station"]["description"]
Since = Annotated[int, Query(ge=0, le=LARGEST, description="The version that is known already.")]


def add(routes: APIRouter, api: Api) -> None:
    """Add ``/state``, ``/live``, ``/news`` and ``/abort``."""
    land = land_of(api.hub)

    @routes.get(f"{V1}/state", **route("look", "Everything for a new page.", struct(State)))
    async def state(request: Request) -> Response:
        hub, who = api.hub, request.state.who
        picture = hub.picture
        return answer(
            State(
                picture.version,
                status_of(hub, api.wall_us()),
                tuple(role for role in ROLES if who.may(role)),
                who.name,
                list(picture.vehicles.values()),
                list(picture.telemetry.values()),
                list(picture.missions.values()),
                hub.fire(),
                hub.burn(),
                list(picture.alarms.values()),
                list(picture.news),
                land,
                hub.scenario.planner.rule,
                planner_of(hub),
                None if hub.replay is None else hub.replay(),
            )
        )

    text = {"type": "string"}
    event = {"type": "object", "properties": {"event": text, "id": text, "data": text}}
    stream = {"text/event-stream": {"schema": event}}

    @routes.get(
        f"{V1}/live",
        **route("look", "What changes from now on, as server-sent events.", stream),
        response_model=None,
    )
    async def live(request: Request, since: Since = 0) -> Response:
        if api.streams.full:
            text = f"{MOST_STREAMS} live streams are open already"
            raise ApiError(503, text, {"retry-after": "10"})
        who: Who = request.state.who
        return LiveStream(api.streams, since, lambda: api.tokens.still(who))

    @routes.get(
        f"{V1}/news",
        **route("look", "Lines for people, the latest 500.", structs(NewsLine)),
    )
    async def news(after: Annotated[int, Query(ge=0, le=LARGEST)] = 0) -> Response:
        return answer([line for line in api.hub.picture.news if line.id > after])

    @routes.post(
        f"{V1}/abort",
        **route(
            "look",
            "Stop at once: accepted with any valid token, as soon as its headers arrive.",
            struct(Told, {**examples.TOLD, "event": "Aborted"}),
        ),
    )
    async def abort(
        request: Request,
        by: Annotated[str, Query(description=BY)] = "",
        station: Annotated[str, Query(description=STATION)] = "",
    ) -> Response:
        return answer(request.state.aborted)  # the guard has carried it out
