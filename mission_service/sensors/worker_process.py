"""Reads one untrusted file in a separate process, because a damaged file may crash the reader.

GDAL and GEOS cannot be interrupted, and have crashed on invalid input. The memory and the time of
the separate process are limited, and a crash of this process does not affect the service.
"""

import os
import resource
import signal
import subprocess
import sys

MAX_MEMORY_BYTES = 2 * 1024**3
MAX_CPU_S = 25
NICENESS = 5  # lower priority than the service
WITHIN_S = 60.0  # wall-clock time


def limit_process() -> None:
    """Limit the memory and the processor time of this process, and lower its priority."""
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (MAX_CPU_S, MAX_CPU_S))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.nice(NICENESS)


def command_of(module: str) -> tuple[str, ...]:
    """Return the command that runs a module of this service as a process."""
    return (sys.executable, "-P", "-m", module)


def end_of(code: int) -> str:
    """Return the signal (for example SIGSEGV) or the exit status with which a process ended."""
    return signal.Signals(-code).name if code < 0 else f"status {code}"


def output_of(module: str, data: bytes) -> bytes:
    """Run a module with ``data`` on its standard input, and return its standard output.

    Raises OSError if the process does not end normally within ``WITHIN_S``.
    """
    try:
        done = subprocess.run(
            command_of(module),
            input=data,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=WITHIN_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise OSError(f"takes more than {WITHIN_S:g} s to read") from None
    if done.returncode != 0:
        raise OSError(f"the process that read it ended with {end_of(done.returncode)}")
    return done.stdout
