"""Reads uploaded perimeters in a separate process (``maps/perimeter_worker.py``)."""

import asyncio
import signal
import sys

import msgspec

from mission_service.interfaces.api.responses import ApiError
from mission_service.interfaces.maps.perimeter_worker import Done, Failed, Job

WORKER = (sys.executable, "-P", "-m", "mission_service.interfaces.maps.perimeter_worker")
WITHIN_S = 60.0  # wall-clock time; the process limits its own computing time
_decode = msgspec.json.Decoder(Done | Failed).decode


async def read_aside(job: Job) -> Done:
    """Read a perimeter and the corrections that follow from it.

    Raises ApiError 422 for an unusable file, or if the process that reads it crashes or is slow.
    """
    process = await asyncio.create_subprocess_exec(
        *WORKER,
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
    )
    try:
        async with asyncio.timeout(WITHIN_S):
            told, _ = await process.communicate(msgspec.msgpack.encode(job))
    except TimeoutError:
        words = f"reading the perimeter takes more than {WITHIN_S:g} s; simplify it"
        raise ApiError(422, words) from None
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    if process.returncode != 0:
        raise ApiError(
            422,
            f"the process that read the perimeter ended with {_end(process.returncode or 0)}; "
            "simplify the perimeter",
        )
    answer: Done | Failed = await asyncio.to_thread(_decode, told)
    if isinstance(answer, Failed):
        raise ApiError(422, answer.error)
    return answer


def _end(code: int) -> str:
    """Return the signal (as SIGSEGV) or the exit status that ended a process."""
    return signal.Signals(-code).name if code < 0 else f"status {code}"
