"""Routes of a replay: its state, pause, speed and position."""

from fastapi import APIRouter, Request, Response

from mission_service.core import requests
from mission_service.interfaces.api import examples
from mission_service.interfaces.api.answers import ApiError, answer
from mission_service.interfaces.api.context import Api
from mission_service.interfaces.api.described import V1, body, route, struct
from mission_service.runtime.play_head import ReplayState


def add(routes: APIRouter, api: Api) -> None:
    """Add ``/replay``."""

    def state() -> ReplayState:
        if api.hub.replay is None:
            raise ApiError(404, "this run is no replay")
        return api.hub.replay()

    shown = struct(ReplayState, examples.REPLAY)

    @routes.get(f"{V1}/replay", **route("look", "Where a replay is, and how fast.", shown))
    async def replay() -> Response:
        return answer(state())

    @routes.post(
        f"{V1}/replay",
        **route(
            "fly",
            "Pause it or go on, at another speed (0.1 to 100, or max) or from another place.",
            shown,
            body(requests.Replay, {"paused": False, "speed": 4.0, "seek_s": 120.0}),
        ),
    )
    async def control(request: Request) -> Response:
        state()
        await api.ask(request, requests.REPLAY)
        return answer(state())
