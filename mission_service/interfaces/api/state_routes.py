"""Defines the routes of the whole state, the live stream, announcements, aircraft and abort."""

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from mission_service.airspace.operational_intent import OperationalIntents
from mission_service.fire_arrival.arrival_times import FireArrival
from mission_service.interfaces import examples
from mission_service.interfaces.api.access.auth import ROLES, User
from mission_service.interfaces.api.context import ApiContext
from mission_service.interfaces.api.live_stream import MAX_STREAMS, LiveStream
from mission_service.interfaces.api.models import FullState, RequestResult, land_of, status_of
from mission_service.interfaces.api.openapi import OPERATOR_FIELDS, V1, route, struct, structs
from mission_service.interfaces.api.planner_routes import planner_of
from mission_service.interfaces.api.responses import ApiError, answer
from mission_service.runtime.published_states import (
    AirspaceStatus,
    Announcement,
    NearbyAircraft,
    Record,
)

LARGEST = 2**53
BY, STATION = OPERATOR_FIELDS["by"]["description"], OPERATOR_FIELDS["station"]["description"]
GEOID = "Height of the geoid (mean sea level) above the WGS84 ellipsoid at the field, in metres."
FOR_S = "Time until the landing of a vehicle without an estimate of its energy, in seconds."
GeoidHeight = Annotated[float, Query(ge=-120, le=100, description=GEOID)]
UntilLanding = Annotated[float, Query(ge=60, le=86_400, description=FOR_S)]
Since = Annotated[int, Query(ge=0, le=LARGEST, description="The version that the client has.")]


def add(routes: APIRouter, api: ApiContext) -> None:
    """Add the routes of state, airspace, other aircraft, live stream, announcements and abort."""
    land = land_of(api.context)

    @routes.get(
        f"{V1}/state", **route("look", "Complete state for a new client.", struct(FullState))
    )
    async def state(request: Request) -> Response:
        context, user = api.context, request.state.user
        state_view = context.state_view
        return answer(
            FullState(
                state_view.version,
                status_of(context, api.wall_us()),
                tuple(role for role in ROLES if user.may(role)),
                user.name,
                list(state_view.vehicles.values()),
                list(state_view.telemetry.values()),
                list(state_view.missions.values()),
                context.fire(),
                context.burn(),
                list(state_view.alarms.values()),
                list(state_view.announcements),
                land,
                context.scenario.planner.rule,
                planner_of(context),
                None if context.replay is None else context.replay(),
                state_view.sources(),
                context.airspace(),
                state_view.aircraft(),
                list(state_view.records),
                context.arrivals,
            )
        )

    @routes.get(
        f"{V1}/airspace", **route("look", "Closed volumes of airspace.", struct(AirspaceStatus))
    )
    async def airspace() -> Response:
        return answer(api.context.airspace())

    @routes.get(
        f"{V1}/airspace/intents",
        **route(
            "look",
            "Volumes of the vehicles' flights as operational intents (ASTM F3548-21).",
            struct(OperationalIntents),
        ),
    )
    async def intents(geoid_height_m: GeoidHeight, for_s: UntilLanding = 3600.0) -> Response:
        found = api.context.operational_intents(geoid_height_m, for_s, api.wall_us())
        return answer(found)

    text = {"type": "string"}
    event = {"type": "object", "properties": {"event": text, "id": text, "data": text}}
    stream = {"text/event-stream": {"schema": event}}

    @routes.get(
        f"{V1}/live",
        **route("look", "Changes from now on, as server-sent events.", stream),
        response_model=None,
    )
    async def live(request: Request, since: Since = 0) -> Response:
        if api.streams.full:
            text = f"{MAX_STREAMS} live streams are open, which is the limit"
            raise ApiError(503, text, {"retry-after": "10"})
        user: User = request.state.user
        return LiveStream(api.streams, since, lambda: api.tokens.still(user))

    @routes.get(
        f"{V1}/announcements",
        **route("look", "The latest 500 announcements.", structs(Announcement)),
    )
    async def announcements(after: Annotated[int, Query(ge=0, le=LARGEST)] = 0) -> Response:
        return answer([line for line in api.context.state_view.announcements if line.id > after])

    @routes.get(
        f"{V1}/records",
        **route(
            "look",
            "The latest 500 lines of the log that are not announced: corrections of the fire, "
            "wind, settings, missions and alarms.",
            structs(Record),
        ),
    )
    async def records(after: Annotated[int, Query(ge=0, le=LARGEST)] = 0) -> Response:
        return answer([line for line in api.context.state_view.records if line.id > after])

    @routes.get(
        f"{V1}/aircraft",
        **route("look", "Other aircraft near the vehicles.", structs(NearbyAircraft)),
    )
    async def aircraft() -> Response:
        return answer(api.context.state_view.aircraft())

    @routes.get(
        f"{V1}/fire/arrivals",
        **route(
            "look",
            "When the fire reaches people and values at risk, the earliest first.",
            structs(FireArrival),
        ),
    )
    async def arrivals() -> Response:
        return answer(api.context.arrivals)

    @routes.post(
        f"{V1}/abort",
        **route(
            "look",
            "Abort: all vehicles stop. Any valid token suffices. The service acts when the headers "
            "have arrived.",
            struct(RequestResult, {**examples.ACCEPTED, "event": "Aborted"}),
        ),
    )
    async def abort(
        request: Request,
        by: Annotated[str, Query(description=BY)] = "",
        station: Annotated[str, Query(description=STATION)] = "",
    ) -> Response:
        return answer(request.state.aborted)  # the guard has carried out the abort
