"""Defines the routes of the journal: its segments, photos, and the products made from it."""

import asyncio
import os
import subprocess
from collections.abc import AsyncIterator
from functools import partial
from typing import Annotated, BinaryIO

import msgspec
from fastapi import APIRouter, Query, Request, Response
from pydantic import AwareDatetime
from starlette.responses import StreamingResponse

from mission_service.interfaces.api.context import ApiContext
from mission_service.interfaces.api.journal_lines import JournalLines
from mission_service.interfaces.api.openapi import V1, file, json, route
from mission_service.interfaces.api.responses import (
    MAX_PERIMETER_BYTES,
    ApiError,
    answer,
    body_of,
)
from mission_service.interfaces.maps.products_worker import ProductsJob
from mission_service.interfaces.maps.worker_run import worker_output
from mission_service.journal.journal_file import segment_path
from mission_service.sensors.worker_process import command_of, end_of
from mission_service.uploaded_photos import MEDIA_TYPES, PhotoError, photo_path, store_photo

LINES, ZIP = "application/x-ndjson", "application/zip"
WORKER = command_of("mission_service.interfaces.maps.products_worker")
MADE_WITHIN_S = 300.0
MAX_FORECAST_H = 6.0
MAX_LINES, MAX_BYTES = 5000, 1 << 20
PART_BYTES = 1 << 18
LARGEST = 2**53
Segment = Annotated[
    int | None, Query(ge=1, le=LARGEST, description="Number of the segment; default: the newest.")
]

TimeZero = Annotated[
    AwareDatetime | None,
    Query(description="Calendar time of mission time 0; default: time_zero of the scenario."),
]


def add(routes: APIRouter, api: ApiContext) -> None:
    """Add ``/journal``, ``/journal/file``, ``/photos`` and ``/products.zip``."""
    journal = JournalLines()
    _add_photos(routes, api)
    lines = {LINES: {"schema": {"type": "string"}, "example": '{"event":{},"crc":"00c0ffee"}\n'}}

    @routes.get(
        f"{V1}/journal",
        **route(
            "look",
            "Lines of a segment after a line (1: the header); X-Segment is the number of the "
            "segment, X-Last-Line the number of the last returned line.",
            lines,
        ),
    )
    async def journal_lines(
        after: Annotated[int, Query(ge=0, le=LARGEST)] = 0,
        limit: Annotated[int, Query(ge=1, le=MAX_LINES)] = 500,
        segment: Segment = None,
    ) -> Response:
        number, opened = _opened(api, segment)
        with opened:
            found, last = await api.run_in_thread(
                partial(journal.after, opened, number, after, limit, MAX_BYTES)
            )
        headers = {"x-last-line": str(last), "x-segment": str(number)}
        return Response(found, headers=headers, media_type=LINES)

    @routes.get(f"{V1}/journal/file", **route("look", "A segment as a file.", lines))
    async def journal_file(segment: Segment = None) -> Response:
        number, opened = _opened(api, segment)
        size = os.fstat(opened.fileno()).st_size
        headers = {
            "content-length": str(size),
            "content-disposition": f'attachment; filename="journal-{number:06d}.jsonl"',
        }
        return StreamingResponse(_parts(opened, size), headers=headers, media_type=LINES)

    making = asyncio.Lock()

    @routes.get(
        f"{V1}/products.zip",
        **route(
            "look",
            "Maps, GIS files, KMZ and a log of the present fire: the files of "
            "`mission-service products`.",
            file(ZIP),
        ),
    )
    async def products(
        time_zero: TimeZero = None,
        forecast_h: Annotated[float, Query(ge=0, le=MAX_FORECAST_H)] = 3.0,
    ) -> Response:
        if time_zero is None and api.context.scenario.time_zero is None:
            raise ApiError(
                422,
                "the scenario has no time_zero; add the query parameter time_zero, the calendar "
                "time of mission time 0 with its UTC offset, such as 2026-08-01T14:00-06:00",
            )
        if making.locked():
            raise ApiError(503, "another request for the products is in progress; try again later")
        job = ProductsJob(str(api.context.journal_path), 3600.0 * forecast_h, time_zero)
        async with making:
            content = await _made_in_process(job)
        headers = {"content-disposition": 'attachment; filename="products.zip"'}
        return Response(content, headers=headers, media_type=ZIP)


def _add_photos(routes: APIRouter, api: ApiContext) -> None:
    """Add the routes that store and return photos of notes."""
    media = {media: file(media)[media] for media in MEDIA_TYPES.values()}
    storing = asyncio.Lock()

    @routes.post(
        f"{V1}/photos",
        **route(
            "correct",
            "Store a photo (JPEG, PNG or WebP, 10 MB) beside the journal; its name is the key "
            "`photo` of a note.",
            json({"photo": f"{'0' * 64}.jpg"}),
            media,
        ),
    )
    async def add_photo(request: Request) -> Response:
        if api.context.replay is not None:
            raise ApiError(409, "a replay stores no photos")
        data = await body_of(request, MAX_PERIMETER_BYTES)
        try:
            async with storing:
                name = await api.run_in_thread(partial(store_photo, api.context.out, data))
        except PhotoError as error:
            raise ApiError(422, str(error)) from None
        except OSError as error:
            raise ApiError(507, f"the photo cannot be stored: {error}") from None
        return answer({"photo": name})

    @routes.get(f"{V1}/photos/{{name}}", **route("look", "A photo of a note.", media))
    async def photo(name: str) -> Response:
        path = photo_path(api.context.out, name)
        if path is None:
            raise ApiError(404, f"no photo {name!r}"[:120])
        content = await api.run_in_thread(path.read_bytes)
        return Response(content, media_type=MEDIA_TYPES[path.suffix[1:]])


async def _made_in_process(job: ProductsJob) -> bytes:
    """Make the products in another process; return them as a zip file. Raises ApiError 422."""
    data = msgspec.msgpack.encode(job)
    try:
        code, output, errors = await worker_output(WORKER, data, MADE_WITHIN_S, subprocess.PIPE)
    except TimeoutError:
        text = f"making the products takes more than {MADE_WITHIN_S:g} s; set forecast_h=0"
        raise ApiError(422, text) from None
    if code != 0:
        lines = errors.decode("utf-8", "replace").strip().splitlines()
        ended = f"the process that makes the products ended with {end_of(code)}"
        raise ApiError(422, lines[-1] if code == 1 and lines else ended)
    return output


def _opened(api: ApiContext, segment: int | None) -> tuple[int, BinaryIO]:
    """Return the number and the open file of a segment, by default the newest. Raises ApiError 404.

    The function does not await, so no new segment can begin meanwhile.
    """
    newest = api.context.service.recording.journal.rest.segment
    number = newest if segment is None else segment
    path = api.context.journal_path
    try:
        return number, (path if number == newest else segment_path(path, number)).open("rb")
    except (FileNotFoundError, OverflowError):
        raise ApiError(
            404, f"segment {number} of the journal does not exist or was deleted"
        ) from None


async def _parts(file: BinaryIO, size: int) -> AsyncIterator[bytes]:
    """Yield the first ``size`` bytes of a file in chunks; the file may grow meanwhile."""
    with file:
        while size > 0 and (part := await asyncio.to_thread(file.read, min(size, PART_BYTES))):
            size -= len(part)
            yield part
