"""Defines the routes of the journal: its current and its earlier segments."""

import asyncio
import os
from collections.abc import AsyncIterator
from functools import partial
from typing import Annotated, BinaryIO

from fastapi import APIRouter, Query, Response
from starlette.responses import StreamingResponse

from mission_service.interfaces.api.context import ApiContext
from mission_service.interfaces.api.journal_lines import JournalLines
from mission_service.interfaces.api.openapi import V1, route
from mission_service.interfaces.api.responses import ApiError
from mission_service.journal.journal_file import segment_path

LINES = "application/x-ndjson"
MAX_LINES, MAX_BYTES = 5000, 1 << 20
PART_BYTES = 1 << 18
LARGEST = 2**53
Segment = Annotated[
    int | None, Query(ge=1, le=LARGEST, description="Number of the segment; default: the newest.")
]


def add(routes: APIRouter, api: ApiContext) -> None:
    """Add ``/journal`` and ``/journal/file``."""
    journal = JournalLines()
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
        number, file = _opened(api, segment)
        with file:
            found, last = await api.run_in_thread(
                partial(journal.after, file, after, limit, MAX_BYTES)
            )
        headers = {"x-last-line": str(last), "x-segment": str(number)}
        return Response(found, headers=headers, media_type=LINES)

    @routes.get(f"{V1}/journal/file", **route("look", "A segment as a file.", lines))
    async def journal_file(segment: Segment = None) -> Response:
        number, file = _opened(api, segment)
        size = os.fstat(file.fileno()).st_size
        headers = {
            "content-length": str(size),
            "content-disposition": f'attachment; filename="journal-{number:06d}.jsonl"',
        }
        return StreamingResponse(_parts(file, size), headers=headers, media_type=LINES)


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
    """Yield the first ``size`` bytes of a file, in parts; the file may grow meanwhile."""
    with file:
        while size > 0 and (part := await asyncio.to_thread(file.read, min(size, PART_BYTES))):
            size -= len(part)
            yield part
