"""Reads uploaded files in a separate process (``maps/upload_worker.py``)."""

import asyncio
import subprocess

import msgspec

from mission_service.interfaces.api.responses import ApiError
from mission_service.interfaces.maps.upload_worker import (
    Done,
    Failed,
    Job,
    RasterDone,
    RasterJob,
)
from mission_service.interfaces.maps.worker_run import worker_output
from mission_service.sensors.worker_process import WITHIN_S, command_of, end_of

WORKER = command_of("mission_service.interfaces.maps.upload_worker")
_decode = msgspec.json.Decoder(Done | RasterDone | Failed).decode


async def read_in_process(job: Job | RasterJob) -> Done | RasterDone:
    """Read an upload; return a perimeter and the resulting corrections, or a raster.

    Raises ApiError 422 if the file is unusable, or if the process that reads it crashes or is slow.
    """
    data = msgspec.msgpack.encode(job)
    try:
        code, output, _ = await worker_output(WORKER, data, WITHIN_S, subprocess.DEVNULL)
    except TimeoutError:
        text = f"reading the file takes more than {WITHIN_S:g} s; simplify it"
        raise ApiError(422, text) from None
    if code != 0:
        raise ApiError(
            422,
            f"the process that read the file ended with {end_of(code)}; simplify the file",
        )
    answer: Done | RasterDone | Failed = await asyncio.to_thread(_decode, output)
    if isinstance(answer, Failed):
        raise ApiError(422, answer.error)
    return answer
