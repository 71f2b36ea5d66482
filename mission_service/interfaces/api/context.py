"""Holds the objects that the routes share: the run, tokens, caches and limits."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import parse_qsl

from fastapi import Request, Response

from mission_service.core.request_events import ABORT, event_of
from mission_service.errors import MissionServiceError, did_you_mean
from mission_service.events import AnyOperatorEvent
from mission_service.interfaces.api.access.auth import Tokens, User
from mission_service.interfaces.api.frames import Frames
from mission_service.interfaces.api.live_stream import Streams
from mission_service.interfaces.api.responses import ApiError, answer, json_body
from mission_service.interfaces.maps.basemaps.tile_files import TileFile, tile_files
from mission_service.interfaces.maps.draped_images import ImagePictures
from mission_service.interfaces.maps.terrain import TerrainTiles
from mission_service.runtime.published_states import VehicleState
from mission_service.runtime.run_context import RunContext

MAX_THREADS = 2  # threads in use at once; requests must not delay the flight

Result = TypeVar("Result")


class ApiContext:
    """The objects that all routes share. ``wall_us`` returns the microseconds since 1970."""

    def __init__(self, context: RunContext, tokens: Tokens, wall_us: Callable[[], int]) -> None:
        self.context = context
        self.tokens = tokens
        self.wall_us = wall_us
        self.frames = Frames(context, wall_us)
        self.streams = Streams(self.frames, lambda: asyncio.get_running_loop().time())
        self.tiles = TerrainTiles(context.landscape)
        self.pictures = ImagePictures(context.landscape)
        self.basemaps = self._basemaps()
        self._threads = asyncio.Semaphore(MAX_THREADS)
        self.uploads = asyncio.Semaphore(1)  # reads one perimeter at a time
        self.raster_uploads = asyncio.Semaphore(1)  # detectors do not delay perimeters

    def _basemaps(self) -> dict[str, TileFile]:
        """Open the basemaps of the configured folder; announce files that are not usable."""
        http = self.context.settings.http
        if http is None or http.basemaps is None:
            return {}
        found, problems = tile_files(Path(http.basemaps))
        for problem in problems:
            self.context.service.announce("service", problem)
        return found

    async def run_in_thread(self, work: Callable[[], Result]) -> Result:
        """Run ``work`` in a thread; at most ``MAX_THREADS`` run at the same time."""
        async with self._threads:
            return await asyncio.to_thread(work)

    def vehicle(self, name: str) -> VehicleState:
        """Return the state of a vehicle. Raises ApiError 404 for an unknown name."""
        vehicle = self.context.state_view.vehicles.get(name)
        if vehicle is None:
            known = self.context.state_view.vehicles
            listed = f"{', '.join(known)}{did_you_mean(name, known)}"
            raise ApiError(404, f"no vehicle {name[:40]!r}; the vehicles are {listed}")
        return vehicle

    async def ask(self, request: Request, do: str, **named: Any) -> Response:
        """Handle the request ``do``, with keys from the body and, in ``named``, from the path.

        Raises ApiError.
        """
        body = await json_body(request)
        for key in ("do", *named):
            if key in body:
                raise ApiError(422, f"{do}: unknown key {key!r}: the path contains its value")
        return answer(await self.handle(request.state.user, {**body, **named, "do": do}))

    def abort(self, user: User, query_string: bytes) -> dict[str, Any]:
        """Carry out an abort without its body, which may be incomplete; return the reply.

        ``query_string`` may contain ``by`` and ``station``, which apply if the token does not
        determine them. Raises ApiError.
        """
        query = dict(parse_qsl(query_string.decode("latin-1")))
        by = user.name if self.tokens.named else query.get("by", user.name)
        station = user.station or query.get("station", "") or self._only_station()
        found = self.context.request_handler.ask({"do": ABORT, "by": by, "station": station})
        self.context.ring()
        if not found["ok"]:
            # In a live run only a journal that cannot be written prevents an abort.
            raise ApiError(507 if self.context.replay is None else 409, str(found["error"]))
        return found

    async def handle(self, user: User, request: dict[str, Any]) -> dict[str, Any]:
        """Handle a request of ``user``; return the reply. Raises ApiError for a refused request."""
        request = {**request, **self._requesting_operator(user, request)}
        may_approve = user.may("approve") if self.tokens.named else None
        role = user.highest_role if self.tokens.named else ""
        found = await self.context.request_handler.ask_and_wait(request, may_approve, role)
        self.context.ring()
        if not found["ok"]:
            if self.context.service.recording.trouble:
                raise ApiError(507, str(found["error"]))
            is_accepted = request["do"] in self.context.request_handler.scope.accepted
            raise ApiError(422 if is_accepted else 409, str(found["error"]))
        return found

    def event_of(self, user: User, request: dict[str, Any]) -> AnyOperatorEvent:
        """Return the event that a request of ``user`` would make. Raises ApiError."""
        handler, at_us = self.context.request_handler, self.context.clock.now_us
        request = {**request, **self._requesting_operator(user, request)}
        if request.get("do") not in handler.scope.accepted:  # refused without an event
            raise ApiError(409, str(handler.ask(request)["error"]))
        try:
            return event_of(request, at_us, handler.scope)
        except MissionServiceError as error:
            raise ApiError(422, str(error)) from None

    def _requesting_operator(self, user: User, request: dict[str, Any]) -> dict[str, Any]:
        """Return the name and the station that a request contains.

        Raises ApiError 403 if the name or the station differs from that of a personal token.
        """
        by = request.get("by", user.name)
        if self.tokens.named and by != user.name:
            raise ApiError(403, f"this token is valid only with by = {user.name}")
        station = request.get("station") or user.station or self._only_station()
        if user.station and station != user.station:
            raise ApiError(403, f"this token is valid only for station {user.station}")
        return {"by": by, "station": station}

    def _only_station(self) -> str:
        """Return a burn's only station, "" if there are several, or ``http`` if there is none."""
        burn = self.context.scenario.burn
        stations = [] if burn is None else [station.name for station in burn.stations]
        return stations[0] if len(stations) == 1 else "http" if not stations else ""
