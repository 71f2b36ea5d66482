"""Runs a worker of this folder as a separate process."""

import asyncio
from collections.abc import Sequence
from subprocess import PIPE


async def worker_output(
    command: Sequence[str], data: bytes, within_s: float, stderr: int
) -> tuple[int, bytes, bytes]:
    """Run a command with ``data`` on its standard input.

    Args:
        command: The program and its arguments.
        data: The bytes for its standard input.
        within_s: The time limit; a process that takes longer is killed.
        stderr: ``subprocess.PIPE`` or ``subprocess.DEVNULL`` for its standard error.

    Returns:
        The exit status (negative: the signal that ended the process), the standard output, and the
        standard error, empty with ``DEVNULL``.

    Raises:
        TimeoutError: The process took longer than ``within_s``.
    """
    process = await asyncio.create_subprocess_exec(*command, stdin=PIPE, stdout=PIPE, stderr=stderr)
    try:
        async with asyncio.timeout(within_s):
            output, errors = await process.communicate(data)
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    return process.returncode or 0, output, errors or b""
