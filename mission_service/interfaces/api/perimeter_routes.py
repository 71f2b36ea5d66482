"""Reads uploaded files in a separate process (``maps/upload_worker.py``)."""

import asyncio

import msgspec

from mission_service.interfaces.api.responses import ApiError
from mission_service.interfaces.maps.upload_worker import (
    Done,
    Failed,
    Job,
    RasterDone,
    RasterJob,
)
from mission_service.sensors.worker_process import WITHIN_S, command_of, end_of

WORKER = command_of("mission_service.interfaces.maps.upload_worker")
_decode = msgspec.json.Decoder(Done | RasterDone | Failed).decode


async def read_in_process(job: Job | RasterJob) -> Done | RasterDone:
    """Read an upload; return a perimeter and the resulting corrections, or a raster.

    Raises ApiError 422 if the file is unusable, or if the process that reads it crashes or is slow.
    """
    process = await asyncio.create_subprocess_exec(
        *WORKER,
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
    )
    try:
        async with asyncio.timeout(WITHIN_S):
            output, _ = await process.communicate(msgspec.msgpack.encode(job))
    except TimeoutError:
        text = f"reading the file takes more than {WITHIN_S:g} s; simplify it"
        raise ApiError(422, text) from None
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    if process.returncode != 0:
        raise ApiError(
            422,
            f"the process that read the file ended with {end_of(process.returncode or 0)}; "
            "simplify the file",
        )
    answer: Done | RasterDone | Failed = await asyncio.to_thread(_decode, output)
    if isinstance(answer, Failed):
        raise ApiError(422, answer.error)
    return answer
