"""What the routes share: the run, who may ask, and what is kept between requests."""

import asyncio
from collections.abc import Callable
from typing import Any, TypeVar
from urllib.parse import parse_qsl

from fastapi import Request, Response

from mission_service.config.sections import BURN
from mission_service.core.requests import NOT_OF_BURNS, OF_BURNS, REPLAY
from mission_service.interfaces.api.access.auth import Tokens, Who
from mission_service.interfaces.api.answers import ApiError, answer, asked
from mission_service.interfaces.api.frames import Frames
from mission_service.interfaces.api.live import Streams
from mission_service.interfaces.maps.run_forecasts import forecasts_of
from mission_service.interfaces.maps.terrain import TerrainTiles
from mission_service.runtime.hub import Hub
from mission_service.runtime.picture import VehicleState

MOST_THREADS = 2  # at once: those who look must not slow down those who fly

Result = TypeVar("Result")


class Api:
    """One run as its interface has it. ``wall_us`` is the time since 1970."""

    def __init__(self, hub: Hub, tokens: Tokens, wall_us: Callable[[], int]) -> None:
        self.hub = hub
        self.tokens = tokens
        self.wall_us = wall_us
        self.frames = Frames(hub, wall_us)
        self.streams = Streams(self.frames, lambda: asyncio.get_running_loop().time())
        self.forecasts = forecasts_of(hub)
        self.tiles = TerrainTiles(hub.landscape)
        self._threads = asyncio.Semaphore(MOST_THREADS)
        self.uploads = asyncio.Semaphore(1)  # read at once

    def close(self) -> None:
        """Give up what is being worked out."""
        self.forecasts.close()

    async def aside(self, work: Callable[[], Result]) -> Result:
        """Do what takes long in a thread, after others who asked for such before."""
        async with self._threads:
            return await asyncio.to_thread(work)

    def vehicle(self, name: str) -> VehicleState:
        """Raises ApiError 404 for a vehicle that this run has not."""
        vehicle = self.hub.picture.vehicles.get(name)
        if vehicle is None:
            there = ", ".join(self.hub.picture.vehicles)
            raise ApiError(404, f"no vehicle {name[:40]!r}; there are {there}")
        return vehicle

    async def ask(self, request: Request, do: str, **named: Any) -> Response:
        """Ask the desk for what the body says; ``named`` is what the path says of it."""
        wanted = await asked(request)
        for key in ("do", *named):
            if key in wanted:
                raise ApiError(422, f"{do}: unknown key {key}: the address says it")
        return answer(self.desk(request.state.who, {**wanted, **named, "do": do}))

    def abort(self, who: Who, query_string: bytes) -> dict[str, Any]:
        """Carry out an abort; returns the reply. The body, which may be incomplete, is not read.

        ``query_string``: ``by`` and ``station``, where a token leaves them open. Raises ApiError.
        """
        wanted = dict(parse_qsl(query_string.decode("latin-1")))
        by = who.name if self.tokens.named else wanted.get("by", who.name)
        station = who.station or wanted.get("station", "") or self._only_station()
        found = self.hub.desk.ask({"do": "abort", "by": by, "station": station})
        self.hub.ring()
        if not found["ok"]:
            if self.hub.replay is not None:
                raise ApiError(409, str(found["error"]))
            raise ApiError(507, str(found["error"]))  # an abort is refused for nothing else
        return found

    def desk(self, who: Who, wanted: dict[str, Any]) -> dict[str, Any]:
        """The desk's answer. Raises ApiError for what it refuses."""
        given = {**wanted, **self._who_asks(who, wanted)}
        may_approve = who.may("approve") if self.tokens.named else None
        found = self.hub.desk.ask(given, may_approve)
        self.hub.ring()
        if not found["ok"]:
            if self.hub.service.recording.trouble:
                raise ApiError(507, str(found["error"]))
            do = wanted["do"]
            if self.hub.replay is not None and do != REPLAY:
                raise ApiError(409, str(found["error"]))
            elsewhere = OF_BURNS if self.hub.scenario.planner.rule != BURN else NOT_OF_BURNS
            raise ApiError(409 if do in elsewhere else 422, str(found["error"]))
        return found

    def _who_asks(self, who: Who, wanted: dict[str, Any]) -> dict[str, Any]:
        """Under which name and from where: by the token, where it is somebody's own."""
        by = wanted.get("by", who.name)
        if self.tokens.named and by != who.name:
            raise ApiError(403, f"this token is {who.name}'s, nobody else's")
        station = wanted.get("station") or who.station or self._only_station()
        if who.station and station != who.station:
            raise ApiError(403, f"this token is for station {who.station} alone")
        return {"by": by, "station": station}

    def _only_station(self) -> str:
        """The only station there is; a word for the interface where stations do not matter."""
        burn = self.hub.scenario.burn
        stations = [] if burn is None else [station.name for station in burn.stations]
        return stations[0] if len(stations) == 1 else "http" if not stations else ""
