"""Defines the routes of a replay: its state, and the control of pause, speed and position."""

from fastapi import APIRouter, Request, Response

from mission_service.core.request_events import REPLAY
from mission_service.interfaces.api.context import ApiContext
from mission_service.interfaces.api.openapi import V1, body, route, struct
from mission_service.interfaces.api.responses import ApiError, answer
from mission_service.requests import Replay, summary_of
from mission_service.runtime.play_head import ReplayState


def add(routes: APIRouter, api: ApiContext) -> None:
    """Add ``/replay``."""

    def state() -> ReplayState:
        if api.context.replay is None:
            raise ApiError(404, "this run is not a replay")
        return api.context.replay()

    shown = struct(ReplayState)

    @routes.get(f"{V1}/replay", **route("look", "Time and speed of the replay.", shown))
    async def replay() -> Response:
        return answer(state())

    @routes.post(f"{V1}/replay", **route("fly", summary_of(Replay), shown, body(Replay)))
    async def control(request: Request) -> Response:
        state()
        await api.ask(request, REPLAY)
        return answer(state())
